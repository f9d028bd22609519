"""Tests of differences, with their effect sizes; arrays in, plain numbers out.

By SciPy and statsmodels. Every test takes one value per unit and level. A test of two levels also
has the ``interval`` of the difference that inverts it: it excludes 0 where p is below 0.05.
"""

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from sim2vr_harness.statistics.intervals import CONFIDENCE, hodges_lehmann, inverted

FloatArray = NDArray[np.float64]
Alternative = Literal["two-sided", "less", "greater"]

FEW = 10
"""Units; with fewer, t tests are the default, because ranks of so few allow few values of p."""
_EXACT_UP_TO = 50
"""Pairs without ties; above, the normal approximation is as good."""
_TIED_UP_TO = 13
"""Pairs with ties or zeros, whose signs are enumerated."""


def paired_t(
    first: FloatArray, second: FloatArray, alternative: Alternative = "two-sided"
) -> dict[str, Any]:
    """Student's t test of pairs.

    Args:
        first: (N,) values of the first level.
        second: (N,) of the same units in the second.
        alternative: ``less``: the first level is less than the second.

    Returns:
        ``statistic`` (t), ``df``, ``p``, ``effect``: Cohen's d of the differences, ``estimate``
        (mean difference) and ``interval``.

    Raises:
        ValueError: All pairs differ by the same.
    """
    differences = first - second
    spread = float(np.std(differences, ddof=1))
    if np.ptp(differences) == 0.0:
        raise ValueError(
            "no pair differs" if differences[0] == 0.0 else "all pairs differ by the same"
        )
    found = stats.ttest_rel(first, second, alternative=alternative)
    mean = float(differences.mean())
    return _of_t(found) | {"effect": mean / spread, "estimate": mean}


def welch_t(
    first: FloatArray, second: FloatArray, alternative: Alternative = "two-sided"
) -> dict[str, Any]:
    """Welch's t test of two independent samples.

    Returns:
        As :func:`paired_t`; ``effect`` is Cohen's d by the pooled standard deviation.

    Raises:
        ValueError: The values of each level are equal.
    """
    if np.ptp(first) == 0.0 and np.ptp(second) == 0.0:
        raise ValueError("no unit differs from another of its level")
    found = stats.ttest_ind(first, second, equal_var=False, alternative=alternative)
    mean = float(first.mean() - second.mean())
    return _of_t(found) | {"effect": mean / pooled_sd(first, second), "estimate": mean}


def pooled_sd(first: FloatArray, second: FloatArray) -> float:
    """Standard deviation within two samples, pooled by their degrees of freedom."""
    parts = [(len(x) - 1, float(np.var(x, ddof=1))) for x in (first, second)]
    return math.sqrt(sum(df * var for df, var in parts) / sum(df for df, _ in parts))


def _of_t(found: Any) -> dict[str, Any]:
    interval = found.confidence_interval(CONFIDENCE)
    return {
        "statistic": float(found.statistic),
        "df": float(found.df),
        "p": float(found.pvalue),
        "interval": tuple(
            float(end) if math.isfinite(end) else None for end in (interval.low, interval.high)
        ),
    }


def wilcoxon(
    first: FloatArray, second: FloatArray, alternative: Alternative = "two-sided"
) -> dict[str, Any]:
    """Wilcoxon's signed-rank test of pairs.

    Pairs without a difference are left out (Wilcoxon's way), and ties share their ranks. ``z`` and
    ``p_normal`` are the normal approximation without continuity correction, as the SIM2VR paper
    reports it. ``p`` is exact up to 50 pairs, with ties or zeros up to 13; else it is ``p_normal``.

    Args:
        first: (N,) values of the first level.
        second: (N,) of the same units in the second.
        alternative: ``less``: the first level is less than the second.

    Returns:
        ``statistic`` (sum of the ranks of positive differences), ``z``, ``p``, ``p_normal``,
        ``exact``, ``effect``: the matched-pairs rank-biserial correlation (-1 to 1; Kerby 2014),
        ``r``: z / sqrt(N), ``dz``: Cohen's d of the differences, ``estimate`` (Hodges and Lehmann:
        median of the pairs' averages) and ``interval``.

    Raises:
        ValueError: No pair differs.
    """
    differences = first - second
    n = int(np.count_nonzero(differences))
    if n == 0:
        raise ValueError("no pair differs")
    upper = _asymptotic(differences, "greater")
    spread = float(np.std(differences, ddof=1)) if len(differences) > 1 else 0.0
    p, exact = _signed_rank_p(differences, alternative)
    i, j = np.triu_indices(len(differences))
    averages = np.sort((differences[i] + differences[j]) / 2.0)
    interval = inverted(
        lambda shift: _signed_rank_p(differences - shift, alternative)[0], averages, p
    )
    return {
        "statistic": float(upper.statistic),
        "z": float(upper.zstatistic),
        "p": p,
        "p_normal": float(_asymptotic(differences, alternative).pvalue),
        "exact": exact,
        "effect": 4.0 * float(upper.statistic) / (n * (n + 1)) - 1.0,
        "r": float(upper.zstatistic) / math.sqrt(len(differences)),
        "dz": float(differences.mean()) / spread if spread > 0.0 else None,
        "estimate": hodges_lehmann(averages),
        "interval": interval,
    }


def _asymptotic(differences: FloatArray, alternative: Alternative) -> Any:
    return stats.wilcoxon(
        differences, alternative=alternative, correction=False, method="asymptotic"
    )


def _signed_rank_p(differences: FloatArray, alternative: Alternative) -> tuple[float, bool]:
    """Return p and whether it is exact."""
    unlike = differences[differences != 0.0]
    n = len(unlike)
    if n == 0:
        return 1.0, True
    tied = n < len(differences) or len(np.unique(np.abs(unlike))) < n
    if not tied and n <= _EXACT_UP_TO:
        return float(stats.wilcoxon(unlike, alternative=alternative, method="exact").pvalue), True
    if n > _TIED_UP_TO:
        return float(_asymptotic(differences, alternative).pvalue), False
    ranks = np.copysign(stats.rankdata(np.abs(unlike)), unlike)
    found = stats.permutation_test(
        (ranks,),
        lambda x, axis: np.sum(x, axis=axis),
        permutation_type="samples",
        n_resamples=np.inf,
        vectorized=True,
        alternative=alternative,
    )
    return float(found.pvalue), True


def mann_whitney(
    first: FloatArray, second: FloatArray, alternative: Alternative = "two-sided"
) -> dict[str, Any]:
    """Mann and Whitney's test of two independent samples, such as trainings of two kinds.

    Returns:
        ``statistic`` (U of the first), ``p``, ``effect``: the rank-biserial correlation, which is
        Cliff's delta, ``estimate`` (Hodges and Lehmann: median of all differences) and
        ``interval``.
    """

    def tested(shift: float) -> Any:
        return stats.mannwhitneyu(first - shift, second, alternative=alternative)

    found = tested(0.0)
    differences = np.sort(np.subtract.outer(first, second).ravel())
    return {
        "statistic": float(found.statistic),
        "p": float(found.pvalue),
        "effect": 2.0 * float(found.statistic) / (len(first) * len(second)) - 1.0,
        "estimate": hodges_lehmann(differences),
        "interval": inverted(
            lambda shift: float(tested(shift).pvalue), differences, float(found.pvalue)
        ),
    }


def smallest_p(test: str, n: int | Sequence[int], alternative: Alternative) -> float | None:
    """Return the smallest p that so few units allow; None of tests without such a bound.

    Args:
        test: ``wilcoxon`` (n pairs) or ``mann-whitney`` (n of each sample).
        n: How many.
        alternative: Of the test.
    """
    sides = 2 if alternative == "two-sided" else 1
    if test == "wilcoxon" and isinstance(n, int):
        return min(1.0, sides * 2.0**-n)
    if test == "mann-whitney" and not isinstance(n, int):
        return min(1.0, sides / math.comb(sum(n), n[0]))
    return None


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


def holm(p_values: Sequence[float]) -> list[float]:
    """P values that account for how many there are (Holm 1979), in the same order."""
    if not p_values:
        return []
    from statsmodels.stats.multitest import multipletests

    return [float(p) for p in multipletests(p_values, method="holm")[1]]
