"""95 % intervals: of means, and of differences that invert a test."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

FloatArray = NDArray[np.float64]
Interval = tuple[float | None, float | None]

CONFIDENCE = 0.95
"""Of intervals."""


def mean_interval(values: FloatArray) -> tuple[float, float] | None:
    """Return the t interval of a mean; None of a single value.

    Args:
        values: (N,) one per unit; of pairs, their differences.
    """
    if len(values) < 2:
        return None
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    found = stats.ttest_1samp(values, 0.0).confidence_interval(CONFIDENCE)
    return float(found.low), float(found.high)


def welch_interval(first: FloatArray, second: FloatArray) -> tuple[float, float]:
    """Return Welch's interval of the difference of two independent samples' means."""
    found = stats.ttest_ind(first, second, equal_var=False).confidence_interval(CONFIDENCE)
    return float(found.low), float(found.high)


class Moments(NamedTuple):
    """Statistics of a sample for a t interval: n >= 2 values, their mean and SD (ddof 1)."""

    mean: float
    sd: float
    n: int


def welch_interval_of_moments(first: Moments, second: Moments) -> tuple[float, float]:
    """Return :func:`welch_interval` of samples whose values were not kept.

    Without any spread, both ends are the difference.
    """
    difference = first.mean - second.mean
    parts = [sample.sd**2 / sample.n for sample in (first, second)]
    if sum(parts) == 0.0:
        return difference, difference
    weights = [
        part**2 / (sample.n - 1) for part, sample in zip(parts, (first, second), strict=True)
    ]
    df = sum(parts) ** 2 / sum(weights)
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, df)) * math.sqrt(sum(parts))
    return difference - half, difference + half


def wilson_interval(successes: int, n: int) -> tuple[float, float]:
    """Return Wilson's interval of a proportion of n independent units, n >= 1."""
    found = stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return float(found.low), float(found.high)


def hodges_lehmann(steps: FloatArray) -> float:
    """Return the estimate of a shift by a rank test: the median of where its p changes."""
    return float(np.median(steps))


def inverted(p_of: Callable[[float], float], steps: FloatArray, p: float) -> Interval:
    """Return the shifts that a rank test does not reject at 5 %.

    Args:
        p_of: p of the test after a shift has been subtracted.
        steps: (M,) sorted shifts at which p changes.
        p: At no shift; ties at 0 must not make the interval disagree with it.

    Returns:
        Its ends; None: no end on that side, because n is too small or the test has one side.
    """
    steps = np.unique(steps)
    between = np.concatenate([[steps[0] - 1.0], (steps[1:] + steps[:-1]) / 2, [steps[-1] + 1.0]])
    kept: dict[int, bool] = {}

    def is_kept(i: int) -> bool:
        if i not in kept:
            kept[i] = p_of(float(between[i])) >= 1.0 - CONFIDENCE
        return kept[i]

    last = len(steps)
    if is_kept(0) and is_kept(last):
        return None, None
    # One-sided tests keep one of the outer shifts, two-sided ones the middle.
    centre = 0 if is_kept(0) else last if is_kept(last) else int(len(steps) / 2)
    low = None if is_kept(0) else float(steps[_first(is_kept, 0, centre) - 1])
    high = None
    if not is_kept(last):
        high = float(steps[_first(lambda i: not is_kept(i), centre, last) - 1])
    # Move an end to 0 where ties at no shift decided p.
    if p >= 1.0 - CONFIDENCE:
        return (None if low is None else min(low, 0.0)), (None if high is None else max(high, 0.0))
    if low is not None and low < 0.0 and (high is None or high > 0.0):
        return (0.0, high) if high is None or -low < high else (low, 0.0)
    if low is None and high is not None and high > 0.0:
        return low, 0.0
    return low, high


def _first(holds: Callable[[int], bool], low: int, high: int) -> int:
    """Return the first index in low < i <= high at which something holds that holds from there."""
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
