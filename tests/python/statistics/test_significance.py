"""Tests against numbers worked out by hand, and examples that libraries publish."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sim2vr_harness.statistics.significance import (
    bootstrap,
    friedman,
    holm,
    kruskal_wallis,
    mann_whitney,
    normality,
    wilcoxon,
)

DARWIN = [6, 8, 14, 16, 23, 24, 28, 29, 41, -48, 49, 56, 60, -67, 75]
"""Heights of Darwin's self- and cross-fertilised maize, the example of SciPy's documentation."""


def pairs(*differences: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array(differences, float), np.zeros(len(differences))


def test_wilcoxon_s_published_example() -> None:
    # SciPy's page says: two-sided p 0.041259765625, greater 0.020629882812; ranks of the negative
    # differences 10 and 14, hence 24 of 120.
    found = wilcoxon(*pairs(*DARWIN))
    assert found["statistic"] == 96.0
    assert found["p"] == pytest.approx(0.041259765625, rel=1e-9)
    assert wilcoxon(*pairs(*DARWIN), "greater")["p"] == pytest.approx(0.020629882812, rel=1e-9)
    assert found["effect"] == pytest.approx((96 - 24) / 120)
    # z = (96 - 60) / sqrt(15 16 31 / 24)
    assert found["z"] == pytest.approx(36.0 / np.sqrt(310.0))


def test_wilcoxon_by_hand_with_ties_and_zeros() -> None:
    # 0 is left out; |2|, |2| share ranks 1.5, |3| has 3. W+ = 1.5 + 3 = 4.5 of 6.
    found = wilcoxon(*pairs(0, 2, -2, 3))
    assert found["statistic"] == 4.5
    assert found["effect"] == pytest.approx(0.5)
    # Signs: 8 ways; sums of positive ranks at least 4.5: {1.5, 3} twice, and all: 3 of 8.
    assert wilcoxon(*pairs(0, 2, -2, 3), "greater")["p"] == pytest.approx(3 / 8)
    assert wilcoxon(*pairs(0, 2, -2, 3), "less")["p"] == pytest.approx(7 / 8)
    # Variance n (n + 1) (2 n + 1) / 24 - (2^3 - 2) / 48 = 3.5 - 0.125.
    assert found["z"] == pytest.approx(1.5 / np.sqrt(3.375))
    # d = mean / SD of all differences: 0.75 / sqrt((0.5625 + 1.5625 + 7.5625 + 5.0625) / 3)
    assert found["dz"] == pytest.approx(0.75 / np.sqrt(14.75 / 3))
    with pytest.raises(ValueError, match="no pair differs"):
        wilcoxon(*pairs(0, 0))


@pytest.mark.parametrize("seed", range(5))
def test_exact_p_values_agree_with_scipy_s(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = rng.normal(0.3, 1.0, (2, 4 + 3 * seed))
    for alternative in ("two-sided", "less", "greater"):
        expected = stats.wilcoxon(first, second, alternative=alternative, method="exact").pvalue
        assert wilcoxon(first, second, alternative)["p"] == pytest.approx(expected, abs=1e-12)
        normal = stats.wilcoxon(
            first, second, alternative=alternative, method="asymptotic", correction=False
        )
        assert wilcoxon(first, second, alternative)["p_normal"] == pytest.approx(normal.pvalue)


def test_friedman_s_published_example() -> None:
    # SciPy's page: heart rates of seven students, 10.571428571428571 and 0.005063414171757498.
    rates = [
        np.array([72, 96, 88, 92, 74, 76, 82], float),
        np.array([120, 120, 132, 120, 101, 96, 112], float),
        np.array([76, 95, 104, 96, 84, 72, 76], float),
    ]
    found = friedman(rates)
    assert found["statistic"] == pytest.approx(10.571428571428571)
    assert found["p"] == pytest.approx(0.005063414171757498)
    assert found["effect"] == pytest.approx(10.571428571428571 / 14)
    assert found["df"] == 2
    # All agree: W = 1 and chi square = n (k - 1).
    agreed = friedman([np.arange(4.0), np.arange(4.0) + 1, np.arange(4.0) + 2])
    assert (agreed["statistic"], agreed["effect"]) == (pytest.approx(8.0), pytest.approx(1.0))
    with pytest.raises(ValueError, match="no unit differs"):
        friedman([np.ones(3)] * 3)


def test_independent_samples_by_hand() -> None:
    # Of 2 x 3 pairs the first is greater in 1: U = 1, delta = 2/6 - 1. Of the 10 ways to choose two
    # of five ranks 1 + 1 have U <= 1: p = 0.2 one-sided.
    found = mann_whitney(np.array([1.0, 3.0]), np.array([2.0, 4.0, 5.0]), "less")
    assert (found["statistic"], found["effect"]) == (1.0, pytest.approx(-2 / 3))
    assert found["p"] == pytest.approx(0.2)
    # Ranks 1 2 | 3 4 | 5 6: H = 12 / (6 7) (9 / 2 + 49 / 2 + 121 / 2) - 3 7 = 32 / 7.
    levels = [np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([5.0, 6.0])]
    found = kruskal_wallis(levels)
    assert found["statistic"] == pytest.approx(32 / 7)
    assert found["effect"] == pytest.approx(32 / 35)
    assert found["p"] == pytest.approx(np.exp(-16 / 7)), "chi square of two degrees of freedom"


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_normality_by_hand() -> None:
    # Mean 0, SD sqrt(10 / 3): distribution at -2, -1, 1, 2 is .1367, .2919, .7081, .8633; the
    # greatest distance is that of .7081 to .5 before it.
    found = normality(np.array([-2.0, -1.0, 1.0, 2.0]))
    assert found is not None
    cdf = stats.norm.cdf(1.0 / np.sqrt(10.0 / 3.0))
    assert found["statistic"] == pytest.approx(cdf - 0.5)
    skewed = normality(np.exp(np.random.default_rng(1).normal(0, 2, 60)))
    assert skewed is not None and skewed["p"] < 0.01
    assert normality(np.ones(9)) is None
    assert normality(np.arange(3.0)) is None


def test_bootstrap_intervals() -> None:
    # Two units of 0 and 1: the mean of a resample is 0, 1/2 or 1; 0 and 1 a quarter each.
    assert bootstrap(np.array([0.0, 1.0])) == (0.0, 1.0)
    assert bootstrap(np.full(9, 4.0)) == (4.0, 4.0)
    assert bootstrap(np.array([4.0])) is None
    values = np.random.default_rng(3).normal(10.0, 2.0, 400)
    low, high = bootstrap(values) or (0.0, 0.0)
    # About mean +- 1.96 SD / sqrt(n).
    half = 1.96 * values.std() / 20.0
    assert low == pytest.approx(values.mean() - half, abs=0.02)
    assert high == pytest.approx(values.mean() + half, abs=0.02)
    apart = bootstrap(np.array([3.0, 3.0]), np.array([1.0, 1.0]))
    assert apart == (2.0, 2.0)
    assert bootstrap(values) == bootstrap(values), "the same again"
