"""Users beside people in words: where in their distribution, and where the two disagree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np
from scipy import stats

from sim2vr_harness.client import Measure
from sim2vr_harness.games.published import Published
from sim2vr_harness.games.registry import behaviour_of, behaviours
from sim2vr_harness.statistics.distances import percentile, standard_deviations
from sim2vr_harness.studies.report.numbers import in_words, known, summary_of
from sim2vr_harness.studies.report.source import ReportSource

__all__ = ["people_sentences", "place_among"]

_MOST_GROUPS = 6
_AGREE = 0.7
"""Rank correlation of two orders."""
_FATIGUE = "max_fatigued"

Words = tuple[str, str]
"""A sentence and its numbers."""


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
        text = f"{measure.label} beside people (distance to their mean in their SD): {_some(told)}."
        yield text, _some(numbers)


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
            words, r = order_agreement(means, theirs)
            most = int(np.argmax(np.abs(means - theirs)))
            place = cell_name(most, rows, columns)
            told.append(
                f"{group.label}: users and people {words} in the order of the cells, and are "
                f"farthest apart at {place} (users {means[most]:.2f}, people {theirs[most]:.2f})"
            )
            numbers.append(f"{group.label}: {r}")
        if told:
            yield f"{grid.label}: {_some(told)}.", _some(numbers)


def order_agreement(users: np.ndarray, people: np.ndarray) -> Words:
    """Return in words whether two orders agree, and Spearman's correlation."""
    if np.ptp(users) == 0.0 or np.ptp(people) == 0.0:
        return "cannot be compared", "one of the two is the same everywhere"
    r = float(stats.spearmanr(users, people).statistic)
    return "agree" if r >= _AGREE else "disagree", f"Spearman's r = {r:.2f}, n = {len(users)}"


def cell_name(index: int, rows: int, columns: int) -> str:
    """Return the place of a cell as the player sees it: ``top left``."""
    row, column = divmod(index, columns)
    if (rows, columns) != (3, 3):
        return f"row {row + 1}, column {column + 1}"
    words = (("top", "middle", "bottom")[row], ("left", "middle", "right")[column])
    return "the middle" if words == ("middle", "middle") else " ".join(words)


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


def fatigue_order(users: dict[str, float], people: dict[str, float]) -> str:
    """Say how users' fatigue and people's ratings order conditions, and where they differ."""
    apart = [
        f"{one} and {other}"
        for one, other in combinations(users, 2)
        if np.sign(users[one] - users[other]) != np.sign(people[one] - people[other])
    ]
    where = f"users and people disagree about {', '.join(apart)}" if apart else "both agree"
    orders = f"fatigue of users is {_order(users)}, people rate {_order(people)}"
    return f"{orders}: {where}."


def _order(values: dict[str, float]) -> str:
    """``high > low = medium``."""
    ordered = sorted(values, key=lambda name: -values[name])
    text = ordered[0]
    for before, name in pairwise(ordered):
        text += f" {'=' if values[before] == values[name] else '>'} {name}"
    return text


def _some(told: Sequence[str]) -> str:
    more = len(told) - _MOST_GROUPS
    return "; ".join([*told[:_MOST_GROUPS], *([f"and {more} more below"] if more > 0 else [])])
