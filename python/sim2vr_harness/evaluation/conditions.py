"""Choose the conditions to play; options that the user names win over theirs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import Condition, GameFacts
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.client.launch import named_condition
from sim2vr_harness.envs.apps import knows_options
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.runs.config import apply_overrides

_ARGUMENT = "condition"
"""The option that is the condition of an app that publishes none."""

Options = Mapping[str, OptionValue]


def named_options(
    env: EnvConfig, overrides: Sequence[str], app: Mapping[str, Any] | None = None
) -> dict[str, OptionValue]:
    """Return the game's options that ``overrides`` or ``app`` set, with their values in ``env``.

    Args:
        env: Environment with these settings.
        overrides: ``env.key=value``.
        app: Settings that replace those of ``env.app``.
    """
    tree = apply_overrides({"env": {"app": dict(app or {})}}, overrides)
    names = tree["env"]["app"].get("options") or {}
    return {name: env.app.options[name] for name in names if name in env.app.options}


def asked_conditions(
    app: AppConfig, names: Sequence[str] | None, *, typed: bool
) -> Sequence[str] | None:
    """Return the conditions that the user names, including ``-condition`` of the app's arguments.

    Args:
        app: The app's settings.
        names: Conditions that the user names otherwise.
        typed: True if the user has typed the app's arguments. Those of a run count only if the app
            accepts its options at its start only.

    Raises:
        InputError: Both name one, and not the same.
    """
    argument = named_condition(app.arguments)
    if argument is None or (knows_options(app) and not typed):
        return names
    if names and list(names) != [argument]:
        got = f"{', '.join(names)} together with --app-arg -condition {argument}"
        raise InputError("--condition", got, "one of the two")
    return [argument]


def chosen_conditions(
    facts: GameFacts,
    names: Sequence[str] | None,
    usual: Sequence[str] = (),
    named: Options | None = None,
    *,
    field: str = "--condition",
) -> list[Condition]:
    """Return conditions to play; options that the user sets replace their own.

    Without ``names``, those of ``usual`` (or of the game's evaluation) that agree with ``named``;
    if none agrees, all of them, each once.

    Args:
        names: Conditions that the user names.
        usual: Conditions without any.
        named: Options that the user sets, see :func:`named_options`.
        field: Name of the conditions' argument in messages.

    Raises:
        InputError: The game does not know one, one occurs twice, or an option turns one into
            another.
    """
    named = named or {}
    chosen = list(names or _agreeing(facts, usual or facts.evaluated, named))
    if not chosen:
        raise InputError(field, "none", f"one: the app of {facts.name!r} does not say which it has")
    if len(set(chosen)) != len(chosen):
        raise InputError(field, ", ".join(chosen), "every condition once")
    try:
        known = [facts.condition(name) for name in chosen]
    except ValueError as error:
        got, _, expected = str(error).partition(": got ")[2].partition(", expected ")
        raise InputError(field, got, expected) from error
    # Refuse conditions that named options make another one, or the same as one before.
    conditions = [_with(one, named) for one in known]
    typed = bool(names)
    found: list[Condition] = []
    for condition in conditions:
        own = {key: value for key, value in named.items() if key in condition.options}
        others = [c for c in facts.conditions if c.options == condition.options]
        if not others and not facts.published and _ARGUMENT in own:
            others = [facts.condition(str(own[_ARGUMENT]))]
        same = [c for c in found if c.options == condition.options]
        wrong = "" if not own or condition.name in {c.name for c in others} else _first(others)
        wrong = wrong or (_first(same) if own else "")
        if not wrong:
            found.append(condition)
        elif typed:
            option = ", ".join(f"env.app.options.{key}={value}" for key, value in own.items())
            got = f"{condition.name!r} together with {option}, which is {wrong!r}"
            raise InputError(field, got, "one of the two")
    return found


def _with(condition: Condition, named: Options) -> Condition:
    """Return a condition with the user's values of the options that the user sets."""
    own = condition.options
    return replace(condition, options={key: named.get(key, own[key]) for key in own})


def _agreeing(facts: GameFacts, usual: Sequence[str], named: Options) -> Sequence[str]:
    """Return usual conditions that have the named options, else any that have them."""
    own = {key for condition in facts.conditions for key in condition.options}
    if not facts.conditions and not facts.published:
        own = {_ARGUMENT}
    if not own & named.keys():
        return usual
    agree = [c.name for c in facts.conditions if _with(c, named) == c]
    if not facts.conditions:
        agree = [str(named[_ARGUMENT])]
    return [name for name in usual if name in agree] or agree or usual


def _first(conditions: Sequence[Condition]) -> str:
    return conditions[0].name if conditions else ""


def facts_of_chosen(facts: GameFacts, chosen: Sequence[Condition]) -> GameFacts:
    """Return the facts with these conditions instead of those of the same names."""
    own = {condition.name: condition for condition in chosen}
    return replace(facts, conditions=tuple(own.get(c.name, c) for c in facts.conditions))


def condition_groups(
    env: ResolvedEnv, conditions: Sequence[Condition]
) -> list[tuple[ResolvedEnv, Sequence[Condition]]]:
    """Return the conditions that can be played by the same apps, and these apps' settings.

    An app that accepts its options at its start only is started again for every condition.
    """
    if knows_options(env.config.app):
        return [(env, conditions)]
    return [(env.with_options(condition.options), [condition]) for condition in conditions]
