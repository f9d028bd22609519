"""Measures of a round's events, and of the choice among several targets."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.human_comparison.grid import Track, at

FloatArray = NDArray[np.float64]
Found = tuple[dict[str, float], dict[str, FloatArray]]
"""Values, and the samples that some of them are of."""

_FAST_S = 0.25
_IQR_OF_NORMAL = 1.349


def robust_cv(values: FloatArray) -> float:
    """Interquartile range / 1.349 / median: the coefficient of variation of a normal sample."""
    if len(values) == 0:
        return math.nan
    low, middle, high = np.percentile(values, [25, 50, 75])
    return float((high - low) / _IQR_OF_NORMAL / middle)


def counts(track: Track) -> Found:
    """Hits, misses and contacts of the whole round."""
    played, targets = track.played, track.played.targets
    hits, misses = int(targets.hit.sum()), int(targets.missed.sum())
    first = targets.spawn_s < track.middle_s
    late = targets.spawn_s >= track.first_s
    rates = [
        _rate(int(targets.hit[part].sum()), int(targets.missed[part].sum()))
        for part in (first & late, ~first & late)
    ]
    return {
        "hits": float(hits),
        "misses": float(misses),
        "hit_rate": _rate(hits, misses),
        "contacts_per_hit": played.contacts / max(hits, 1),
        "d_hit_rate": rates[1] - rates[0],
    }, {}


def _rate(hits: int, misses: int) -> float:
    return hits / (hits + misses) if hits + misses else math.nan


def timing(track: Track) -> Found:
    """From spawns to hits, and from hit to hit."""
    targets, rows = track.played.targets, track.late_hits
    tth = targets.end_s[rows] - targets.spawn_s[rows]
    ihi = np.diff(targets.end_s[track.hits_after_settling])
    samples = {"tth": tth, "ihi": ihi}
    if len(tth) == 0:
        return {}, samples
    p5, p25, p50, p75, p95 = np.percentile(tth, [5, 25, 50, 75, 95])
    late = targets.spawn_s[rows] >= track.middle_s
    values = {
        "tth_median": p50,
        "tth_p5": p5,
        "tth_p95": p95,
        "tth_iqr": p75 - p25,
        "fast_hits": np.mean(tth <= _FAST_S),
        "d_tth": np.median(tth[late]) - np.median(tth[~late])
        if 0 < late.sum() < len(tth)
        else None,
        "ihi_median": np.median(ihi) if len(ihi) else None,
        "ihi_cv": robust_cv(ihi),
    }
    return {key: float(value) for key, value in values.items() if value is not None}, samples


def choices(track: Track, alive_after_s: float) -> Found:
    """Which target is taken where two or more are up.

    Those up have been alive for some time and are not over when the hit comes; the nearest is
    nearest to where the tool was at the hit before.

    Args:
        track: The round.
        alive_after_s: After this long a target can be hit.
    """
    played, targets = track.played, track.played.targets
    rows, rest = track.hits_after_settling, []
    places = at(played.times_s, played.tool_m[:, :2], targets.end_s[rows])
    for before, row in enumerate(rows[1:]):
        hit_s = targets.end_s[row]
        up = targets.spawn_s <= hit_s - alive_after_s
        up &= ~(targets.end_s < hit_s)  # NaN: still there when the round ends
        if up.sum() < 2 or not up[row]:
            continue
        far = np.linalg.norm(targets.place_m - places[before], axis=1)
        oldest = targets.spawn_s[row] <= targets.spawn_s[up].min()
        nearest = far[row] <= far[up].min()
        rest.append((oldest, nearest, 1.0 / up.sum()))
    hits = int(targets.hit.sum())
    values = {"choices_share": len(rest) / hits} if hits else {}
    if rest:
        oldest_share, nearest_share, chance = np.mean(np.array(rest, dtype=np.float64), axis=0)
        values["oldest_first"] = float((oldest_share - chance) / (1.0 - chance))
        values["nearest_first"] = float((nearest_share - chance) / (1.0 - chance))
    return values, {}
