"""The user that a tool is about: a run, a shipped user, a configuration, or a body."""

from collections.abc import Sequence
from pathlib import Path

from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation.conditions import chosen_conditions, named_options
from sim2vr_harness.play.environment import evaluation_env
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.config import TrainingConfig, load_config, parse_config, read_mapping
from sim2vr_harness.users import list_bodies


def settings_of(who: str) -> TrainingConfig:
    """Return the configuration that a name stands for.

    Args:
        who: A body's name or YAML file (docs/reference/bodies.md), a configuration's, or a user as
            of :func:`~sim2vr_harness.policies.store.find_user`.

    Raises:
        InputError: It is none of them.
    """
    if who in list_bodies():
        return parse_config({"env": {"user": {"model": who}}})
    if who.lower().endswith((".yaml", ".yml")):
        file = Path(who)
        if file.is_file() and {"mjcf", "model", "package"} & read_mapping(file).keys():
            return parse_config({"env": {"user": {"model": str(file.resolve())}}})
        return load_config(who)
    try:
        return find_user(who, code=True).config
    except InputError as error:
        try:
            paths.config_path(who)
        except FileNotFoundError:
            expected = f"{error.expected}, a configuration, or a body: {', '.join(list_bodies())}"
            raise InputError("USER", repr(who), expected) from error
        return load_config(who)


def environment_of(
    who: str,
    *,
    game: str | None = None,
    condition: str | None = None,
    overrides: Sequence[str] = (),
    trust_app: bool = False,
) -> ResolvedEnv:
    """Return the environment of a user; see :func:`settings_of`.

    Args:
        game: Another game than the user's.
        condition: Of the game.
        overrides: ``env.key=value``.
        trust_app: Whether the app that it names may be started, though you never have.

    Raises:
        InputError: Something cannot be used.
    """
    env = evaluation_env(settings_of(who), overrides=overrides, source=who, trust_app=trust_app)
    try:
        if game is not None and game != env.config.app.game:
            app = env.config.app.model_copy(update={"options": {}})
            env = env.changed(app=app).with_game(game)
            env.facts  # noqa: B018  # refuses a game that there is not
    except ValueError as error:
        got, _, expected = str(error).partition("got ")[2].partition(", expected ")
        raise InputError("--game", got or str(error), expected or "another one") from error
    if condition is None:
        return env
    named = named_options(env.config, overrides)
    (chosen,) = chosen_conditions(env.facts, [condition], named=named)
    return env.with_options(chosen.options)
