"""Group the muscles of a body by the joints that they cross, and measure their fatigue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.config import UserConfig, body_of
from sim2vr_harness.evaluation.fatigue import FATIGUE, PARTS, SIDES, split_side
from sim2vr_harness.users import Body, UserBatch

_TIRING = "cumulative_fatigue_3ccr"
"""The effort model with motor units that tire."""
_LEAST_ARM_M = 1e-5
"""A smaller moment arm is rounding."""
_POSTURES = 8
"""Drawn from the joints' ranges, beside their middle: an arm may vanish in one posture."""
_STEP = 1e-4
"""Of a joint, for the difference of lengths; rad, slides m."""


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


def worst_of(simulation: Any, user: int) -> NDArray[np.float64]:
    """Return (L,) largest shares of fatigued motor units of a user's round so far."""
    worst: NDArray[np.float64] = simulation.users.effort.state_dict()["max_MF"][user]
    return worst


def groups_of(simulation: Any) -> FatigueGroups | None:
    """Return what tires of a simulation's users; None without a model of fatigue."""
    users = getattr(simulation, "users", None)
    if not isinstance(users, UserBatch) or "max_MF" not in users.effort.state_dict():
        return None
    return fatigue_groups(users.body)


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
