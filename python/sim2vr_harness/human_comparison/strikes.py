"""Measures of the tool's motion around every hit and between hits."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.human_comparison.grid import PERIOD_S, Track, at
from sim2vr_harness.human_comparison.outcomes import Found

FloatArray = NDArray[np.float64]

_BEFORE_S = 0.5
_AFTER_S = 0.2
_SHORTEST_S, _LONGEST_S = 0.25, 3.0
"""From hit to hit, where the movement between is one: longer ones are pauses."""
_CLOSE_S = 0.1
_SAME_S = 1e-4
_PADDING = 4
_TOP_HZ, _LEAST_POWER = 10.0, 0.05


def hit_speeds(track: Track) -> Found:
    """Speed of the point that the game tests, over the 50 ms up to the last frame before the hit.

    A hit at the time of a frame belongs to the frame before, as its pose was tested. Frames at
    other rates than 20 Hz get the mean delay that frames at 20 Hz would have had, half the
    difference of the periods.
    """
    played, targets, rows = track.played, track.played.targets, track.late_hits
    logged = targets.logged_speed_mps[rows]
    logged = logged[np.isfinite(logged)]
    values: dict[str, float] = {}
    if len(logged):
        values["hit_speed_game"] = float(np.median(logged))
    if len(rows) == 0:
        return values, {"hit_speed": np.zeros(0)}
    times = played.times_s
    delay_s = max(0.0, (PERIOD_S - float(np.median(np.diff(times)))) / 2.0)
    last = np.searchsorted(times, targets.end_s[rows] - _SAME_S) - 1
    end_s = times[last.clip(0)] + delay_s
    moved = at(times, played.root_m, end_s) - at(times, played.root_m, end_s - PERIOD_S)
    speed = np.linalg.norm(moved, axis=1) / PERIOD_S
    for key, part in (("hit_speed", 50), ("hit_speed_p5", 5), ("hit_speed_p95", 95)):
        values[key] = float(np.percentile(speed, part))
    return values, {"hit_speed": speed}


def peaks(track: Track) -> Found:
    """Greatest speed before each hit, and how far the tool swings through after it."""
    targets, rows = track.played.targets, track.late_hits
    peak, peak_late, over = [], [], []
    for row in rows:
        hit_s = targets.end_s[row]
        speed = track.speed_mps[_within(track.between_s, hit_s - _BEFORE_S, hit_s)]
        depth = track.tool_m[_within(track.times_s, hit_s, hit_s + _AFTER_S), 2]
        if len(speed):
            peak.append(speed.max())
            peak_late.append(targets.spawn_s[row] >= track.middle_s)
        if len(depth):
            over.append(depth.max())
    top, late = np.array(peak), np.array(peak_late, dtype=np.bool_)
    values: dict[str, float] = {}
    if len(top):
        values["peak_speed"] = float(np.median(top))
        values["peak_speed_cv"] = float(top.std() / top.mean())
    if 0 < late.sum() < len(top):
        values["d_peak_speed"] = float(np.median(top[late]) / np.median(top[~late]) - 1.0)
    if over:
        values["overshoot"] = float(np.median(over))
    return values, {"peak_speed": top, "overshoot": np.array(over)}


def endpoints(track: Track) -> Found:
    """Where in the plane the tool was nearest to its target's middle, around each hit.

    The nearest point of the straight lines between the positions of the grid, within 0.1 s.
    """
    targets, rows, times = track.played.targets, track.late_hits, track.times_s
    off = []
    for row in rows:
        hit_s, middle = targets.end_s[row], np.append(targets.place_m[row], 0.0)
        low, high = max(hit_s - _CLOSE_S, times[0]), min(hit_s + _CLOSE_S, times[-1])
        inner = times[_within(times, low, high)]
        knots = at(times, track.tool_m, np.concatenate([[low], inner, [high]])) - middle
        off.append(_nearest(knots)[:2])
    if not off:
        return {}, {"endpoint": np.zeros(0)}
    apart = np.array(off)
    error = np.linalg.norm(apart, axis=1)
    return {
        "endpoint_error": float(np.median(error)),
        "endpoint_sd": float(np.sqrt(apart.var(axis=0).sum())),
    }, {"endpoint": error}


def _nearest(knots: FloatArray) -> FloatArray:
    """The point nearest to the origin on the straight lines between points (K, 3)."""
    start, step = knots[:-1], np.diff(knots, axis=0)
    length = np.sum(step**2, axis=1)
    part = -np.sum(start * step, axis=1) / np.where(length > 0.0, length, 1.0)
    points = start + part.clip(0.0, 1.0)[:, None] * step
    return np.asarray(points[np.argmin(np.sum(points**2, axis=1))])


def between_hits(track: Track) -> Found:
    """Retreat and smoothness from one hit to the next."""
    end_s = track.played.targets.end_s[track.hits_after_settling]
    retreat, arcs, jerks = [], [], []
    for before_s, hit_s in pairwise(end_s):
        if not _SHORTEST_S <= hit_s - before_s <= _LONGEST_S:
            continue
        retreat.append(track.tool_m[_within(track.times_s, before_s, hit_s, closed=True), 2].min())
        moving = _within(track.between_s, before_s, hit_s, closed=True)
        arcs.append(sparc(track.speed_mps[moving]))
        jerks.append(log_jerk(track.velocity_mps[moving]))
    samples = {"retreat": np.array(retreat), "sparc": np.array(arcs), "ldlj": np.array(jerks)}
    samples = {key: sample[np.isfinite(sample)] for key, sample in samples.items()}
    return {key: float(np.median(s)) for key, s in samples.items() if len(s)}, samples


def sparc(speed: FloatArray) -> float:
    """Spectral arc length of a movement: 0 smooth, more negative less.

    Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9: the length of the normalised
    spectrum of speed up to 10 Hz, as far as it is above 5 % of its greatest value.

    Args:
        speed: (N,) on the grid, m/s.
    """
    if len(speed) < 2 or not speed.any():
        return math.nan
    n = int(2 ** (math.ceil(math.log2(len(speed))) + _PADDING))
    rate = np.arange(n) / (n * PERIOD_S)
    size = np.abs(np.fft.fft(speed, n))
    size = size / size.max()
    low = rate <= _TOP_HZ
    rate, size = rate[low], size[low]
    above = np.flatnonzero(size >= _LEAST_POWER)
    rate, size = rate[above[0] : above[-1] + 1], size[above[0] : above[-1] + 1]
    if len(rate) < 2:
        return math.nan
    steps = np.hypot(np.diff(rate) / (rate[-1] - rate[0]), np.diff(size))
    return -float(steps.sum())


def log_jerk(velocity: FloatArray) -> float:
    """Log dimensionless jerk of a movement's velocity (N, 3); higher is smoother."""
    if len(velocity) < 4:
        return math.nan
    jerk = np.diff(velocity, 2, axis=0) / PERIOD_S**2
    lasting = (len(velocity) - 1) * PERIOD_S
    peak = float(np.linalg.norm(velocity, axis=1).max())
    total = float((jerk**2).sum() * PERIOD_S)
    if peak <= 0.0 or total <= 0.0:
        return math.nan
    return -math.log(lasting**3 / peak**2 * total)


def _within(times: FloatArray, low: float, high: float, *, closed: bool = True) -> slice:
    """The part of ascending times in [low, high]."""
    first = int(np.searchsorted(times, low, side="left"))
    return slice(first, int(np.searchsorted(times, high, side="right" if closed else "left")))
