"""Power of t tests: detectable differences and sample sizes."""

import math
from collections.abc import Sequence

POWER = 0.8
"""Probability that a test finds the difference."""
STANDARDISED = (0.5, 0.8, 1.2)
"""Cohen's medium, large, and Sawilowsky's very large difference, in standard deviations."""
_ALPHA = 0.05
_RANK_EFFICIENCY = 3.0 / math.pi
"""Of Wilcoxon's and Mann and Whitney's test against t, of normal data (Pitman)."""
_MOST_UNITS = 1e6


def detectable(
    n: int | Sequence[int], sd: float, *, tests: int = 1, sides: int = 2, ranks: bool = False
) -> float | None:
    """Return the difference of means that is found with power 0.8.

    Args:
        n: Pairs; or units of each of two independent samples.
        sd: Standard deviation of the pairs' differences, or within the samples.
        tests: How many are corrected for: one of them is made at 0.05 / tests.
        sides: 1 or 2.
        ranks: Whether the test is one of ranks, which needs 1.05 times as many units.

    Returns:
        In the unit of ``sd``; None where n is too small for any.
    """
    from statsmodels.stats.power import TTestIndPower, TTestPower

    share = _RANK_EFFICIENCY if ranks else 1.0
    counts = [n] if isinstance(n, int) else list(n)
    if min(counts) * share < 2 or sd <= 0.0:
        return None
    asked = {"alpha": _ALPHA / tests, "power": POWER, "alternative": _side(sides)}
    if isinstance(n, int):
        effect = TTestPower().solve_power(nobs=n * share, **asked)
    else:
        effect = TTestIndPower().solve_power(
            nobs1=counts[0] * share, ratio=counts[1] / counts[0], **asked
        )
    return float(effect) * sd


def units_needed(
    difference: float,
    sd: float,
    *,
    paired: bool,
    tests: int = 1,
    sides: int = 2,
    ranks: bool = False,
) -> int:
    """Return how many units (of each level, where these are independent) find a difference.

    Args:
        difference: Of means; not 0.
        sd: Standard deviation of the pairs' differences, or within the samples.
        paired: Whether the same units have both levels.
        tests: How many are corrected for.
        sides: 1 or 2.
        ranks: Whether the test is one of ranks, which needs 1.05 times as many units.
    """
    from statsmodels.stats.power import TTestIndPower, TTestPower

    if sd <= 0.0:
        return 2
    share = _RANK_EFFICIENCY if ranks else 1.0
    effect, asked = abs(difference) / sd, {"alpha": _ALPHA / tests, "alternative": _side(sides)}

    def power(n: int) -> float:
        if n * share < 2:
            return 0.0
        if paired:
            return float(TTestPower().power(effect, n * share, **asked))
        return float(TTestIndPower().power(effect, n * share, **asked))

    low, high = 1, 2
    while power(high) < POWER and high < _MOST_UNITS:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(middle) >= POWER else (middle, high)
    return high


def _side(sides: int) -> str:
    return "two-sided" if sides == 2 else "larger"
