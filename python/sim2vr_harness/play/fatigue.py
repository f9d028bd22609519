"""Fatigue of single muscles and of the body parts that they move."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import Measure
from sim2vr_harness.envs.config import UserConfig, body_of
from sim2vr_harness.users import Body

FATIGUE = "fatigue."
"""What names of these measures begin with; a muscle or a body part follows."""

MUSCLE_NAMES = {
    "DELT1": "deltoid anterior",
    "DELT2": "deltoid middle",
    "DELT3": "deltoid posterior",
    "SUPSP": "supraspinatus",
    "INFSP": "infraspinatus",
    "SUBSC": "subscapularis",
    "TMIN": "teres minor",
    "TMAJ": "teres major",
    "PECM1": "pectoralis major clavicular",
    "PECM2": "pectoralis major sternal",
    "PECM3": "pectoralis major ribs",
    "LAT1": "latissimus dorsi thoracic",
    "LAT2": "latissimus dorsi lumbar",
    "LAT3": "latissimus dorsi iliac",
    "CORB": "coracobrachialis",
    "TRIlong": "triceps long head",
    "TRIlat": "triceps lateral head",
    "TRImed": "triceps medial head",
    "ANC": "anconeus",
    "SUP": "supinator",
    "BIClong": "biceps long head",
    "BICshort": "biceps short head",
    "BRA": "brachialis",
    "BRD": "brachioradialis",
    "ECRL": "extensor carpi radialis longus",
    "ECRB": "extensor carpi radialis brevis",
    "ECU": "extensor carpi ulnaris",
    "FCR": "flexor carpi radialis",
    "FCU": "flexor carpi ulnaris",
    "PL": "palmaris longus",
    "PT": "pronator teres",
    "PQ": "pronator quadratus",
}
"""Abbreviation in MoBL ARMS -> muscle (Holzbaur et al. 2005, doi 10.1007/s10439-005-3320-7; Saul
et al. 2015 keep the names)."""

PARTS = {
    "elv_angle": "shoulder",
    "shoulder_elv": "shoulder",
    "shoulder_rot": "shoulder",
    "elbow_flexion": "elbow",
    "pro_sup": "forearm",
    "deviation": "wrist",
    "flexion": "wrist",
}
"""Joint of MoBL ARMS -> body part; another joint is a part of its own name."""
SIDES = {"_r": "right", "_l": "left"}
_TIRING = "cumulative_fatigue_3ccr"
"""The effort model with motor units that tire."""
_LEAST_ARM_M = 1e-5
"""A smaller moment arm is rounding."""
_POSTURES = 8
"""Drawn from the joints' ranges, beside their middle: an arm may vanish in one posture."""
_STEP = 1e-4
"""Of a joint, for the difference of lengths; rad, slides m."""


def full_name(name: str) -> str:
    """Return a muscle or part for people: ``ANC_r`` -> ``anconeus, right``; others as they are."""
    stem, side = split_side(name)
    words = MUSCLE_NAMES.get(stem, stem)
    if not side or (stem not in MUSCLE_NAMES and stem not in PARTS.values()):
        return MUSCLE_NAMES.get(name, name)
    return f"{words}, {SIDES[side]}"


def fatigue_measure(name: str) -> Measure:
    """Return the measure of a name that begins with :data:`FATIGUE`."""
    who = full_name(name.removeprefix(FATIGUE))
    return Measure(name, f"Fatigue of {who}", unit="proportion", better="lower", digits=3)


def fatigue_measures(names: Iterable[str]) -> tuple[Measure, ...]:
    """Return the measures of those names that are of fatigue, each once, in their order."""
    return tuple(fatigue_measure(name) for name in dict.fromkeys(names) if name.startswith(FATIGUE))


def split_side(name: str) -> tuple[str, str]:
    """Return a name without its side, and the side: ``_r``, ``_l`` or nothing."""
    return (name[:-2], name[-2:]) if name[-2:] in SIDES else (name, "")


@dataclass(frozen=True)
class FatigueGroups:
    """What tires of a body: its muscles, and the body parts that they move.

    Attributes:
        muscles: (L,) what tires, in the order of the effort model.
        parts: Body part -> (K,) indices of the muscles that cross one of its joints; of both sides
            where there are two, and of each.
    """

    muscles: tuple[str, ...]
    parts: Mapping[str, NDArray[np.int64]]

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the measures of body parts."""
        return tuple(f"{FATIGUE}{name}" for name in self.parts)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the measures, those of body parts first."""
        return (*self.part_names, *(f"{FATIGUE}{name}" for name in self.muscles))

    def values(self, worst: NDArray[np.floating[Any]]) -> dict[str, float]:
        """Return each measure's value, of (L,) largest shares of fatigued motor units."""
        means = [float(worst[members].mean()) for members in self.parts.values()]
        return dict(zip(self.names, [*means, *worst.tolist()], strict=True))


def fatigue_groups(body: Body) -> FatigueGroups:
    """Return what tires of a body, grouped by :func:`muscles_by_part`."""
    muscles = (*body.muscles, *body.effort_inputs.loads)
    parts = muscles_by_part(body, muscles)
    return FatigueGroups(muscles, {part: parts[part] for part in parts if part not in muscles})


def muscles_by_part(body: Body, muscles: Sequence[str]) -> dict[str, NDArray[np.int64]]:
    """Group muscles and motors by the joints that each has a moment arm at.

    Args:
        body: Has them all.
        muscles: Names of L muscles or motors.

    Returns:
        Body part -> (K,) indices of what crosses one of its joints; a muscle may be in several.
        Where there are two sides, a part of both comes with ``PART_r`` and ``PART_l``.
    """
    parts: dict[str, set[int]] = {}
    crossed = _moment_arms(body, muscles) > _LEAST_ARM_M
    joints = [split_side(joint) for joint in body.independent_joints]
    both = {side for _, side in joints if side} == set(SIDES)
    for (stem, side), column in zip(joints, crossed.T, strict=True):
        part = PARTS.get(stem, stem)
        for name in (part, f"{part}{side}") if both and side else (part,):
            parts.setdefault(name, set()).update(np.flatnonzero(column).tolist())
    return {name: np.array(sorted(members)) for name, members in parts.items() if members}


def fatigue_names(user: UserConfig) -> tuple[str, ...]:
    """Return the names of a user's measures of fatigue; none without a model of fatigue."""
    return fatigue_groups(body_of(user)).names if user.effort.model == _TIRING else ()


def _moment_arms(body: Body, muscles: Sequence[str]) -> NDArray[np.float64]:
    """(L, J) the largest moment arms at independent joints, couplings included; m."""
    model = body.physics_model
    data = mujoco.MjData(model)
    rows = [model.actuator(name).id for name in muscles]
    low, high = body.joint_ranges.T

    def lengths(q: NDArray[np.float64]) -> NDArray[np.float64]:
        data.qpos[:] = body.coupled_qpos(q)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        mujoco.mj_transmission(model, data)
        return np.array(data.actuator_length[rows])

    shares = np.random.default_rng(1).random((_POSTURES, len(low)))
    largest = np.zeros((len(rows), len(low)))
    for q in (0.5 * (low + high), *(low + shares * (high - low))):
        for joint, step in enumerate(np.eye(len(low)) * _STEP):
            arms = np.abs(lengths(q + step) - lengths(q - step)) / (2.0 * _STEP)
            largest[:, joint] = np.maximum(largest[:, joint], arms)
    return largest
