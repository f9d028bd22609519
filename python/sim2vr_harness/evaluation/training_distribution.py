"""Settings of an evaluation that lie outside the training distribution."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sim2vr_harness.client import list_options
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.games import imagined_game
from sim2vr_harness.runs.config import TrainingConfig

_COSTS_ONLY = "user.effort."
"""Prefix of settings that change the measured effort, not the user's behaviour."""

_OPTIONAL = ("vision.", "user.people")
"""Groups of settings that are there or not, which counts before their members do."""

_FELT = ("user.", "app.options.", "senses.", "vision.")
"""Groups of settings that a user notices."""


def unpractised(
    config: TrainingConfig, own: ResolvedEnv, resolved: ResolvedEnv, conditions: Sequence[str]
) -> list[str]:
    """Return the settings that a trained user was not trained with, a line each; empty if none.

    Args:
        config: Configuration of its training.
        own: The environment that it was trained in.
        resolved: The environment that it is evaluated in.
        conditions: The conditions that it is to play.
    """
    facts, env = resolved.facts, resolved.config
    by_condition = {
        key
        for condition in facts.conditions
        for key, value in condition.options.items()
        if env.app.options.get(key, value) == value
    }
    ignored = {
        *(f"app.options.{key}" for key in by_condition | set(facts.evaluation_options)),
        "cores",
        "shards",
        "user.people.seed",
        "user.people.count",
        "max_episode_seconds",
    }
    new = []
    trained, now = _settings(config.env), _settings(env)
    defaults = _defaults(config.env.app), _defaults(env.app)
    if all(defaults):
        for settings, values in zip((trained, now), defaults, strict=True):
            for key, value in values.items():
                settings.setdefault(f"app.options.{key}", value)
    for key in sorted({*trained, *now}):
        plays = key.startswith(_FELT) or "." not in key
        if _switched(key, trained, now):
            continue
        if key in ignored or not plays or key.startswith(_COSTS_ONLY):
            continue
        if trained.get(key) != now.get(key):
            before = trained.get(key)
            was = "" if before is None else f" (trained: {_plain(before)})"
            new.append(words_of_change(key, now.get(key)) + was)
    played = _trained_conditions(config, own)
    unknown = [name for name in conditions if played and not facts.drawn(name) <= played]
    if unknown:
        names = ", ".join(sorted(played))
        kind = "condition" if len(unknown) == 1 else "conditions"
        new.append(f"{kind} {', '.join(unknown)} (trained: {names})")
    return new


def met(config: TrainingConfig, own: ResolvedEnv) -> list[str]:
    """Return a ``skills`` user's conditions of training, in the game's order.

    Such a user has learned from the rewards of its own rounds alone, so that another condition,
    with other rules, is outside its training. Empty for other recipes, or if the game does not
    publish conditions.
    """
    if config.recipe != "skills":
        return []
    known = _trained_conditions(config, own)
    return [c.name for c in own.facts.conditions if c.name in known]


def words_of_change(key: str, value: Any) -> str:
    """Return a changed setting: ``env.user.noise.constant``, white -> noise.constant = white."""
    for prefix in ("env.", "user.", "app.options.", "senses."):
        key = key.removeprefix(prefix)
    return f"{key} = {_plain(value)}"


def _defaults(app: AppConfig) -> dict[str, Any]:
    """Return the defaults of options that a round does not set, as far as the game states them.

    For an option that a condition sets, the value of the condition is used instead, which is
    compared by its name.
    """
    if app.transport != "in_process" or app.page is not None:
        return {}
    try:
        options = list_options(app.game)
    except ValueError:
        return {}
    return {option.name: option.default for option in options if option.default != []}


def _trained_conditions(config: TrainingConfig, own: ResolvedEnv) -> set[str]:
    """Return the conditions of a training's rounds; empty if the game does not publish them."""
    facts = own.facts
    names = {facts.condition_of(config.env.app.options)}
    if config.recipe == "distill":
        game = imagined_game(config.env.app.game)
        names |= set(config.teacher.conditions or (game.conditions if game else ()))
    return set().union(*(facts.drawn(name) for name in names if name))


def _settings(env: EnvConfig) -> dict[str, Any]:
    """Dotted keys and values; senses by the key that they have in the observation."""
    tree = env.model_dump()
    tree["senses"] = {sense["name"] or sense["sense"]: sense for sense in tree["senses"]}
    flat = dict(_flat(tree))
    groups = {key.rpartition(".")[0] for key in flat}
    return {**flat, **{group: True for group in groups if group.startswith(_OPTIONAL)}}


def _switched(key: str, *both: Mapping[str, Any]) -> bool:
    """Return whether the group of this key is set on one side only.

    The difference is then reported for the group.
    """
    group = key.rpartition(".")[0]
    return group.startswith(_OPTIONAL) and any(not each.get(group) for each in both)


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _plain(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value))
    if value is None:
        return "none"
    return str(value) if not isinstance(value, bool) else "yes" if value else "no"
