"""Distances of a user's number or sample from people's."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import percentileofscore, wasserstein_distance

FloatArray = NDArray[np.float64]

MOST = 10.0
"""Distances and ratios are cut here: one odd measure must not decide a mean."""


def inside(value: float, people: Sequence[float]) -> bool:
    """Return whether a number lies within the range of people's numbers."""
    return min(people) <= value <= max(people)


def percentile(value: float, people: Sequence[float]) -> float:
    """Return the percentage of people below a number; equal ones count half."""
    return float(percentileofscore(people, value, kind="mean"))


def standard_deviations(value: float, people: Sequence[float]) -> float | None:
    """Return the distance to people's mean in their standard deviations; None if they are alike."""
    spread = float(np.std(people, ddof=1))
    return (value - float(np.mean(people))) / spread if spread > 0.0 else None


def typical(people: Sequence[float]) -> float:
    """Return the mean distance of a person from the mean of the others; needs two or more."""
    x = np.asarray(people, dtype=np.float64)
    others = (x.sum() - x) / (len(x) - 1)
    return float(np.mean(np.abs(x - others)))


def distance(value: float, people: Sequence[float]) -> float:
    """Distance to people's mean in units of what a person has to the others, at most 10."""
    away = abs(value - float(np.mean(people)))
    unit = typical(people)
    if away == 0.0:
        return 0.0
    return min(away / unit, MOST) if unit > 0.0 else MOST


def wasserstein(sample: Sequence[FloatArray], other: Sequence[FloatArray]) -> float:
    """First Wasserstein distance of two groups' samples, each person weighted alike."""
    (a, weight_a), (b, weight_b) = _pooled(sample), _pooled(other)
    return float(wasserstein_distance(a, b, weight_a, weight_b))


def wasserstein_ratio(sample: Sequence[FloatArray], people: Sequence[FloatArray]) -> float:
    """The distance from people's sample, in units of a person's from the others', at most 10."""
    each = [wasserstein([x], _without(people, i)) for i, x in enumerate(people)]
    unit, away = float(np.mean(each)), wasserstein(sample, people)
    if away == 0.0:
        return 0.0
    return min(away / unit, MOST) if unit > 0.0 else MOST


def kolmogorov(sample: Sequence[FloatArray], other: Sequence[FloatArray]) -> float:
    """Largest difference of the two distributions (Kolmogorov-Smirnov), persons weighted alike."""
    (a, weight_a), (b, weight_b) = _pooled(sample), _pooled(other)
    values = np.concatenate([a, b])
    steps = np.concatenate([weight_a, -weight_b])
    order = np.argsort(values, kind="stable")
    total = np.cumsum(steps[order])
    last = np.append(np.diff(values[order]) > 0.0, True)
    return float(np.abs(total[last]).max())


def _pooled(persons: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """All values, and weights that give each person the same; they add up to 1."""
    weights = [np.full(len(x), 1.0 / len(x) / len(persons)) for x in persons]
    return np.concatenate(persons), np.concatenate(weights)


def _without(persons: Sequence[FloatArray], index: int) -> list[FloatArray]:
    return [x for i, x in enumerate(persons) if i != index]
