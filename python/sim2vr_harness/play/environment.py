"""The environment that a trained user is evaluated in."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.runs.config import TrainingConfig, apply_overrides, parse_config
from sim2vr_harness.runs.trust import named_app, require_trust


def make_simulation(env: ResolvedEnv, n: int, *, log_dir: Path | None = None) -> Any:
    """Return n users in their apps; the default of everything that plays."""
    from sim2vr_harness.envs.simulation import Simulation

    return Simulation(env, n, log_dir=log_dir)


def evaluation_env(
    config: TrainingConfig,
    app: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
    *,
    source: str | Path = "the configuration",
    typed: bool = True,
    trust_app: bool = False,
) -> ResolvedEnv:
    """Return the environment to evaluate in: the training's, with the game's evaluation options.

    Such as a curriculum that is switched off.

    Args:
        config: The run's configuration.
        app: Settings that replace those of ``env.app``.
        overrides: ``env.key=value``, what else is different.
        source: Where the configuration comes from, for people.
        typed: Whether this user has typed ``app`` and ``overrides``; those of a file are the file's
            word.
        trust_app: Whether the app that it names may be started, though this user never has.

    Raises:
        InputError: They do not go together, an override is not of the environment, or a file names
            a program that this user has never started.
    """
    for override in overrides:
        if not override.lstrip().startswith("env."):
            raise InputError("--set", repr(override), "env.KEY=VALUE: an evaluation trains nothing")
    tree = config.model_dump()
    options = {**tree["env"]["app"]["options"], **(app or {}).get("options", {})}
    tree["env"]["app"] |= {**(app or {}), "options": options}
    named = named_app(overrides, app) if typed else ()
    final = parse_config(apply_overrides(tree, overrides)).env
    require_trust(final, source, named=named, trust=trust_app)
    # Facts of a task come from its code: only that of the app that was asked about may run.
    tree["env"]["app"]["options"] = {
        **parse_config(tree).env.app.options,
        **(env := ResolvedEnv(final)).facts.evaluation_options,
    }
    return env.sharing(parse_config(apply_overrides(tree, overrides)).env)


def as_overrides(settings: Mapping[str, Any]) -> list[str]:
    """Return settings of ``env.app`` as ``--set`` takes them; options add to those set before."""
    mappings = ("options", "transport_options")
    flat = {key: value for key, value in settings.items() if key not in mappings}
    for key in mappings:
        for name, value in settings.get(key, {}).items():
            flat[f"{key}.{name}"] = value
    return [f"env.app.{key}={json.dumps(value)}" for key, value in flat.items()]
