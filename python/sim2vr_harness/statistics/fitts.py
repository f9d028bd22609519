"""Fitts' law: effective index of difficulty (ISO 9241-411), and movement time by index."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WIDTH_OF_SD = 4.133
"""Widths of targets that 96 % of normally spread end points hit, in standard deviations
(ISO 9241-411: effective width)."""


@dataclass(frozen=True)
class FittedLine:
    """MT = a + b ID by least squares.

    Attributes:
        a_s: intercept.
        b_s_per_bit: slope.
        r2: share of the variance of movement times that it explains.
        points: how many.
    """

    a_s: float
    b_s_per_bit: float
    r2: float
    points: int


def fit_line(
    bits: Sequence[float] | NDArray[np.float64], times_s: Sequence[float] | NDArray[np.float64]
) -> FittedLine | None:
    """Fit movement times by indices of difficulty; None below three different indices.

    Points that are not known (NaN) do not count.
    """
    x, y = np.asarray(bits, dtype=np.float64), np.asarray(times_s, dtype=np.float64)
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(np.unique(x)) < 3:
        return None
    b, a = np.polyfit(x, y, 1)
    rest, total = np.sum((y - a - b * x) ** 2), np.sum((y - y.mean()) ** 2)
    r2 = 1.0 - rest / total if total > 0.0 else 0.0
    return FittedLine(float(a), float(b), float(r2), len(x))


def effective_bits(way: NDArray[np.float64], end: NDArray[np.float64]) -> float:
    """Return the effective index of difficulty of movements, bits; NaN without a spread.

    Args:
        way: (K, 3) from starts to targets.
        end: (K, 3) from targets to end points.
    """
    far = np.linalg.norm(way, axis=1)
    beyond = (end * way).sum(1) / far
    width = WIDTH_OF_SD * np.std(beyond) if len(beyond) else 0.0
    return float(np.log2((far + beyond).mean() / width + 1.0)) if width > 0.0 else np.nan
