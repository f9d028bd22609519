"""Users beside people in words: where in their distribution, and where the two disagree."""

from collections.abc import Iterator, Sequence

import numpy as np

from sim2vr_harness.client import Measure
from sim2vr_harness.games.published import Published
from sim2vr_harness.games.registry import behaviour_of, behaviours
from sim2vr_harness.human_comparison.agreement import (
    Words,
    cell_disagreement,
    fatigue_order,
)
from sim2vr_harness.statistics.distances import percentile, standard_deviations
from sim2vr_harness.studies.report.numbers import in_words, known, some_of, summary_of
from sim2vr_harness.studies.report.source import ReportSource

_FATIGUE = "max_fatigued"


def people_sentences(
    source: ReportSource, published: Published, measures: Sequence[Measure]
) -> Iterator[Words]:
    """Yield users' places among people, and where users and people disagree."""
    for measure in measures:
        yield from _places(source, published, measure)
    yield from _cells(source, published)
    duration_s = max(float(group.episodes["duration_s"].median()) for group in source.groups)
    if published.beside_rounds_of(duration_s) is published:  # fatigue grows with the round
        yield from _fatigue(source)


def place_among(value: float, people: Sequence[float]) -> str:
    """Return percentile and distance: ``percentile 35 of 12 people, -0.4 SD``."""
    away = standard_deviations(value, people)
    words = "people do not differ" if away is None else f"{away:+.1f} SD"
    return f"percentile {percentile(value, people):.0f} of {len(people)} people, {words}"


def _places(source: ReportSource, published: Published, measure: Measure) -> Iterator[Words]:
    told, numbers = [], []
    for group in source.groups:
        people = published.people_in(group.condition, measure.name)
        found = summary_of(group, measure.name)
        if len(people) < 2 or found is None:
            continue
        told.append(f"{group.label}: {place_among(found.mean, people)}")
        spread = f"{float(np.std(people, ddof=1)):.{measure.digits}f}"
        numbers.append(
            f"{group.label}: {in_words(found.mean, measure)}, people "
            f"{in_words(float(np.mean(people)), measure)}, SD {spread}"
        )
    if told:
        text = f"{measure.label} beside people (distance to their mean in their SD)"
        yield f"{text}: {some_of(told)}.", some_of(numbers)


def _cells(source: ReportSource, published: Published) -> Iterator[Words]:
    for grid in source.grids:
        rows, columns = grid.grid or (0, 0)
        told, numbers = [], []
        for group in source.groups:
            people = published.grid_of(group.condition, grid.name)
            own = [known(group.values(f"{grid.name}_{i}")) for i in range(rows * columns)]
            if people is None or len(people) != len(own) or not all(own):
                continue
            means = np.array([np.mean(values) for values in own])
            theirs = np.array(people)
            words, r = cell_disagreement(means, theirs, (rows, columns))
            told.append(f"{group.label}: {words}")
            numbers.append(f"{group.label}: {r}")
        if told:
            yield f"{grid.label}: {some_of(told)}.", some_of(numbers)


def _fatigue(source: ReportSource) -> Iterator[Words]:
    """Compare the order of users' fatigue with that of people's ratings."""
    game = source.facts.name
    behaviour = behaviour_of(game) if game in behaviours() else None
    if behaviour is None or behaviour.ratings is None:
        return
    own: dict[tuple[str, str], dict[str, float]] = {}
    for group in source.groups:
        cell, found = behaviour.recognise(group.condition), summary_of(group, _FATIGUE)
        if cell is not None and found is not None:
            own.setdefault((group.user, cell[0]), {})[cell[1]] = found.mean
    for (user, rule), means in own.items():
        medians = behaviour.ratings.medians.get(rule, {})
        both = [condition for condition in medians if condition in means]
        if len(both) > 1:
            rated = {condition: medians[condition] for condition in both}
            text = fatigue_order({c: means[c] for c in both}, rated)
            yield f"{user}: {text}", f"{behaviour.ratings.scale}; {behaviour.ratings.source}"
