"""Means over the players of a group, and words for numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim2vr_harness.client import Measure
from sim2vr_harness.studies.report.source import PROPORTION, Group

MOST_GROUPS = 6
"""So many groups are named in a sentence."""


@dataclass(frozen=True)
class Summary:
    """A measure of a group.

    Attributes:
        mean: Over the players, each counts with the mean of its rounds.
        spread: Standard deviation (ddof 1): over the players; of a single player, over its rounds.
        n: Players with the number.
        rounds: Rounds with the number.
    """

    mean: float
    spread: float | None
    n: int
    rounds: int


def summary_of(group: Group, measure: str) -> Summary | None:
    """Return a measure's mean over the players of a group; None where no round has it."""
    by_unit: dict[str, list[float]] = {}
    for unit, value in zip(group.units, group.values(measure), strict=True):
        if value is not None:
            by_unit.setdefault(unit, []).append(value)
    if not by_unit:
        return None
    means = [float(np.mean(values)) for values in by_unit.values()]
    rounds = [value for values in by_unit.values() for value in values]
    over = means if len(means) > 1 else rounds
    spread = float(np.std(over, ddof=1)) if len(over) > 1 else None
    return Summary(float(np.mean(means)), spread, len(means), len(rounds))


def known(values: Sequence[float | None]) -> list[float]:
    """The values that there are."""
    return [value for value in values if value is not None and math.isfinite(value)]


def in_words(value: float, measure: Measure) -> str:
    """A number with its unit, as many digits as the game publishes."""
    unit = f" {measure.unit}" if measure.unit and measure.unit != PROPORTION else ""
    return f"{value:,.{measure.digits}f}{unit}"


def with_spread(found: Summary | None, measure: Measure, units: int | None = None) -> str:
    """``12.3 ± 1.2 (n = 5 of 8)``; a dash without a number.

    Args:
        found: The number.
        units: How many players there are; None: n is not written.
    """
    if found is None:
        return "–"
    text = f"{found.mean:,.{measure.digits}f}"
    text = text if found.spread is None else f"{text} ± {found.spread:,.{measure.digits}f}"
    return text if units is None else f"{text} (n = {of_units(found.n, units)})"


def of_units(n: int, units: int) -> str:
    """``8``, or ``5 of 8`` where some have no value."""
    return str(n) if n == units else f"{n} of {units}"


def some_of(told: Sequence[str]) -> str:
    """Join words on groups; of many only the first ones."""
    more = len(told) - MOST_GROUPS
    return "; ".join([*told[:MOST_GROUPS], *([f"and {more} more below"] if more > 0 else [])])
