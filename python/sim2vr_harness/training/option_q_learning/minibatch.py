"""Draw the decisions of a minibatch: some come from before rewards."""

import numpy as np
from numpy.typing import NDArray

N_STEP = 3
"""Decisions whose rewards are added up before a value is bootstrapped."""
_REWARDED_SHARE = 0.25
"""Share of a minibatch that came before a reward (prioritised replay, Schaul et al. 2016)."""


def draw_decisions(
    rewarded: NDArray[np.bool_], size: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Draw decisions; rewards are rare at first, so those before them are preferred.

    Args:
        rewarded: (R, N) whether decisions of N users were rewarded, in order.
        size: decisions to draw.
        rng: draws them.

    Returns:
        Their rows and users, and how much more likely each were if all were drawn alike
        (importance weights without an exponent; their mean is 1).
    """
    first, n = len(rewarded) - N_STEP + 1, rewarded.shape[1]
    rows, users = rng.integers(0, first, size), rng.integers(0, n, size)
    when, who = np.nonzero(rewarded)
    if not len(when):
        return rows, users, np.ones(size)
    preferred = round(_REWARDED_SHARE * size)
    drawn = rng.integers(0, len(when), preferred)
    before = np.clip(when[:, None] - np.arange(N_STEP), 0, first - 1)
    rows[:preferred] = before[drawn, rng.integers(0, N_STEP, preferred)]
    users[:preferred] = who[drawn]
    ways = np.zeros((first, n))
    np.add.at(ways, (before, who[:, None]), 1.0)
    share = preferred / size
    times = ways[rows, users] * first * n / (N_STEP * len(when))
    return rows, users, 1.0 / (1.0 - share + share * times)
