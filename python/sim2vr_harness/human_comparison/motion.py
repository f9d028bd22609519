"""Measures of a round's movements, independent of their targets."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, welch

from sim2vr_harness.human_comparison.grid import PERIOD_S, Track, angle_deg
from sim2vr_harness.human_comparison.outcomes import Found, robust_cv

__all__ = ["head", "rotations", "smoothness", "space", "speeds", "swings"]

FloatArray = NDArray[np.float64]

STILL_MPS = 0.3
_PROMINENCE_MPS = 0.2
_FAST_SHAKING_HZ = 4.0
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


def _turning(turns: FloatArray, name: str) -> dict[str, float]:
    """Angle from the mean rotation (95 %), degrees, and mean angular speed, degrees/s."""
    # The mean of unit quaternions whatever their signs: the first axis of their scatter.
    mean = np.linalg.eigh(turns.T @ turns)[1][:, -1]
    steps = angle_deg(turns[1:], turns[:-1])
    return {
        f"{name}_p95": float(np.percentile(angle_deg(turns, mean), 95)),
        f"{name}_speed": float(steps.mean() / PERIOD_S),
    }
