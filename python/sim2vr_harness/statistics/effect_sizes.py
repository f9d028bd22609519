"""Effect sizes of paired differences, as papers report them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

__all__ = ["CONFIDENCE", "wilcoxon_effect"]

CONFIDENCE = 0.95
"""Of intervals."""


def wilcoxon_effect(differences: Sequence[float]) -> float | None:
    """Effect size z / sqrt(n) of Wilcoxon's signed-rank test, as papers report it.

    Normal approximation without continuity correction; tied sizes share their mean rank, pairs
    without a difference have no rank but count in n.

    Args:
        differences: (n,) of pairs.

    Returns:
        Between -1 and 1; None without a difference.
    """
    each = np.asarray(differences, dtype=np.float64)
    some = each[each != 0.0]
    if len(some) == 0:
        return None
    ranks = stats.rankdata(np.abs(some))
    z = (ranks[some > 0.0].sum() - ranks.sum() / 2.0) / (math.sqrt(np.sum(ranks**2)) / 2.0)
    return float(z / math.sqrt(len(differences)))
