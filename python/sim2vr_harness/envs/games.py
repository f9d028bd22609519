"""The game of an environment, and the facts that it publishes."""

from collections.abc import Sequence
from functools import cache
from typing import Any

from sim2vr_harness.client import GameFacts, describe_game, facts_of_outside, list_games
from sim2vr_harness.client.games import require_game_library
from sim2vr_harness.client.tasks import load_task, names_code, task_facts
from sim2vr_harness.envs.apps import facts_told, judged, knows_options
from sim2vr_harness.envs.config import AppConfig, EnvConfig, with_options
from sim2vr_harness.users import Body, installed_bodies, load_body


def game_facts(app: AppConfig, *, ask: bool = True) -> GameFacts:
    """What is known of the game that an app plays.

    Where a task judges the app, what the task says: it replaces what the game publishes.

    Args:
        app: The app's settings.
        ask: Whether an app that runs already is asked about a game that the runtime does not have,
            and whether a task's code may run.

    Raises:
        ValueError: The runtime has no such game; names the nearest. Or a library of games is named
            whose code may not run.
        RuntimeError: The app that was asked does not answer.
    """
    if app.game_library is not None:
        require_game_library(app.game_library)
    if judged(app):
        if names_code(app.task) and not ask:
            return GameFacts(name=app.game, published=False)
        return task_facts(load_task(app.task), app.game)
    if knows_options(app) or (app.transport == "protocol2" and app.game in list_games()):
        return describe_game(app.game)
    told = facts_told(app) if ask and app.game not in list_games() else None
    return told or facts_of_outside(app.game)


def with_condition(config: EnvConfig, condition: str | None) -> EnvConfig:
    """The configuration with the options of a condition of its game; None leaves it.

    Raises:
        ValueError: The game has no such condition; names the nearest.
    """
    if condition is None:
        return config
    return with_options(config, game_facts(config.app).condition(condition).options)


def with_game(config: EnvConfig, game: str | None) -> EnvConfig:
    """The configuration with another game; None leaves it.

    A configuration that names no body gets one that wears what the game is played with, and one
    that names no inputs those that the game reads.
    """
    if game is None or game == config.app.game:
        return config
    config = config.model_copy(update={"app": config.app.model_copy(update={"game": game})})
    facts, user = game_facts(config.app, ask=False), config.user
    changes: dict[str, Any] = {}
    if facts.inputs and "inputs" not in user.model_fields_set:
        changes["inputs"] = facts.inputs
    if "model" not in user.model_fields_set:
        changes["model"] = _body_wearing(facts.needs("right"), user.model)
    return config.model_copy(update={"user": user.model_copy(update=changes)})


def with_task(config: EnvConfig) -> EnvConfig:
    """The configuration with the inputs that the app reads, and a body for its task.

    As far as the configuration does not say which itself.

    Raises:
        InputError: the task cannot be used.
    """
    user, changes = config.user, dict[str, Any]()
    if judged(config.app):
        task = load_task(config.app.task)
        inputs = tuple(task.inputs)
        if "model" not in user.model_fields_set:
            changes["model"] = _body_wearing(tuple(task.devices), user.model)
    else:
        inputs = game_facts(config.app, ask=False).inputs
    if inputs and "inputs" not in user.model_fields_set:
        changes["inputs"] = inputs
    return (
        config.model_copy(update={"user": user.model_copy(update=changes)}) if changes else config
    )


def without_training(config: EnvConfig, overrides: Sequence[str] = ()) -> EnvConfig:
    """:func:`with_task` for a user who needs no depth, which few OpenXR programs submit.

    Args:
        config: of the environment.
        overrides: ``KEY=VALUE`` that were given; channels among them stay.
    """
    vision = config.vision
    if config.app.transport == "openxr" and not any("vision.channels" in one for one in overrides):
        colours = tuple(name for name in vision.channels if name != "depth")
        vision = vision.model_copy(update={"channels": colours})
    return with_task(config.model_copy(update={"vision": vision}))


@cache
def _body_wearing(devices: tuple[str, ...], usual: str) -> str:
    """The usual body; where it cannot wear the devices, the one with the fewest muscles that can.

    The usual one, too, when no one can. Without muscles the usual effort has nothing to go by.
    """
    if set(devices) <= set(load_body(usual).devices):
        return usual
    able = {}
    for name in installed_bodies():
        body = load_body(name)
        if body.muscles and set(devices) <= set(body.devices):
            able[name] = len(body.muscles)
    return min(able, key=able.__getitem__, default=usual)


def with_hand(config: EnvConfig, body: Body) -> EnvConfig:
    """The configuration in which a game is played with the hand that the user plays with.

    That is the person's `handedness`, as far as they wear a controller there, or the only hand with
    a controller. A hand among the game's options stays.

    Raises:
        ValueError: the user does not wear the controllers that the game is played with.
    """
    facts = game_facts(config.app)
    option = facts.hand_option
    if option is not None and option not in config.app.options:
        worn = [hand for hand in ("right", "left") if f"controller_{hand}" in body.devices]
        own = config.user.person.handedness
        hand = own if own in worn else next(iter(worn), "right")
        if hand == "left":
            config = with_options(config, {option: hand})
    hand_played = config.app.options.get(option, "right") if option else "right"
    for device in facts.needs(hand_played):
        if device not in body.devices:
            how = f" with {option}={hand_played}" if option else ""
            raise ValueError(
                f"user: got {body.name!r} wearing {', '.join(body.devices)}, expected "
                f"{device}, which {facts.name}{how} is played with"
            )
    return config
