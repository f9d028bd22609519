"""Tests against numbers worked out by hand, and examples that libraries publish."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from sim2vr_harness.statistics.intervals import mean_interval
from sim2vr_harness.statistics.power import detectable, units_needed
from sim2vr_harness.statistics.significance import (
    Alternative,
    friedman,
    holm,
    kruskal_wallis,
    mann_whitney,
    paired_t,
    welch_t,
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


def excludes_zero(interval: tuple[float | None, float | None]) -> bool:
    low, high = interval
    return (low is not None and low > 0.0) or (high is not None and high < 0.0)


@pytest.mark.parametrize("alternative", ["two-sided", "less", "greater"])
@pytest.mark.parametrize("test", [wilcoxon, mann_whitney, paired_t, welch_t])
def test_intervals_agree_with_their_test(test: Any, alternative: Alternative) -> None:
    """Whole numbers, so that there are ties and zeros."""
    rng = np.random.default_rng(4)
    rejected = 0
    for n in (3, 4, 5, 6, 7, 9, 12, 14):
        for shift in (0.0, 1.0, -2.0, 3.0):
            first = np.rint(rng.normal(shift, 1.5, n))
            second = np.rint(rng.normal(0.0, 1.5, n))
            if np.ptp(first - second) == 0.0:
                continue
            found = test(first, second, alternative)
            rejected += found["p"] < 0.05
            assert not (excludes_zero(found["interval"]) and found["p"] > 0.05)
            low, high = found["interval"]
            inside = (low is None or low < 0.0) and (high is None or high > 0.0)
            assert not (inside and found["p"] < 0.05)
    assert 3 <= rejected < 25


def test_rank_intervals_by_hand() -> None:
    # Six pairs: sums of ranks up to 0 have p = 2 / 64 = .031, up to 1 .0625: the interval reaches
    # from the least of the averages of pairs to the greatest, 1 and 6.
    found = wilcoxon(*pairs(1, 2, 3, 4, 5, 6.5))
    assert (found["interval"], found["p"]) == ((1.0, 6.5), 2 / 64)
    assert found["estimate"] == pytest.approx(3.5)
    assert wilcoxon(*pairs(1, 2, 3, 4, 5))["interval"] == (None, None), "p is .0625 at best"
    # Of four and four, U = 0 has p = 2 / 70 = .029 and U = 1 4 / 70 = .057.
    apart = mann_whitney(np.array([5.0, 6.0, 7.0, 9.0]), np.array([0.1, 1.2, 2.3, 3.4]))
    assert apart["interval"] == pytest.approx((5.0 - 3.4, 9.0 - 0.1))


def test_how_many_units_a_difference_needs() -> None:
    # G*Power 3.1 (Faul et al. 2007): d_z = 0.5 needs 34 pairs, d = 0.5 64 a group, d = 0.8 26.
    assert units_needed(0.5, 1.0, paired=True) == 34
    assert units_needed(-1.0, 2.0, paired=False) == 64
    assert units_needed(0.8, 1.0, paired=False) == 26
    assert units_needed(0.5, 1.0, paired=True, tests=3) > 34
    # Of ranks, pi / 3 as many: 34 pairs have a power of .808, 33 of .795: the 80 % lie at 33.4.
    assert units_needed(0.5, 1.0, paired=True, ranks=True) in (35, 36)
    for n in (20, 50):
        found = detectable(n, 1.0, ranks=True)
        assert found is not None
        assert units_needed(1.0001 * found, 1.0, paired=True, ranks=True) == n
    assert 0.49 < (detectable(34, 1.0) or 0.0) < 0.5 < (detectable(33, 1.0) or 0.0)
    assert detectable([64, 64], 2.0) == pytest.approx(1.0, abs=0.01)
    assert (detectable(34, 1.0, ranks=True) or 0.0) > (detectable(34, 1.0) or 0.0)


def test_mean_intervals_are_student_s() -> None:
    values = np.array([0.0, 1.0])
    # The quantile of one degree of freedom is tan(0.475 pi); the mean's error is 1/2.
    half = np.tan(0.475 * np.pi) / 2.0
    assert mean_interval(values) == pytest.approx((0.5 - half, 0.5 + half))
    assert mean_interval(np.full(9, 4.0)) == (4.0, 4.0)
    assert mean_interval(np.array([4.0])) is None
