"""Keys of recorded configurations that have another name today, or none.

Read for what was recorded only (a run's ``config.yaml``, a shipped user's): a key that is written
anew must be one of today's. This is the one place that knows the old names.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from sim2vr_harness.base.errors import InputError

__all__ = ["changed_constant", "renamed", "settable"]

_TWIN = (
    *("single_targets", "failing_cells", "failing_value", "overlap_m", "speed_mps"),
    *("near_reward", "distance_reward", "stuck_cost"),
)
_NETWORK = ("net_arch", "action_scale", "log_std_init", "log_std_min", "observation_clip")
_RAMPS = ("near_starts", "failing_cells", "episode_seconds")

_RENAMED = {
    "env.threads": "env.cores",
    "ppo.value_warmup_iterations": "ppo.critic_first_updates",
    "teacher.ppo.critic_first_iterations": "teacher.ppo.critic_first_updates",
    "teacher.ppo.reward_scale": "teacher.reward_scale",
    **{f"teacher.ppo.{key}": f"teacher.policy.{key}" for key in _NETWORK},
    **{f"teacher.imagination.{key}": f"teacher.imagined.game.{key}" for key in _TWIN},
    "teacher.imagination": "teacher.imagined",
    "teacher.aids.near_start_m": "teacher.curriculum.near_start_m",
    "teacher.aids.starts_per_cell": "teacher.curriculum.starts_per_cell",
    **{f"teacher.aids.{key}": f"teacher.curriculum.{key}" for key in _RAMPS},
}
"""Old key -> new key, in this order; whole mappings are joined with what is there."""

_GONE = (
    "teacher.aids",
    "teacher.coarse_physics_s",
    "teacher.coarse_until_step",
    "teacher.imagined.game.slow_hits_until",
    "teacher.imagined.game.steady_strikes",
    "teacher.evaluate_every_steps",
    "teacher.ppo.learning_rate_range",
    "teacher.ppo.mean_penalty",
)
"""Aids that no shipped user's training needed, and the learner that only the teacher had."""

_CONSTANTS: dict[str, Any] = {
    "policy.glimpses.fovea_pixels": 32,
    "skills.looking.ahead": 3,
    "skills.looking.explore_first": 0.9,
    "skills.looking.follow": 0.01,
    "skills.looking.kept": 24_000,
    "skills.looking.settle_share": 0.5,
    "skills.looking.updates": 1.0,
    "skills.looking.gamma": 0.85,
    "skills.looking.learning_rate": 1e-3,
    "skills.practice.action_noise": 0.06,
    "skills.practice.aim_cost": 0.1,
    "skills.practice.effort": 0.3,
    "skills.practice.error_share": 0.3,
    "skills.practice.gamma": 0.95,
    "skills.practice.gradient_limit": None,
    "skills.practice.kept_cycles": 12,
    "skills.practice.learning_rate": 1.5e-3,
    "skills.practice.rest_cost": 0.0,
    "skills.practice.restart_share": 0.15,
    "student.facts_weight": 0.2,
    "student.glances_weight": 0.2,
    "student.image_noise": 0.0,
    "student.imitation_weight": 4.0,
    "student.max_grad_norm": 1.0,
    "student.noisy_users": 0.25,
    "student.statistics_episodes": 100,
    "student.weight_decay": 1e-4,
    "teacher.curriculum.failing_cells": 0.3,
    "teacher.curriculum.near_start_m": 0.08,
    "teacher.imagined.critic_learning_rate": 1e-3,
    "teacher.imagined.error_share": 0.3,
    "teacher.imagined.kept_cycles": 12,
    "teacher.imagined.lam": 0.9,
    "teacher.imagined.near_m": 0.12,
    "teacher.imagined.wild_seconds": 1.0,
    "teacher.knows_present": False,
    "teacher.policy.action_scale": 0.5,
    "teacher.policy.net_arch": [256, 256],
    "teacher.policy.observation_clip": 8.0,
    "teacher.start": None,
}
"""Keys that no shipped configuration set -> the value that all trainings have now."""

_GAME_CONSTANTS: dict[str, dict[str, Any]] = {
    "beats": {"levels": 64, "contact_m": 0.1, "speed_mps": 0.5, "error_cost": 20.0},
    "pointing": {
        "failing_blocks": 0.5,
        "depth_m": 0.02,
        "aim_m": 0.02,
        "near_reward": 2.0,
        "distance_reward": 7.0,
        "error_share": 0.1,
        "behind_cost": 0.3,
    },
    "whacamole": {
        "single_targets": 0.4,
        "failing_cells": 0.5,
        "failing_value": 1.0,
        "overlap_m": 0.015,
        "speed_mps": 0.3,
        "near_reward": 3.0,
        "distance_reward": 7.0,
        "last_overlap_m": 0.004,
        "last_speed_mps": 0.08,
        "last_near_reward": 0.2,
        "stroke_until": 0.5,
        "run_up_m": 0.1,
    },
}
"""The same for the keys of ``teacher.imagined.game``, by game."""

_CONVERTED: dict[str, Callable[[Any], Any]] = {
    # A ramp between two numbers is the number that it ended with.
    f"teacher.curriculum.{key}": lambda value: value["end"] if isinstance(value, dict) else value
    for key in _RAMPS
}


def renamed(tree: Any) -> Any:
    """Return a recorded configuration with today's keys; the argument is left as it is."""
    if not isinstance(tree, Mapping):
        return tree
    result = _with_new_names(tree)
    for old in (*_GONE, *_constants(result)):
        _take(result, old)
    for key, convert in _CONVERTED.items():
        found = _take(result, key)
        if found is not None:
            _put(result, key, convert(found[0]))
    return result


def _with_new_names(tree: Mapping[str, Any]) -> dict[str, Any]:
    result = copy.deepcopy(dict(tree))
    for old, new in _RENAMED.items():
        found = _take(result, old)
        if found is not None:
            _put(result, new, found[0])
    return result


def changed_constant(recorded: Any) -> tuple[str, Any, Any] | None:
    """Return the first key of a recorded configuration that has another value for good.

    Such a run can be evaluated, but not resumed.

    Returns:
        Key, recorded value and today's; None where all agree.
    """
    tree = _with_new_names(recorded) if isinstance(recorded, Mapping) else {}
    for key, value in _constants(tree).items():
        found = _take(tree, key)
        if found is not None and found[0] != value:
            return key, found[0], value
    return None


def settable(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration without keys that used to be settings and have today's value.

    Raises:
        InputError: such a key has another value.
    """
    copied = copy.deepcopy(dict(tree))
    for key, value in _constants(tree).items():
        found = _take(copied, key)
        if found is not None and found[0] != value:
            expected = f"it left out: it is {value!r} in all trainings now"
            raise InputError(key, repr(found[0]), expected)
    return copied


def _constants(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that can no longer be set in this configuration, and their values."""
    env = tree.get("env")
    app = env.get("app") if isinstance(env, Mapping) else None
    game = app.get("game", "whacamole") if isinstance(app, Mapping) else "whacamole"
    own = _GAME_CONSTANTS.get(game, {}) if isinstance(game, str) else {}
    return _CONSTANTS | {f"teacher.imagined.game.{key}": value for key, value in own.items()}


def _take(tree: dict[str, Any], key: str) -> tuple[Any] | None:
    """Remove a dotted key and return its value in a tuple; None if it is not there."""
    *parents, last = key.split(".")
    node: Any = tree
    for parent in parents:
        node = node.get(parent) if isinstance(node, dict) else None
    if not isinstance(node, dict) or last not in node:
        return None
    return (node.pop(last),)


def _put(tree: dict[str, Any], key: str, value: Any) -> None:
    *parents, last = key.split(".")
    node = tree
    for parent in parents:
        node = node.setdefault(parent, {})
    if isinstance(value, dict) and isinstance(node.get(last), dict):
        value = value | node[last]
    node[last] = value
