"""Policy contract: the body, observations and actions that a policy was trained with."""

import hashlib
import json
from typing import Any

from gymnasium import spaces

from sim2vr_harness.envs.config import EnvConfig, body_of
from sim2vr_harness.envs.senses import observation_space_of
from sim2vr_harness.perception import SENSES
from sim2vr_harness.users import FEATURES, Body


def contract(config: EnvConfig) -> dict[str, Any]:
    """The environment's side of a trained user's agreement, as plain values.

    Two environments with equal contracts can be played by the same policy. Effort, noise and the
    game's options are no part of it: they decide how well a user does, not whether it can act.
    """
    body = body_of(config.user)
    space = observation_space_of(config)
    sight = config.sense("vision")
    return {
        "game": config.app.game,
        "user": body.name,
        "skull_rotation_deg": config.user.skull_rotation_deg,
        "muscles": list(body.muscles),
        **_beyond_muscles(body),
        **_person(config),
        "action": "change of activation, -1 to 1",
        "action_frequency_hz": config.action_frequency_hz,
        "frames_per_step": config.frames_per_step,
        "image": list(config.vision.drawn),
        "channels": list(config.vision.channels),
        "buffer_s": None if sight is None else _listed(sight.history_s),
        "observation": {key: _box(box) for key, box in sorted(space.spaces.items())},
        **_beyond_the_default(config),
    }


def _listed(times: float | tuple[float, ...] | None) -> float | list[float] | None:
    """As JSON has it."""
    return list(times) if isinstance(times, tuple) else times


def _beyond_muscles(body: Body) -> dict[str, Any]:
    """What a body has besides muscles, a headset and a right controller."""
    terms: dict[str, Any] = {}
    if body.action_names != body.muscles:
        terms["actuators"] = [[group.rule, *group.actuators] for group in body.actuator_groups]
    if sorted(body.devices) != ["controller_right", "headset"]:
        terms["devices"] = sorted(body.devices)
    return terms


def _person(config: EnvConfig) -> dict[str, Any]:
    """How the person differs, where it does."""
    person = config.user.person.model_dump(exclude_defaults=True)
    return {"person": person} if person else {}


def _beyond_the_default(config: EnvConfig) -> dict[str, Any]:
    """Terms that are named only where they are not the default.

    How late, noisy or coarse a sense is, is none of them: a policy can act with it.
    """
    terms: dict[str, Any] = {}
    kinds = {(one.name or SENSES[one.sense].key): one.sense for one in config.senses}
    if any(SENSES[kind].key != key for key, kind in kinds.items()):
        terms["senses"] = kinds
    if config.vision.eyes != 1:
        terms["eyes"] = config.vision.eyes
    if config.user.inputs:
        terms["inputs"] = list(config.user.inputs)
    if config.gaze_moves:
        terms["gaze"] = "moves"
    if config.sense("person") is not None:
        terms["person_features"] = list(FEATURES)
    return terms


def _box(box: spaces.Space[Any]) -> list[Any]:
    return [list(box.shape or ()), str(box.dtype)]


def contract_hash(terms: dict[str, Any]) -> str:
    """16 hexadecimal digits; equal contracts have equal ones."""
    text = json.dumps(terms, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[tuple[str, Any, Any]]:
    """The terms in which two contracts differ: (name, of the one, of the other)."""
    return [
        (key, one.get(key), other.get(key))
        for key in [*one, *(key for key in other if key not in one)]
        if one.get(key) != other.get(key)
    ]


def worded(found: list[tuple[str, Any, Any]]) -> tuple[str, str]:
    """Word :func:`differences` for an error: the terms of the one, and of the other."""

    def short(value: Any) -> str:
        text = json.dumps(value)
        return text if len(text) <= 80 else f"{text[:77]}..."

    one = "; ".join(f"{key} {short(value)}" for key, value, _ in found)
    return one, "; ".join(f"{key} {short(value)}" for key, _, value in found)
