"""Measures of a round's movements, independent of their targets."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, welch

from sim2vr_harness.human_comparison.grid import PERIOD_S, Track, angle_deg, at
from sim2vr_harness.human_comparison.outcomes import Found, robust_cv
from sim2vr_harness.human_comparison.strikes import log_jerk

FloatArray = NDArray[np.float64]

STILL_MPS = 0.3
_PROMINENCE_MPS = 0.2
_FAST_SHAKING_HZ = 4.0
_MOVING_MPS, _MOVING_PART, _MOVING_STEPS = 0.1, 0.1, 2
"""A movement is faster, also than this part of the 95 % speed, for that many steps."""
_SEGMENT = 128
"""Velocities in a segment of the power spectrum (Welch), 6.4 s."""


def speeds(track: Track) -> Found:
    """How fast the tool is."""
    speed = track.speed_mps
    late = track.between_s >= track.middle_s
    return {
        "mean_speed": float(speed.mean()),
        "speed_p95": float(np.percentile(speed, 95)),
        "slow_share": float(np.mean(speed < STILL_MPS)),
        "d_mean_speed": float(speed[late].mean() / speed[~late].mean() - 1.0),
    }, {"speed": speed}


def space(track: Track) -> Found:
    """Where the tool is, and how far it goes."""
    tool = track.tool_m
    depth = tool[:, 2]
    p5, p50, p95 = np.percentile(depth, [5, 50, 95])
    low, high = np.percentile(tool[:, :2], [5, 95], axis=0)
    late = track.times_s >= track.middle_s
    path = track.speed_mps.sum() * PERIOD_S
    root = np.linalg.norm(np.diff(track.root_m(), axis=0), axis=1).sum()
    hits = len(track.hits_after_settling)
    return {
        "depth_median": float(p50),
        "depth_p5": float(p5),
        "depth_p95": float(p95),
        "d_depth": float(np.median(depth[late]) - np.median(depth[~late])),
        "range_x": float(high[0] - low[0]),
        "range_y": float(high[1] - low[1]),
        "path_per_hit": float(path / hits) if hits else math.nan,
        "wrist_ratio": float(path / root) if root > 0.0 else math.nan,
    }, {"depth": depth}


def smoothness(track: Track) -> Found:
    """Peaks, acceleration and fast shaking of the whole round; hit to hit see strikes."""
    velocity = track.velocity_mps
    acceleration = np.diff(velocity, axis=0) / PERIOD_S
    rate, power = welch(velocity, 1.0 / PERIOD_S, nperseg=min(_SEGMENT, len(velocity)), axis=0)
    power = power.sum(axis=1)
    hits = len(track.hits_after_settling)
    peaks = len(find_peaks(track.speed_mps, prominence=_PROMINENCE_MPS)[0])
    return {
        "peaks_per_hit": peaks / hits if hits else math.nan,
        "rms_acc": float(np.sqrt(np.mean(np.sum(acceleration**2, axis=1)))),
        "hf_share": float(power[rate > _FAST_SHAKING_HZ].sum() / power.sum())
        if power.sum() > 0.0
        else math.nan,
    }, {}


def swings(track: Track) -> Found:
    """Passages of the tool through the plane, away from the player."""
    depth, hits = track.tool_m[:, 2], len(track.hits_after_settling)
    through = np.flatnonzero((depth[:-1] < 0.0) & (depth[1:] >= 0.0))
    part = -depth[through] / (depth[through + 1] - depth[through])
    apart = np.diff(track.times_s[through] + part * PERIOD_S)
    return {
        "swings_per_hit": len(through) / hits if hits else math.nan,
        "swing_cv": robust_cv(apart),
    }, {}


def rotations(track: Track) -> Found:
    """How the controller turns."""
    return _turning(track.turns(track.played.controller), "ctrl_rot"), {}


def head(track: Track) -> Found:
    """How the head moves and turns."""
    places = track.head_m()
    low, high = np.percentile(places, [5, 95], axis=0)
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return {
        "head_range": float(np.linalg.norm(high - low)),
        "head_speed": float(moved.mean() / PERIOD_S),
        **_turning(track.turns(track.played.head[:, 3:]), "head_rot"),
    }, {}


def hands(track: Track) -> Found:
    """Measures of a session that need no knowledge of its app."""
    played, velocity = track.played, track.velocity_mps
    minutes = len(velocity) * PERIOD_S / 60.0
    jerk = np.diff(velocity, 2, axis=0) / PERIOD_S**2
    low, high = np.percentile(track.tool_m[:, 2], [5, 95])
    away = np.linalg.norm(played.tool_m - (played.head[:, :3] - played.head[0, :3]), axis=1)
    fast_mps = max(_MOVING_MPS, _MOVING_PART * float(np.percentile(track.speed_mps, 95)))
    movements = _movements(track.speed_mps, fast_mps)
    times = np.array([PERIOD_S * (end - start) for start, end in movements])
    jerks = np.array([log_jerk(velocity[start:end]) for start, end in movements])
    values = {
        "duration": float(played.times_s[-1] - played.times_s[0]),
        "first_movement": _first_movement(played.times_s, played.tool_m),
        "movements_per_min": len(movements) / minutes,
        "top_speed": float(np.percentile(track.speed_mps, 99)),
        "path_per_min": float(track.speed_mps.sum() * PERIOD_S / minutes),
        "range_z": float(high - low),
        "reach_p95": float(np.percentile(away, 95)),
        "rms_jerk": float(np.sqrt(np.mean(np.sum(jerk**2, axis=1)))),
    }
    samples = {"movement_time": times, "movement_ldlj": jerks[np.isfinite(jerks)]}
    values |= {name: float(np.median(sample)) for name, sample in samples.items() if len(sample)}
    hand = track.speed_mps.sum() * PERIOD_S
    for name, points, unit in (
        ("wrist_share", played.ahead_m, hand),
        ("other_path_per_min", played.other_m, minutes),
    ):
        if points is not None and unit > 0.0:
            values[name] = float(_path_m(at(played.times_s, points, track.times_s)) / unit)
    return values, samples


def _path_m(points: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _movements(speed: FloatArray, fast_mps: float = _MOVING_MPS) -> list[tuple[int, int]]:
    """Ranges of steps in which the hand is fast for long enough."""
    fast = np.concatenate([[False], speed > fast_mps, [False]])
    edges = np.flatnonzero(fast[1:] != fast[:-1]).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges if b - a >= _MOVING_STEPS]


def _first_movement(times_s: FloatArray, places: FloatArray) -> float:
    """Time of the first movement of the whole round; NaN: there is none."""
    grid = np.arange(times_s[0], times_s[-1], PERIOD_S)
    speed = np.linalg.norm(np.diff(at(times_s, places, grid), axis=0), axis=1) / PERIOD_S
    movements = _movements(speed)
    return movements[0][0] * PERIOD_S if movements else math.nan


def _turning(turns: FloatArray, name: str) -> dict[str, float]:
    """Angle from the mean rotation (95 %), degrees, and mean angular speed, degrees/s."""
    # The mean of unit quaternions whatever their signs: the first axis of their scatter.
    mean = np.linalg.eigh(turns.T @ turns)[1][:, -1]
    steps = angle_deg(turns[1:], turns[:-1])
    return {
        f"{name}_p95": float(np.percentile(angle_deg(turns, mean), 95)),
        f"{name}_speed": float(steps.mean() / PERIOD_S),
    }
