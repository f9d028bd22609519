"""Differences between conditions and between groups, and fatigue of conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson
from sim2vr_harness.statistics.intervals import mean_interval, welch_interval
from sim2vr_harness.statistics.significance import wilcoxon

COMPARED = ("hits", "misses", "hit_rate", "depth_median")


@dataclass(frozen=True)
class ContrastRow:
    """A user's difference between two conditions or groups, compared with recorded people's.

    Attributes:
        group: of people who play by the same rule; for differences between groups, both names.
        contrast: the two conditions, as minuend minus subtrahend; between groups the condition, the
            first group minus the second.
        value: the user's: mean over its persons.
        people_mean: of people's differences (between groups: difference of their means).
        people_low: lower end of the 95 % confidence interval of that mean.
        people_high: upper end.
        people_least: least difference of one person; None between groups.
        people_most: greatest difference of one person; None between groups.
        people: number of persons.
    """

    group: str
    contrast: str
    measure: str
    value: float
    people_mean: float
    people_low: float
    people_high: float
    people_least: float | None
    people_most: float | None
    people: int

    @property
    def same_sign(self) -> bool:
        """Return whether the user's difference has the same sign as the recorded people's."""
        return self.value * self.people_mean > 0.0 or self.value == self.people_mean

    @property
    def within(self) -> bool:
        """Return whether it lies in the confidence interval of the recorded people's mean."""
        return self.people_low <= self.value <= self.people_high


@dataclass(frozen=True)
class Fatigue:
    """Fatigue of a condition: the largest proportion of fatigued units, averaged over the muscles.

    Attributes:
        group: of people who play by the same rule.
        condition: its name in the recordings of people.
        mean: over persons.
        spread: standard deviation over persons; None for one person.
        persons: number of persons.
    """

    group: str
    condition: str
    mean: float
    spread: float | None
    persons: int


@dataclass(frozen=True)
class FatigueDifference:
    """Paired difference in fatigue between two conditions.

    Attributes:
        group: of people who play by the same rule.
        contrast: the two conditions, as minuend minus subtrahend.
        mean: of the differences.
        spread: their standard deviation; None for one person.
        effect: the mean divided by it; None for one person, or if it is 0.
        rank_effect: z / sqrt(n) of Wilcoxon's signed-rank test, as people's ratings are tested;
            None for one person, or without a difference.
    """

    group: str
    contrast: str
    mean: float
    spread: float | None
    effect: float | None
    rank_effect: float | None


def contrasts(
    user: Mapping[Cell, Sequence[RecordedPerson]],
    people: Mapping[Cell, Sequence[RecordedPerson]],
    behaviour: Behaviour,
) -> list[ContrastRow]:
    """Return differences between conditions, paired by person."""
    found = []
    for group in behaviour.groups:
        for contrast in behaviour.contrasts:
            pair = ((group, contrast.condition), (group, contrast.minus))
            for measure in COMPARED:
                own, theirs = (_differences(who, pair, measure) for who in (user, people))
                if not own or len(theirs) < 2:
                    continue
                interval = mean_interval(np.array(theirs))
                assert interval is not None
                found.append(
                    ContrastRow(
                        group,
                        contrast.name,
                        measure,
                        float(np.mean(own)),
                        float(np.mean(theirs)),
                        *interval,
                        min(theirs),
                        max(theirs),
                        len(theirs),
                    )
                )
    return found


def group_contrasts(
    user: Mapping[Cell, Sequence[RecordedPerson]],
    people: Mapping[Cell, Sequence[RecordedPerson]],
    behaviour: Behaviour,
) -> list[ContrastRow]:
    """Return differences between groups of people in a condition (Welch's interval)."""
    names = list(behaviour.groups)
    found = []
    for one, other in pairwise(names):
        for condition in behaviour.conditions:
            for measure in COMPARED:
                pairs = [
                    [_numbers(who.get((group, condition), ()), measure) for group in (one, other)]
                    for who in (user, people)
                ]
                (own_a, own_b), (a, b) = pairs
                if not own_a or not own_b or min(len(a), len(b)) < 2:
                    continue
                found.append(
                    ContrastRow(
                        f"{one}, {other}",
                        condition,
                        measure,
                        float(np.mean(own_a) - np.mean(own_b)),
                        float(np.mean(a) - np.mean(b)),
                        *welch_interval(np.array(a), np.array(b)),
                        None,
                        None,
                        len(a) + len(b),
                    )
                )
    return found


def fatigue_of(
    fatigue: Mapping[Cell, Mapping[str, float]], behaviour: Behaviour
) -> tuple[list[Fatigue], list[FatigueDifference]]:
    """Return the fatigue of conditions, and paired differences between them.

    Each difference is the last of ``behaviour.tiring`` minus one of the others.

    Args:
        fatigue: Condition -> person -> mean over the muscles of the largest proportion of fatigued
            units.
    """
    rows, differences = [], []
    for group in behaviour.groups:
        for condition in behaviour.conditions:
            values = list(fatigue.get((group, condition), {}).values())
            if values:
                spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
                mean = float(np.mean(values))
                rows.append(Fatigue(group, condition, mean, spread, len(values)))
        for less in behaviour.tiring[:-1]:
            most = fatigue.get((group, behaviour.tiring[-1]), {})
            other = fatigue.get((group, less), {})
            each = [most[name] - other[name] for name in most if name in other]
            if each:
                mean = float(np.mean(each))
                spread = float(np.std(each, ddof=1)) if len(each) > 1 else None
                differences.append(
                    FatigueDifference(
                        group,
                        f"{behaviour.tiring[-1]} - {less}",
                        mean,
                        spread,
                        mean / spread if spread else None,
                        _rank_effect(np.array(each)),
                    )
                )
    return rows, differences


def _rank_effect(differences: NDArray[np.float64]) -> float | None:
    """Return z / sqrt(n) of Wilcoxon's test; None of one person, or without a difference."""
    if len(differences) < 2 or not differences.any():
        return None
    return float(wilcoxon(differences, np.zeros(len(differences)))["r"])


def _numbers(persons: Sequence[RecordedPerson], measure: str) -> list[float]:
    found = [{**person.values, **person.further}.get(measure) for person in persons]
    return [value for value in found if value is not None]


def _differences(
    who: Mapping[Cell, Sequence[RecordedPerson]], pair: tuple[Cell, Cell], measure: str
) -> list[float]:
    one, other = (
        {person.name: {**person.values, **person.further} for person in who.get(cell, ())}
        for cell in pair
    )
    return [
        values[measure] - other[name][measure]
        for name, values in one.items()
        if name in other and measure in values and measure in other[name]
    ]
