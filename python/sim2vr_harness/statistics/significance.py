"""Tests of differences, with their effect sizes; arrays in, plain numbers out.

By SciPy and statsmodels. Every test takes one value per unit and level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

__all__ = [
    "Alternative",
    "bootstrap",
    "friedman",
    "holm",
    "kruskal_wallis",
    "mann_whitney",
    "normality",
    "wilcoxon",
]

FloatArray = NDArray[np.float64]
Alternative = Literal["two-sided", "less", "greater"]

_RESAMPLES = 10_000
_EXACT_UP_TO = 50
"""Pairs; above, the normal approximation is as good."""


def wilcoxon(
    first: FloatArray, second: FloatArray, alternative: Alternative = "two-sided"
) -> dict[str, Any]:
    """Wilcoxon's signed-rank test of pairs.

    Pairs without a difference are left out (Wilcoxon's way), and ties share their ranks. ``z`` and
    ``p_normal`` are the normal approximation without continuity correction, as the SIM2VR paper
    reports it; ``p`` is exact up to 50 pairs, over all signs that the ranks can have.

    Args:
        first: (N,) values of the first level.
        second: (N,) of the same units in the second.
        alternative: ``less``: the first level is less than the second.

    Returns:
        ``statistic`` (sum of the ranks of positive differences), ``z``, ``p``, ``p_normal``,
        ``exact``, ``effect``: the matched-pairs rank-biserial correlation (-1 to 1; Kerby 2014),
        and ``dz``, Cohen's d of the differences.

    Raises:
        ValueError: No pair differs.
    """
    differences = first - second
    unlike = differences[differences != 0.0]
    n = len(unlike)
    if n == 0:
        raise ValueError("no pair differs")
    ranks = stats.rankdata(np.abs(unlike))
    positive = float(ranks[unlike > 0].sum())
    total = n * (n + 1) / 2
    sizes = np.unique(ranks, return_counts=True)[1].astype(float)
    variance = n * (n + 1) * (2 * n + 1) / 24 - float((sizes**3 - sizes).sum()) / 48
    z = (positive - total / 2) / np.sqrt(variance)
    p_normal = _tail(float(z), alternative)
    exact = n <= _EXACT_UP_TO
    spread = float(np.std(differences, ddof=1)) if len(differences) > 1 else 0.0
    return {
        "statistic": positive,
        "z": float(z),
        "p": _exact(ranks, positive, alternative) if exact else p_normal,
        "p_normal": p_normal,
        "exact": exact,
        "effect": 2.0 * positive / total - 1.0,
        "dz": float(differences.mean()) / spread if spread > 0.0 else None,
    }


def _exact(ranks: FloatArray, positive: float, alternative: Alternative) -> float:
    """How probable so great, or small, a sum of ranks is if every sign is a toss-up."""
    doubled = np.rint(2.0 * ranks).astype(int)  # ties have half ranks
    ways = np.zeros(int(doubled.sum()) + 1)
    ways[0] = 1.0
    for rank in doubled.tolist():
        ways[rank:] = ways[rank:] + ways[: len(ways) - rank].copy()
    chances = ways / ways.sum()
    here = round(2.0 * positive)
    less, greater = float(chances[: here + 1].sum()), float(chances[here:].sum())
    if alternative == "two-sided":
        return min(1.0, 2.0 * min(less, greater))
    return less if alternative == "less" else greater


def _tail(z: float, alternative: Alternative) -> float:
    if alternative == "less":
        return float(stats.norm.cdf(z))
    if alternative == "greater":
        return float(stats.norm.sf(z))
    return float(2.0 * stats.norm.sf(abs(z)))


def mann_whitney(
    first: FloatArray, second: FloatArray, alternative: Alternative = "two-sided"
) -> dict[str, Any]:
    """Mann and Whitney's test of two independent samples, such as trainings of two kinds.

    Returns:
        ``statistic`` (U of the first), ``p`` and ``effect``: the rank-biserial correlation, which
        is Cliff's delta.
    """
    found = stats.mannwhitneyu(first, second, alternative=alternative)
    effect = 2.0 * float(found.statistic) / (len(first) * len(second)) - 1.0
    return {"statistic": float(found.statistic), "p": float(found.pvalue), "effect": effect}


def friedman(levels: Sequence[FloatArray]) -> dict[str, Any]:
    """Friedman's test of three or more levels of the same units.

    Returns:
        ``statistic`` (chi square, corrected for ties), ``df``, ``p`` and ``effect``: Kendall's W,
        from 0 (no agreement between units) to 1.

    Raises:
        ValueError: All values of every unit are equal.
    """
    if all(len({float(value) for value in unit}) == 1 for unit in zip(*levels, strict=True)):
        raise ValueError("no unit differs between levels")
    found = stats.friedmanchisquare(*levels)
    n, k = len(levels[0]), len(levels)
    return {
        "statistic": float(found.statistic),
        "df": k - 1,
        "p": float(found.pvalue),
        "effect": float(found.statistic) / (n * (k - 1)),
    }


def kruskal_wallis(levels: Sequence[FloatArray]) -> dict[str, Any]:
    """Kruskal and Wallis' test of three or more independent samples.

    Returns:
        ``statistic`` (H, corrected for ties), ``df``, ``p`` and ``effect``: epsilon squared.

    Raises:
        ValueError: All values are equal.
    """
    found = stats.kruskal(*levels)
    n = sum(map(len, levels))
    return {
        "statistic": float(found.statistic),
        "df": len(levels) - 1,
        "p": float(found.pvalue),
        "effect": float(found.statistic) / (n - 1),
    }


def normality(values: FloatArray) -> dict[str, Any] | None:
    """Kolmogorov-Smirnov's test of whether values are normally distributed.

    Mean and deviation are those of the values; ``p`` accounts for it (Lilliefors 1967).

    Returns:
        ``statistic`` and ``p``; None of fewer than four values, or equal ones.
    """
    if len(values) < 4 or np.ptp(values) == 0.0:
        return None
    from statsmodels.stats.diagnostic import lilliefors

    statistic, p = lilliefors(values, dist="norm", pvalmethod="table")
    return {"statistic": float(statistic), "p": float(p)}


def bootstrap(values: FloatArray, other: FloatArray | None = None) -> tuple[float, float] | None:
    """95 % interval of the mean, or of the difference of two means, by resampling units.

    Percentiles of 10,000 resamples with a fixed seed: the same values are the same interval.

    Args:
        values: (N,) of one sample; of pairs, their differences.
        other: Of an independent second sample, whose mean is subtracted.

    Returns:
        Its ends; None of a single unit.
    """
    if len(values) < 2 or (other is not None and len(other) < 2):
        return None
    rng = np.random.default_rng(20241)
    means = values[rng.integers(len(values), size=(_RESAMPLES, len(values)))].mean(axis=1)
    if other is not None:
        means -= other[rng.integers(len(other), size=(_RESAMPLES, len(other)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def holm(p_values: Sequence[float]) -> list[float]:
    """P values that account for how many there are (Holm 1979), in the same order."""
    m = len(p_values)
    adjusted = [0.0] * m
    highest = 0.0
    for rank, i in enumerate(sorted(range(m), key=lambda i: p_values[i])):
        highest = max(highest, min(1.0, (m - rank) * p_values[i]))
        adjusted[i] = highest
    return adjusted
