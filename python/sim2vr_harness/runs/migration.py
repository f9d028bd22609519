"""Keys of configurations that have another name today, a fixed value, or none; renamed tensors.

A recorded configuration (a run's ``config.yaml``, a shipped user's) may have any of them. One that
a user writes may have the keys of the version before, with a warning. This is the one place that
knows the old names.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.notices import notice_once

_GAME_MODEL = (
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
    **{f"teacher.imagination.{key}": f"teacher.imagined.game.{key}" for key in _GAME_MODEL},
    "teacher.imagination": "teacher.imagined",
    "teacher.aids.near_start_m": "teacher.curriculum.near_start_m",
    "teacher.aids.starts_per_cell": "teacher.curriculum.starts_per_cell",
    **{f"teacher.aids.{key}": f"teacher.curriculum.{key}" for key in _RAMPS},
}
"""Old key -> new key, in this order; whole mappings are joined with what is there."""

_IMAGINED = {
    "growing_lag_cycles": "delay_ramp_cycles",
    "present_cycles": "undelayed_cycles",
    "growing_noise_cycles": "noise_ramp_cycles",
    "growing_cost_cycles": "cost_ramp_cycles",
    "rest_cost": "activation_cost",
    "change_cost": "action_rate_cost",
    "carry_cost": "movement_cost",
    "aim_cost": "actuator_range_cost",
}
_RENAMED_SINCE_0_2 = {
    "skills.practice": "skills.motor_training",
    "skills.motor_training.aim_cost": "skills.motor_training.actuator_range_cost",
    "skills.motor_training.rest_cost": "skills.motor_training.activation_cost",
    "skills.looking": "skills.q_learning",
    "policy.glimpses": "policy.attention_crops",
    **{f"teacher.imagined.{old}": f"teacher.imagined.{new}" for old, new in _IMAGINED.items()},
    "teacher.recognition_steps": "teacher.recognition_latency_steps",
    "teacher.imagined.game.stuck_cost": "teacher.imagined.game.dwell_cost",
    "teacher.imagined.game.impact_share": "teacher.imagined.game.impact_speed_weight",
}
"""The same; these a user may still write, with a warning."""

_VALUES = {"skills.user": {"decider": "hierarchical"}}
"""Key -> old name of a value -> new name."""

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
    "policy.attention_crops.features": 96,
    "policy.attention_crops.fovea_pixels": 32,
    "policy.attention_crops.fovea_zoom": 3,
    "policy.attention_crops.vision_pixels": 24,
    "policy.shared_mlp": False,
    "skills.baseline_seconds": 6.0,
    "skills.q_learning.ahead": 3,
    "skills.q_learning.batch_size": 64,
    "skills.q_learning.decide_steps": 3,
    "skills.q_learning.explore_first": 0.9,
    "skills.q_learning.follow": 0.01,
    "skills.q_learning.kept": 24_000,
    "skills.q_learning.settle_share": 0.5,
    "skills.q_learning.updates": 1.0,
    "skills.q_learning.gamma": 0.85,
    "skills.q_learning.learning_rate": 1e-3,
    "skills.q_learning.width": 32,
    "skills.motor_training.action_noise": 0.06,
    "skills.motor_training.actuator_range_cost": 0.1,
    "skills.motor_training.body_width": 256,
    "skills.motor_training.effort": 0.3,
    "skills.motor_training.error_share": 0.3,
    "skills.motor_training.first_fit_minibatches": 1500,
    "skills.motor_training.first_play_steps": 400,
    "skills.motor_training.fit_minibatches": 300,
    "skills.motor_training.gamma": 0.95,
    "skills.motor_training.gradient_limit": None,
    "skills.motor_training.kept_cycles": 12,
    "skills.motor_training.learning_rate": 1.5e-3,
    "skills.motor_training.play_steps": 100,
    "skills.motor_training.updates": 100,
    "skills.motor_training.users": 256,
    "skills.motor_training.window_steps": 16,
    "skills.motor_training.activation_cost": 0.0,
    "skills.motor_training.restart_share": 0.15,
    "student.checkpoint_rounds": 20,
    "student.facts_weight": 0.2,
    "student.glances_weight": 0.2,
    "student.image_noise": 0.0,
    "student.imitation_weight": 4.0,
    "student.max_grad_norm": 1.0,
    "student.noisy_users": 0.25,
    "student.rollout_steps": 32,
    "student.statistics_episodes": 100,
    "student.teacher_rounds": 3,
    "student.weight_decay": 1e-4,
    "teacher.curriculum.episode_seconds": 12.0,
    "teacher.curriculum.failing_cells": 0.3,
    "teacher.curriculum.near_start_m": 0.08,
    "teacher.curriculum.starts_per_cell": 40,
    "teacher.evaluate_rounds": 4,
    "teacher.imagined.critic_learning_rate": 1e-3,
    "teacher.imagined.critic_first_updates": 30,
    "teacher.imagined.error_share": 0.3,
    "teacher.imagined.first_fit_minibatches": 1500,
    "teacher.imagined.fit_minibatches": 215,
    "teacher.imagined.kept_cycles": 12,
    "teacher.imagined.lam": 0.9,
    "teacher.imagined.near_m": 0.12,
    "teacher.imagined.play_steps": 100,
    "teacher.imagined.updates": 90,
    "teacher.imagined.wild_seconds": 1.0,
    "teacher.knows_present": False,
    "teacher.policy.action_scale": 0.5,
    "teacher.policy.net_arch": [256, 256],
    "teacher.policy.observation_clip": 8.0,
    "teacher.ppo.clip_range": 0.2,
    "teacher.ppo.critic_learning_rate_factor": 1.0,
    "teacher.ppo.critic_first_updates": 10,
    "teacher.ppo.ent_coef": 0.0,
    "teacher.ppo.gae_lambda": 0.93,
    "teacher.ppo.gamma": 0.96,
    "teacher.ppo.learning_rate": {"initial": 3e-4, "final": 3e-4, "constant_fraction": 0.0},
    "teacher.ppo.max_grad_norm": 1.0,
    "teacher.ppo.n_epochs": 6,
    "teacher.ppo.n_steps": 32,
    "teacher.ppo.target_kl": 0.05,
    "teacher.ppo.vf_coef": 0.5,
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

_GAME_KEY = "teacher.imagined.game"
_SHAPINGS: dict[str, tuple[str, dict[str, tuple[float, float]]]] = {
    "beats": (
        "whole_levels",
        {
            "busy_starts": (0.9, 0.6),
            "angle_deg": (25.0, 50.0),
            "near_reward": (20.0, 40.0),
            "hazard_cost": (0.0, 200.0),
            "look_cost": (0.0, 20.0),
            "wall_cost": (0.0, 40.0),
            "early_error_cost": (20.0, 1.0),
        },
    ),
    "whacamole": (
        "unhurried",
        {
            "plane_cost": (0.0, 1.0),
            "blind_cost": (0.0, 1.0),
            "centre_share": (0.0, 0.3),
            "face_share": (0.0, 0.5),
            "patience_per_s": (0.0, 2.5),
            "patience_until_s": (1.098, 0.5),
            "foregone_share": (0.0, 1.0),
            "hit_reward": (10.0, 30.0),
        },
    ),
}
"""Game -> a value of ``shaping``, and keys of before that it stands for: without it, with it."""

_TENSORS = {"glimpses": "attention_crops", "glances": "crop_places"}
"""Old part of a dotted name -> new part: of networks' weights and of a student's frames."""

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
    _rename(result, _RENAMED | _RENAMED_SINCE_0_2)
    _shape(result)
    return result


def _shape(tree: dict[str, Any]) -> None:
    """Put ``shaping`` where the keys of before have all values that it stands for, in place."""
    shaping, values = _SHAPINGS.get(_game(tree), ("", {}))
    node = _at(tree, _GAME_KEY)
    if (
        isinstance(node, dict)
        and values
        and all(node.get(key) == shaped for key, (_, shaped) in values.items())
    ):
        node["shaping"] = shaping


def _rename(tree: dict[str, Any], names: Mapping[str, str]) -> list[tuple[str, str]]:
    """Rename keys and values in place; return what was found, old and new."""
    renamings = []
    for old, new in names.items():
        found = _take(tree, old)
        if found is not None:
            _put(tree, new, found[0])
            renamings.append((old, new))
    for key, values in _VALUES.items():
        found = _take(tree, key)
        if found is not None:
            value = found[0]
            new_value = values.get(value, value) if isinstance(value, str) else value
            _put(tree, key, new_value)
            if new_value != value:
                renamings.append((f"{key}: {value}", f"{key}: {new_value}"))
    return renamings


def with_new_names(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a user has written with today's names, and warn of each old one."""
    result = copy.deepcopy(dict(tree))
    for old, new in _rename(result, _RENAMED_SINCE_0_2):
        notice_once(f"{old} is now called {new}: the old name works in this version only.")
    return result


def new_name(key: str) -> str:
    """Return today's name of a dotted key that a user has written, and warn if it was another."""
    name = key
    for old, new in _RENAMED_SINCE_0_2.items():
        if f"{name}.".startswith(f"{old}."):
            name = new + name.removeprefix(old)
    if name != key:
        notice_once(f"{key} is now called {name}: the old name works in this version only.")
    return name


def with_new_tensor_names(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return tensors by today's dotted names, of a file that may have those of before."""
    tensors = {
        ".".join(_TENSORS.get(part, part) for part in name.split(".")): value
        for name, value in state.items()
    }
    if "hold" in tensors:  # hierarchical policies; all lifted off before it was compared
        tensors.setdefault("lifts", tensors["hold"].new_ones(1, 1, 1))
    return tensors


def changed_constant(recorded: Any) -> tuple[str, Any, Any] | None:
    """Return the first key of a recorded configuration that has another value for good.

    Such a run can be evaluated, but not resumed.

    Returns:
        Key, recorded value and today's; None where all agree.
    """
    tree = _with_new_names(recorded) if isinstance(recorded, Mapping) else {}
    for key, value in _constants(tree).items():
        found = _take(tree, key)
        if found is not None and not _same(found[0], value):
            return key, found[0], value
    return None


def settable(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration that a user wrote, with today's names and without fixed keys.

    Raises:
        InputError: such a key has another value.
    """
    copied = with_new_names(tree)
    _shape(copied)
    for key, value in _constants(copied).items():
        found = _take(copied, key)
        if found is not None and not _same(found[0], value):
            where = "in all trainings now"
            if key.removeprefix(f"{_GAME_KEY}.") in _SHAPINGS.get(_game(copied), ("", {}))[1]:
                where = f"with shaping: {_at(copied, f'{_GAME_KEY}.shaping') or 'none'}"
            expected = f"it left out: it is {value!r} {where}"
            raise InputError(key, repr(found[0]), expected)
    return copied


def _constants(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that can no longer be set in this configuration, and their values."""
    game = _game(tree)
    shaping, values = _SHAPINGS.get(game, ("", {}))
    chosen = _at(tree, f"{_GAME_KEY}.shaping") == shaping
    shaped = {key: value[chosen] for key, value in values.items()}
    own = _GAME_CONSTANTS.get(game, {}) | shaped
    return _CONSTANTS | {f"{_GAME_KEY}.{key}": value for key, value in own.items()}


def _game(tree: Mapping[str, Any]) -> str:
    env = tree.get("env")
    app = env.get("app") if isinstance(env, Mapping) else None
    game = app.get("game", "whacamole") if isinstance(app, Mapping) else "whacamole"
    return game if isinstance(game, str) else ""


def _same(recorded: Any, constant: Any) -> bool:
    """Whether a value is the constant; a number stands for a learning rate that stays the same."""
    if isinstance(constant, dict) and not isinstance(recorded, dict):
        recorded = {"initial": recorded, "final": recorded, "constant_fraction": 0.0}
    return bool(recorded == constant)


def _at(tree: Mapping[str, Any], key: str) -> Any:
    """Return the value of a dotted key; None if it is not there."""
    node: Any = tree
    for part in filter(None, key.split(".")):
        node = node.get(part) if isinstance(node, Mapping) else None
    return node


def _take(tree: dict[str, Any], key: str) -> tuple[Any] | None:
    """Remove a dotted key and return its value in a tuple; None if it is not there."""
    parents, _, last = key.rpartition(".")
    node = _at(tree, parents)
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
