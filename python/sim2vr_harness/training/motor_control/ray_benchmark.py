"""Rays that a human motor policy turns: Fitts' law in angles, errors, and rays that come to rest.

Simulated persons hold their ray on a place, then a target appears 1 to 3 m from the head. The
policy itself says when a movement is over. Lengths of movements are those of the rays' directions,
one metre from the hand, so that they are angles in rad.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch

from sim2vr_harness.client.frames import aim_direction
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.pointing import turn_rays
from sim2vr_harness.policies.hierarchical.ray_turning import REFERENCE_M
from sim2vr_harness.training.motor_control.human_benchmark import (
    AimedCourse,
    AimedMovements,
    HumanMeasures,
)
from sim2vr_harness.training.motor_control.person_course import FloatArray, one_by_one

DISTANCES_DEG, WIDTHS_DEG = (5.0, 15.0, 40.0), (1.5, 3.0, 6.0)
"""Nine indices of difficulty, 0.9 to 4.8 bits."""
_FAR_M, _LEFT_DEG, _UP_DEG = (1.0, 3.0), (-35.0, 35.0), (-25.0, 20.0)
"""Places of targets from the head."""
_SETTLE_S, _REST_DEG, _DRAWN = 1.5, 3.0, 512
_OTHERWISE_DEG = 5.0
"""A ray that far off at the end is not on its way: it is stuck."""
_NAMES = (
    "fitts_slope_s_per_bit",
    "fitts_intercept_s",
    "fitts_r2",
    "error_rate",
    "unended_rate",
    "throughput_bits_per_s",
    "peak_over_mean",
    "time_of_peak",
    "straightness",
    "reaction_s",
)


@dataclass(frozen=True)
class RayMeasures:
    """Turned rays at nine indices of difficulty.

    Attributes:
        movements: of the rays' directions.
        off_rad: (K,) how far each ray was off its target 2 s after this appeared.
    """

    movements: HumanMeasures
    off_rad: tuple[FloatArray, ...]

    def summary(self) -> dict[str, float]:
        """Return the measures by name with unit."""
        found, cells = self.movements.summary(), self.movements.cells
        off = np.concatenate(self.off_rad)
        on = [away <= 0.5 * cell.width_m for away, cell in zip(self.off_rad, cells, strict=True)]
        return {
            **{f"ray_{name}": found[name] for name in _NAMES},
            "ray_on_target": float(np.mean(on)),
            "ray_off_deg": float(np.degrees(np.median(off))),
            "ray_stuck_rate": float((np.degrees(off) > _OTHERWISE_DEG).mean()),
        }

    def rows(self) -> list[str]:
        """Return a line per index of difficulty, for people."""
        return [
            f"{cell.difficulty:.2f} bits (ray, {np.degrees(cell.distance_m):.0f} degrees, width "
            f"{np.degrees(cell.width_m):.1f} degrees): {np.nanmean(cell.time_s):.2f} s, "
            f"{cell.missed.mean():.2f} missed, end points spread "
            f"{np.degrees(cell.spread_m):.1f} degrees"
            for cell in self.movements.cells
        ]


def measure_rays(
    policy: HumanMotorPolicy,
    user: UserConfig,
    *,
    persons: int = 12,
    repeats: int = 4,
    threads: int = 0,
    seed: int = 1,
    on_progress: Callable[[float], None] = lambda share: None,
) -> RayMeasures:
    """Measure rays that persons turn that no training has had.

    Args:
        policy: what moves them.
        user: configuration with people.
        persons: number of persons.
        repeats: movements of each to each index of difficulty.
        threads: of the physics; 0: all.
        seed: of persons, places and noise.
        on_progress: receives the proportion that is done.
    """
    course = _Rays(policy, user, persons, repeats, threads, seed)
    cells = [partial(course.aim, d, width) for d in DISTANCES_DEG for width in WIDTHS_DEG]
    found, off = zip(*one_by_one(cells, on_progress), strict=True)
    return RayMeasures(HumanMeasures(found), off)


class _Rays(AimedCourse):
    """Persons that turn their rays from one place to the next, without a new posture."""

    stream = 96

    def __init__(self, *course: Any) -> None:
        super().__init__(*course)
        middle = self._bodies.body.joint_ranges.mean(1)
        self._reset([middle] * self._n, self._rng.integers(2**31, size=self._n))

    def aim(self, distance_deg: float, width_deg: float) -> tuple[AimedMovements, FloatArray]:
        """Let everyone settle on a place, and aim at another one; (N,) rad off after 2 s."""
        start, goal = self._directions(np.radians(distance_deg))
        far = self._rng.uniform(*_FAR_M, (self._n, 1))
        first = self._bodies.users.device_poses("headset")[0] + far * start
        distance, width = np.radians(distance_deg), np.radians(width_deg)
        self._settle(first, float(np.radians(_REST_DEG)), _SETTLE_S)
        hand = self._poses()[0]
        way = first - hand
        seen = way / np.linalg.norm(way, axis=1, keepdims=True)
        onwards = _across(seen, goal)
        then = np.cos(distance) * seen + np.sin(distance) * onwards
        place = hand + np.linalg.norm(way, axis=1, keepdims=True) * then
        path, ended, end = self._follow(place, width, whole=True)
        off = np.linalg.norm(path[:, -1], axis=1)
        return self._measured((path, ended, end), float(distance), float(width)), off

    def _directions(self, distance: float) -> tuple[FloatArray, FloatArray]:
        """(N, 3) directions from the head of starts, and of targets at a distance, rad."""
        low, high = np.radians(np.array([_LEFT_DEG, _UP_DEG]).T)
        starts, goals = np.empty((2, self._n, 3))
        for i in range(self._n):
            left, up = self._rng.uniform(low, high, (_DRAWN, 2)).T
            start = np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)], 1)
            across = _across(start, self._rng.standard_normal(start.shape))
            goal = np.cos(distance) * start + np.sin(distance) * across
            angles = np.stack([np.arctan2(goal[:, 1], goal[:, 0]), np.arcsin(goal[:, 2])], 1)
            first = np.flatnonzero(((angles > low) & (angles < high)).all(1))[0]
            starts[i], goals[i] = start[first], goal[first]
        return starts, goals

    def _wanted(self, place: FloatArray, width: float) -> HumanGoals:
        """Return the goals of this user step; widths are angles, rad."""
        goals, at = super()._wanted(place, width), self._poses()[0]
        far = torch.from_numpy(np.linalg.norm(place - at, axis=1)).float()
        goals.width[:, self._hand] *= far
        hand = torch.zeros(self._n, len(self._policy.hands), 4, 4)
        hand[..., :3, 3] = self._of_hand(at)
        turn_rays(goals, goals.active > 0.0, hand)
        return goals

    def _at(self, place: FloatArray, sample: int = -1) -> FloatArray:
        hand, turned = self._poses(sample)
        way = place - hand
        return aim_direction(turned) - way / np.linalg.norm(way, axis=1, keepdims=True)

    def _far(self, place: FloatArray) -> torch.Tensor:
        return REFERENCE_M * super()._far(place)


def _across(way: FloatArray, other: FloatArray) -> FloatArray:
    """(N, 3) unit vectors at right angles to unit vectors, towards others."""
    beside = other - (other * way).sum(1, keepdims=True) * way
    return beside / np.linalg.norm(beside, axis=1, keepdims=True)
