"""The environment that a trained user is evaluated in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.training.config import TrainingConfig, apply_overrides, parse_config
from sim2vr_harness.training.errors import InputError

__all__ = ["evaluation_env"]


def evaluation_env(
    config: TrainingConfig,
    app: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
) -> EnvConfig:
    """Return the environment to evaluate in: the training's, with the game's evaluation options.

    Such as a curriculum that is switched off.

    Args:
        config: The run's configuration.
        app: Settings that replace those of ``env.app``.
        overrides: ``env.key=value``, what else is different.

    Raises:
        InputError: They do not go together, or an override is not of the environment.
    """
    tree = config.model_dump()
    tree["env"]["app"] |= app or {}
    playing = parse_config(tree).env.app
    tree["env"]["app"]["options"] = {
        **playing.options,
        **game_facts(playing).evaluation_options,
    }
    for override in overrides:
        if not override.lstrip().startswith("env."):
            raise InputError("--set", repr(override), "env.KEY=VALUE: an evaluation trains nothing")
    return parse_config(apply_overrides(tree, overrides)).env
