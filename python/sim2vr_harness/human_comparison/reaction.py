"""Reaction and movement times to a target that appears alone.

Times are counted from the spawn, on a grid that starts there and contains the 20 Hz frames.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.human_comparison.grid import (
    PERIOD_S,
    STILL_MPS,
    Found,
    Track,
    at,
    first_crossing,
)

FloatArray = NDArray[np.float64]

_FIRST, _LAST = -6, 16
"""Grid points before and after the spawn: 0.3 and 0.8 s."""
_AT_SPAWN = -_FIRST
EARLY_S = 0.1
"""A strike that begins sooner after the spawn was launched before the target can be seen."""
_STRIKE_S = 0.3
_ONSET_SHARE = 0.2
_MOVING_MPS = 0.2
_LEAST_TARGETS = 12
"""For an effect of the place: nine numbers are fitted."""


@dataclass(frozen=True)
class Effect:
    """Data from which the effect of the targets' positions on velocity is estimated; M targets.

    Attributes:
        place_m: (M, 2) positions of the targets in the plane.
        tool_m: (M, 3) position of the tool at the spawn.
        before_mps: (M, 3) its velocity in the 50 ms before.
        velocity_mps: (M, K, 2) its velocity in the plane, from 0.3 s before to 0.8 s after.
    """

    place_m: FloatArray
    tool_m: FloatArray
    before_mps: FloatArray
    velocity_mps: FloatArray

    @staticmethod
    def times_s() -> FloatArray:
        """(K,) the velocities' times after the spawn."""
        return _middles(_LAST)

    def curve(self) -> FloatArray | None:
        """Effect of a target's place on velocity towards it, (K,), m/s per m; None for few targets.

        Regression of the velocity on the place, along x and along y (their mean), with the position
        and the velocity of the tool at the spawn as covariates: cells are drawn at random, so that
        only having seen the target causes an effect.
        """
        m = len(self.place_m)
        if m < _LEAST_TARGETS:
            return None
        known = np.hstack([self.place_m, self.tool_m, self.before_mps, np.ones((m, 1))])
        fitted = np.linalg.lstsq(known, self.velocity_mps.reshape(m, -1), rcond=None)[0]
        slopes = fitted[:2].reshape(2, -1, 2)
        return np.asarray((slopes[0, :, 0] + slopes[1, :, 1]) / 2.0)


def _middles(last: int) -> FloatArray:
    """Return times of the velocities up to a point of the grid."""
    return np.asarray((np.arange(_FIRST, last, dtype=np.float64) + 0.5) * PERIOD_S)


def effects(parts: list[Effect]) -> dict[str, float]:
    """Visuomotor latency of all targets of a person: when the effect rises to 10 % and 50 %."""
    curve = effect_of(parts).curve() if parts else None
    if curve is None or not np.isfinite(curve).all():
        return {}
    peak = int(np.argmax(curve))
    if curve[peak] <= 0.0:
        return {}
    times = Effect.times_s()
    return {
        "vm_latency": first_crossing(times, curve, peak, 0.1),
        "vm_latency50": first_crossing(times, curve, peak, 0.5),
    }


def effect_of(parts: list[Effect]) -> Effect:
    """All targets of several rounds as one."""
    return Effect(
        *(
            np.concatenate([getattr(part, key) for part in parts])
            for key in ("place_m", "tool_m", "before_mps", "velocity_mps")
        )
    )


def reaction(track: Track) -> tuple[Found, Effect]:
    """Return measures of single targets, and the data for the effect of their positions."""
    played, targets = track.played, track.played.targets
    late = np.flatnonzero(targets.spawn_s >= track.first_s)
    spawn_s = targets.spawn_s[late]
    grid = spawn_s[:, None] + np.arange(_FIRST, _LAST + 1) * PERIOD_S
    tool = at(played.times_s, played.tool_m, grid)  # (M, K + 1, 3)
    velocity = np.diff(tool, axis=1) / PERIOD_S
    whole = grid[:, -1] <= played.times_s[-1]
    start = tool[:, _AT_SPAWN]
    before = velocity[:, _AT_SPAWN - 1]
    effect = Effect(
        targets.place_m[late][whole], start[whole], before[whole], velocity[whole][:, :, :2]
    )
    speed = np.linalg.norm(before, axis=1)
    samples = {
        "speed_at_spawn": speed,
        "forward_at_spawn": before[:, 2],
        "depth_at_spawn": start[:, 2],
        **_strikes(track, late[targets.hit[late]]),
    }
    values = {key: float(np.median(sample)) for key, sample in samples.items() if len(sample)}
    values.pop("rt_still", None)  # of all rounds together
    if len(speed):
        values["still_at_spawn"] = float(np.mean(speed < STILL_MPS))
    if len(samples["strike_onset"]):
        values["strike_early"] = float(np.mean(samples["strike_onset"] < EARLY_S))
    hit = targets.hit[late]
    apart = np.linalg.norm(start[hit, :2] - targets.place_m[late][hit], axis=1)
    tth = targets.end_s[late][hit] - spawn_s[hit]
    if len(tth) > 2 and np.ptp(apart) > 0.0:
        values["fitts_slope"] = float(np.polyfit(apart, tth, 1)[0])
    return (values, samples), effect


def _strikes(track: Track, rows: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return onsets and durations of strikes at hit targets, and reaction times from stillness."""
    played, targets = track.played, track.played.targets
    onset, lasting, still = [], [], []
    for row in rows:
        spawn_s, hit_s = targets.spawn_s[row], targets.end_s[row]
        steps = np.arange(_FIRST, int(np.floor((hit_s - spawn_s) / PERIOD_S + 1e-4)) + 1)
        tool = at(played.times_s, played.tool_m, spawn_s + steps * PERIOD_S)
        times = _middles(int(steps[-1]))
        toward = np.append(targets.place_m[row], 0.0) - tool
        velocity = np.diff(tool, axis=0) / PERIOD_S
        middle = (toward[1:] + toward[:-1]) / 2.0
        distance = np.linalg.norm(middle, axis=1)
        approach = np.sum(velocity * middle, axis=1) / np.where(distance > 0.0, distance, 1.0)
        near = np.flatnonzero(times >= hit_s - spawn_s - _STRIKE_S)
        if len(near):
            peak = int(near[np.argmax(approach[near])])
            if approach[peak] > 0.0:
                onset.append(first_crossing(times, approach, peak, _ONSET_SHARE))
                lasting.append(hit_s - spawn_s - onset[-1])
        speed = np.linalg.norm(velocity[_AT_SPAWN - 2 : _AT_SPAWN], axis=1)
        if (speed < STILL_MPS).all():
            still += _began(times, -np.diff(np.linalg.norm(toward, axis=1)) / PERIOD_S)
    return {
        "strike_onset": np.array(onset),
        "strike_time": np.array(lasting),
        "rt_still": np.array(still),
    }


def _began(times: FloatArray, approach: FloatArray) -> list[float]:
    """Return when the tool first approached at more than 0.2 m/s after the spawn, if it did."""
    moving = np.flatnonzero((times > 0.0) & (approach > _MOVING_MPS))
    if not len(moving):
        return []
    k = int(moving[0])
    if approach[k - 1] >= _MOVING_MPS:
        return [float(times[k - 1])]
    part = (_MOVING_MPS - approach[k - 1]) / (approach[k] - approach[k - 1])
    return [float(times[k - 1] + part * PERIOD_S)]
