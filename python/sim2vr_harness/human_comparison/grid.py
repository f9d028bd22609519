"""Positions on an even grid of time, and values computed from them.

Every user is measured at the same rate, whatever frames were logged: at 20 Hz, the rate of the
study's simulated users. Velocities are differences of neighbouring positions.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.human_comparison.rounds import PlayedRound

FloatArray = NDArray[np.float64]

Found = tuple[dict[str, float], dict[str, FloatArray]]
"""Values, and the samples that some of them are of."""

PERIOD_S = 0.05
SETTLING_S = 2.0
"""Left out at the beginning of a round, except in counts: simulated arms start hanging down."""
STILL_MPS = 0.3
"""Slower, the tool is still."""
_TINY_S = 1e-9


def at(times_s: FloatArray, values: FloatArray, when_s: FloatArray) -> FloatArray:
    """Interpolate values (N, K) of times (N,) linearly at other times (...); return (..., K)."""
    columns = [np.interp(when_s, times_s, values[:, k]) for k in range(values.shape[1])]
    return np.stack(columns, axis=-1)


def angle_deg(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angle between rotations, unit quaternions (..., 4), degrees."""
    same = np.abs(np.sum(one * other, axis=-1)).clip(0.0, 1.0)
    return np.asarray(np.degrees(2.0 * np.arccos(same)))


def first_crossing(times: FloatArray, values: FloatArray, peak: int, share: float) -> float:
    """Return the last time before the peak at which values rose through a share of it.

    Values between samples are interpolated linearly. If they never did, the first time is returned.

    Args:
        times: (N,).
        values: (N,), positive at the peak.
        peak: Index of the peak.
        share: Of the peak's value.
    """
    level = share * values[peak]
    below = np.flatnonzero(values[:peak] < level)
    if not len(below):
        return float(times[0])
    k = below[-1]
    part = (level - values[k]) / (values[k + 1] - values[k])
    return float(times[k] + part * (times[k + 1] - times[k]))


@dataclass(frozen=True)
class Track:
    """A round on the grid that starts with its first frame of play, settled.

    Attributes:
        played: The round.
    """

    played: PlayedRound

    @property
    def first_s(self) -> float:
        """Time at which measuring begins."""
        return float(self.played.times_s[0]) + SETTLING_S

    @property
    def middle_s(self) -> float:
        """Time at which the second half of the measured period begins."""
        return (self.first_s + float(self.played.times_s[-1])) / 2.0

    @cached_property
    def times_s(self) -> FloatArray:
        """(G,) the grid."""
        times = self.played.times_s
        grid = np.arange(times[0], times[-1] + _TINY_S, PERIOD_S)
        return grid[grid >= self.first_s - _TINY_S]

    @cached_property
    def between_s(self) -> FloatArray:
        """(G - 1,) the middles, where velocities belong."""
        return np.asarray((self.times_s[1:] + self.times_s[:-1]) / 2.0)

    @cached_property
    def tool_m(self) -> FloatArray:
        """(G, 3) the tool in the plane's frame."""
        return at(self.played.times_s, self.played.tool_m, self.times_s)

    @cached_property
    def velocity_mps(self) -> FloatArray:
        """(G - 1, 3) of the tool."""
        return np.asarray(np.diff(self.tool_m, axis=0) / PERIOD_S)

    @cached_property
    def speed_mps(self) -> FloatArray:
        """(G - 1,) of the tool."""
        return np.asarray(np.linalg.norm(self.velocity_mps, axis=1))

    def root_m(self) -> FloatArray:
        """(G, 3) the point whose speed the game tests, in the plane's frame."""
        return at(self.played.times_s, self.played.root_m, self.times_s)

    def head_m(self) -> FloatArray:
        """(G, 3) the head, app's world."""
        return at(self.played.times_s, self.played.head[:, :3], self.times_s)

    def turns(self, quaternions: FloatArray) -> FloatArray:
        """(G, 4) rotations of the frames (N, 4) on the grid, normalised."""
        steps = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
        sign = np.cumprod(np.concatenate([[1.0], np.where(steps < 0, -1.0, 1.0)]))
        found = at(self.played.times_s, quaternions * sign[:, None], self.times_s)
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    @cached_property
    def late_hits(self) -> NDArray[np.int64]:
        """(H,) hit targets that came up after settling, in the order of the hits."""
        targets = self.played.targets
        return self._by_end(targets.hit & (targets.spawn_s >= self.first_s))

    @cached_property
    def hits_after_settling(self) -> NDArray[np.int64]:
        """(H,) targets that were hit after settling, in the order of the hits."""
        targets = self.played.targets
        return self._by_end(targets.hit & (targets.end_s >= self.first_s))

    def _by_end(self, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
        rows = np.flatnonzero(chosen)
        return rows[np.argsort(self.played.targets.end_s[rows], kind="stable")]
