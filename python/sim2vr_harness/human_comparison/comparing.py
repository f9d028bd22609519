"""Comparison of users with recorded people: every measure in every condition, and summaries."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.measures import (
    FAMILIES,
    NEGLIGIBLE,
    BehaviourMeasure,
    measures_in,
    plain,
)
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson
from sim2vr_harness.statistics.distances import (
    distance,
    inside,
    kolmogorov,
    percentile,
    standard_deviations,
    wasserstein,
    wasserstein_ratio,
)

CELL_RATES = "cell_hit_rates"
"""The measure that is a number per cell: its share inside is that of the cells."""

People = Mapping[Cell, Sequence[RecordedPerson]]


@dataclass(frozen=True)
class ComparisonRow:
    """A measure of a user in a condition, compared with recorded people's.

    Attributes:
        group: of people who play by the same rule.
        condition: its name in the recordings of people.
        value: of the user: mean over its persons.
        spread: standard deviation over its persons (ddof 1); None for one person.
        persons: number of the user's persons with a value.
        people_mean: mean over people; None, as their least and greatest, without recorded people.
        people_low: their least.
        people_high: their greatest.
        people_spread: standard deviation over people; None for one.
        people: number of people with a value.
        inside: 1 inside people's range and 0 outside; between for proportions of cells. None, as
            the following, if one person was recorded, who has no range.
        distance: from people's mean, in units of the distance of one person from the others.
        persons_inside: proportion of the user's persons inside; None for one person.
        percentile: percentage of people below the user.
        deviations: distance from people's mean in their standard deviations; None: all are equal.
    """

    group: str
    condition: str
    measure: BehaviourMeasure
    value: float
    spread: float | None
    persons: int
    people_mean: float | None
    people_low: float | None
    people_high: float | None
    people_spread: float | None
    people: int
    inside: float | None
    distance: float | None
    persons_inside: float | None
    percentile: float | None
    deviations: float | None

    @property
    def people_range(self) -> str:
        """Range of recorded people, least to greatest, as text; empty without people."""
        if self.people_low is None or self.people_high is None:
            return ""
        return f"{plain(self.people_low)} to {plain(self.people_high)}"


@dataclass(frozen=True)
class SampleRow:
    """The distribution of single targets, hits or frames, compared with recorded people's.

    Attributes:
        group: of people who play by the same rule.
        condition: its name in the recordings of people.
        w1: first Wasserstein distance.
        ratio: the same in units of the distance of one person from the others, at most 10.
        ks: largest difference of the distributions (Kolmogorov-Smirnov).
        median: of the user's.
        people_median: of people's: mean of their medians.
    """

    group: str
    condition: str
    sample: str
    w1: float
    ratio: float
    ks: float
    median: float
    people_median: float


@dataclass(frozen=True)
class Total:
    """Summary over rows of a comparison.

    Attributes:
        cells: number of (measure, condition) pairs.
        inside: mean of their ``inside``; None without a range of recorded people.
        distance: mean of their ``distance``; None likewise.
    """

    cells: int
    inside: float | None
    distance: float | None


@dataclass(frozen=True)
class Compared:
    """Comparison of a user with recorded people."""

    name: str
    persons: People
    rows: tuple[ComparisonRow, ...]
    samples: tuple[SampleRow, ...]

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups that it was compared with."""
        return tuple(dict.fromkeys(row.group for row in self.rows))


def compare(name: str, user: People, people: People, behaviour: Behaviour) -> Compared:
    """Compare a user with recorded people in the conditions that both have played.

    Args:
        user: Its persons by condition.
        people: By condition, at least as many persons as the game's ``least_people``.
    """
    cells = [
        (group, condition)
        for group in behaviour.groups
        for condition in behaviour.conditions
        if len(people.get((group, condition), ())) >= behaviour.least_people
        and user.get((group, condition))
    ]
    rows = [
        row for cell in cells for row in _rows(cell, user[cell], people.get(cell, ()), behaviour)
    ]
    samples = [
        row for cell in cells for row in _samples(cell, user[cell], people.get(cell, ()), behaviour)
    ]
    return Compared(name, user, tuple(rows), tuple(samples))


def _rows(
    cell: Cell,
    user: Sequence[RecordedPerson],
    people: Sequence[RecordedPerson],
    behaviour: Behaviour,
) -> Iterable[ComparisonRow]:
    for measure in measures_in(behaviour, *cell):
        own = [x.values[measure.name] for x in user if measure.name in x.values]
        theirs = [x.values[measure.name] for x in people if measure.name in x.values]
        several = len(theirs) > 1
        if not own or len(theirs) < behaviour.least_people:
            continue
        value = float(np.mean(own))
        nearest = min(max(value, min(theirs)), max(theirs)) if theirs else value
        value = nearest if abs(value - nearest) < NEGLIGIBLE else value
        if np.ptp([value, *theirs]) < NEGLIGIBLE:  # all alike, but for rounding errors
            theirs = [value] * len(theirs)
        share = None
        if measure.name == CELL_RATES:
            # Share of the cells whose hit rate is inside people's range of that cell.
            inside_own = np.array([x.cell_rates for x in user])
            inside_theirs = np.array([x.cell_rates for x in people])
            known = np.isfinite(inside_own).any(axis=0) & np.isfinite(inside_theirs).any(axis=0)
            mean = np.nanmean(inside_own[:, known], axis=0)
            low, high = (
                np.nanmin(inside_theirs[:, known], axis=0),
                np.nanmax(inside_theirs[:, known], axis=0),
            )
            share = float(np.mean((low <= mean) & (mean <= high)))
        elif several:
            share = float(inside(value, theirs))
        yield ComparisonRow(
            *cell,
            measure,
            value=value,
            spread=float(np.std(own, ddof=1)) if len(own) > 1 else None,
            persons=len(own),
            people_mean=float(np.mean(theirs)) if theirs else None,
            people_low=min(theirs, default=None),
            people_high=max(theirs, default=None),
            people_spread=float(np.std(theirs, ddof=1)) if several else None,
            people=len(theirs),
            inside=share,
            distance=distance(value, theirs) if several else None,
            persons_inside=float(np.mean([inside(x, theirs) for x in own]))
            if len(own) > 1 and several
            else None,
            percentile=percentile(value, theirs) if several else None,
            deviations=standard_deviations(value, theirs) if several else None,
        )


def _samples(
    cell: Cell,
    user: Sequence[RecordedPerson],
    people: Sequence[RecordedPerson],
    behaviour: Behaviour,
) -> Iterable[SampleRow]:
    names = [m.sample for m in measures_in(behaviour, *cell) if m.sample is not None]
    for name in dict.fromkeys(names):
        own = [x.samples[name] for x in user if len(x.samples.get(name, ()))]
        theirs = [x.samples[name] for x in people if len(x.samples.get(name, ()))]
        if not own or len(theirs) < 2:
            continue
        yield SampleRow(
            *cell,
            name,
            w1=wasserstein(own, theirs),
            ratio=wasserstein_ratio(own, theirs),
            ks=kolmogorov(own, theirs),
            median=float(np.mean([np.median(x) for x in own])),
            people_median=float(np.mean([np.median(x) for x in theirs])),
        )


def total(rows: Sequence[ComparisonRow]) -> Total | None:
    """Return the unweighted mean over rows; None if there are no rows."""
    if not rows:
        return None
    return Total(
        len(rows),
        _mean([row.inside for row in rows]),
        _mean([row.distance for row in rows]),
    )


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def left_out(people: People, behaviour: Behaviour) -> dict[str, dict[str, Compared]]:
    """Compare each person with the others of a group of 3 or more: group -> person -> result."""
    found: dict[str, dict[str, Compared]] = {}
    for group in behaviour.groups:
        own = {cell: persons for cell, persons in people.items() if cell[0] == group}
        names = sorted({person.name for persons in own.values() for person in persons})
        if len(names) < 3:
            continue
        found[group] = {
            name: compare(
                name,
                {cell: [p for p in persons if p.name == name] for cell, persons in own.items()},
                {cell: [p for p in persons if p.name != name] for cell, persons in own.items()},
                behaviour,
            )
            for name in names
        }
    return found


def by_family(rows: Sequence[ComparisonRow]) -> dict[str, Total]:
    """Return the summaries of the rows of each family."""
    parts = {f: total([row for row in rows if row.measure.family == f]) for f in FAMILIES}
    return {family: part for family, part in parts.items() if part is not None}
