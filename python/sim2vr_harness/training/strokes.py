"""A script that strikes targets: go in front of one, thrust through it, go to the next.

It knows the game's privileged numbers and says how the hand shall accelerate;
users/joint_drive.py finds the muscles for it. Its numbers, one set for each placement of the
targets, were found by trying (tools/dev/find_strokes.py). It has no memory: what it does depends on
the present numbers alone, so that a student can imitate it and a policy can learn to correct it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.training.teacher_config import StrokeConfig

__all__ = ["Fields", "Strokes", "vectors"]

FloatArray = NDArray[np.float64]

_CELLS = 9
_LATE = 5.0
"""Cost of a target that can hardly be reached in time: any other is preferred."""
_UNDER_WAY_MPS = 0.3
"""Strike speed from which a stroke is under way, and is not given up lightly."""


class Fields(Protocol):
    """A game's privileged numbers."""

    def field(self, name: str) -> NDArray[np.float32]:
        """(N,) the present values of one."""


def vectors(fields: Fields, name: str, unit: str = "_m") -> FloatArray:
    """(N, 3) three privileged numbers, along the app's axes."""
    axes = [fields.field(f"{name}{axis}{unit}") for axis in "xyz"]
    return np.stack(axes, axis=1).astype(float)


class Strokes:
    """The script for N users.

    Args:
        fields: the game's privileged numbers.
        config: privileged number that is 1 at a placement -> the script's numbers there.
    """

    def __init__(self, fields: Fields, config: Mapping[str, StrokeConfig]) -> None:
        self._fields = fields
        self._flags = tuple(config)
        names = [name for name in StrokeConfig.model_fields if name != "posture_rad"]
        self._tables = {
            name: np.array([getattr(each, name) for each in config.values()]) for name in names
        }
        self._postures = np.array([each.posture_rad for each in config.values()])

    def _placements(self) -> FloatArray:
        """(N, placements) 1 where a user plays."""
        return np.stack([self._fields.field(flag) for flag in self._flags], axis=1).astype(float)

    def joints_radps2(self, angles: FloatArray, speeds: FloatArray) -> FloatArray:
        """(N, J) what the independent joints shall do beside: be drawn to the posture, and be slow.

        Args:
            angles: (N, J) rad.
            speeds: (N, J) rad/s.
        """
        where = self._placements()
        stiffness = where @ self._tables["posture_stiffness_per_s2"]
        damping = where @ self._tables["joint_damping_per_s"]
        drawn = stiffness[:, None] * (where @ self._postures - angles)
        return drawn - damping[:, None] * speeds

    def hand_mps2(self) -> FloatArray:
        """(N, 3) how the hand shall accelerate, the app's axes."""
        where = self._placements()
        p = {name: (where @ table)[:, None] for name, table in self._tables.items()}
        forward = np.where(self._fields.field("round.low")[:, None] > 0.0, [0, -1, 0], [0, 0, 1])
        velocity = vectors(self._fields, "hammer.v", "_mps")
        strike = (velocity * forward).sum(axis=1, keepdims=True)
        there, target = self._chosen(p, velocity)
        along = (target * forward).sum(axis=1, keepdims=True)
        beside = target - along * forward
        off = np.linalg.norm(beside, axis=1, keepdims=True)
        aligned = off < p["lateral_m"] + p["lateral_under_way_m"] * (strike > _UNDER_WAY_MPS)
        begun = (strike > _UNDER_WAY_MPS) & (along > -p["follow_through_m"])
        striking = aligned & ((along > p["begin_m"]) | begun)
        approach = (
            p["approach_per_s2"] * (target - p["run_up_m"] * forward)
            - p["approach_damping_per_s"] * velocity
        )
        stroke = (
            p["stroke_per_s"] * (p["stroke_mps"] - strike) * forward
            + p["steering_per_s2"] * beside
            - p["approach_damping_per_s"] * (velocity - strike * forward)
        )
        home = 0.5 * p["approach_per_s2"] * vectors(self._fields, "aid.home_")
        waiting = home - p["approach_damping_per_s"] * velocity
        wanted = np.where(there[:, None], np.where(striking, stroke, approach), waiting)
        return np.clip(wanted, -p["greatest_mps2"], p["greatest_mps2"])

    def _chosen(
        self, p: Mapping[str, FloatArray], velocity: FloatArray
    ) -> tuple[NDArray[np.bool_], FloatArray]:
        """Whether there is a target to go for, (N,), and where from the marker, (N, 3) m."""
        places = np.stack([vectors(self._fields, f"cell{cell}.") for cell in range(_CELLS)], axis=1)
        present, life = (
            np.stack([self._fields.field(f"cell{cell}.{name}") for cell in range(_CELLS)], axis=1)
            for name in ("present", "life_s")
        )
        distance = np.linalg.norm(places, axis=2)
        needed = p["least_life_s"] + p["life_s_per_m"] * np.maximum(distance - 0.1, 0.0)
        closing = np.einsum("ncx,nx->nc", places, velocity) / np.maximum(distance, 0.05)
        cost = (
            p["cost_per_m"] * distance
            + p["cost_per_s"] * life
            - p["cost_per_mps"] * closing
            + _LATE * (life < needed)
        )
        cost = np.where(present > 0.0, cost, np.inf)
        chosen = cost.argmin(axis=1)
        rows = np.arange(len(chosen))
        return np.isfinite(cost[rows, chosen]), places[rows, chosen]
