"""Agreement of users with people in words: order of cells, and of conditions by fatigue."""

from collections.abc import Mapping
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import stats

FloatArray = NDArray[np.float64]
Words = tuple[str, str]
"""A sentence, or a part of one, and its numbers."""

_AGREE, _IN_PART = 0.7, 0.3
"""Rank correlation of two orders that agree, and that agree in part."""


def cell_disagreement(users: FloatArray, people: FloatArray, grid: tuple[int, int]) -> Words:
    """Say whether the order of cells agrees, and where users and people are farthest apart.

    Args:
        users: (C,) of every cell, mean over users.
        people: (C,) the same of people.
        grid: Rows and columns.
    """
    words, r = order_agreement(users, people)
    most = int(np.argmax(np.abs(users - people)))
    place = cell_name(most, *grid)
    text = (
        f"users and people {words} in the order of the cells, and are farthest apart at {place} "
        f"(users {users[most]:.2f}, people {people[most]:.2f})"
    )
    return text, r


def order_agreement(users: FloatArray, people: FloatArray) -> Words:
    """Return in words whether two orders agree, and Spearman's correlation."""
    if np.ptp(users) == 0.0 or np.ptp(people) == 0.0:
        return "cannot be compared", "one of the two is the same everywhere"
    r = float(stats.spearmanr(users, people).statistic)
    words = "agree" if r >= _AGREE else "agree in part" if r >= _IN_PART else "disagree"
    return words, f"Spearman's r = {r:.2f}, n = {len(users)}"


def cell_name(index: int, rows: int, columns: int) -> str:
    """Return the place of a cell as the player sees it: ``top left``."""
    row, column = divmod(index, columns)
    if (rows, columns) != (3, 3):
        return f"row {row + 1}, column {column + 1}"
    words = (("top", "middle", "bottom")[row], ("left", "middle", "right")[column])
    return "the middle" if words == ("middle", "middle") else " ".join(words)


def fatigue_order(users: Mapping[str, float], people: Mapping[str, float]) -> str:
    """Return a sentence on the order of conditions by users' fatigue and by people's ratings."""
    apart = [
        f"{one} and {other}"
        for one, other in combinations(users, 2)
        if np.sign(users[one] - users[other]) != np.sign(people[one] - people[other])
    ]
    where = f"users and people disagree about {', '.join(apart)}" if apart else "both agree"
    orders = f"fatigue of users is {_order(users)}, people rate {_order(people)}"
    return f"{orders}: {where}."


def _order(values: Mapping[str, float]) -> str:
    """``high > low = medium``."""
    ordered = sorted(values, key=lambda name: -values[name])
    text = ordered[0]
    for before, name in pairwise(ordered):
        text += f" {'=' if values[before] == values[name] else '>'} {name}"
    return text
