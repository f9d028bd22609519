"""What came out, in plain words: a sentence each, and the numbers that it says no more than."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sim2vr_harness.client import Measure
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.body import Load
from sim2vr_harness.studies.report.effort import effort_share
from sim2vr_harness.studies.report.numbers import Summary, in_words, known, summary_of
from sim2vr_harness.studies.report.source import Group, ReportSource

__all__ = ["Sentence", "n_sentence", "sentences_of"]

_MOST_TESTS = 6
_MOST_GROUPS = 6
"""That are named one by one; of more the table has the numbers."""
_SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Sentence:
    """A statement, and the numbers behind it."""

    text: str
    numbers: str


def sentences_of(
    source: ReportSource, published: Published, loads: Sequence[Load | None]
) -> list[Sentence]:
    """Return the summary; only statements that these data allow."""
    return [
        *_score(source),
        *_people(source, published),
        *_places(source),
        *_times(source, published),
        *_tiring(source),
        *_muscles(source, loads),
        *_effort(source),
        *_tests(source),
        n_sentence(source),
    ]


def n_sentence(source: ReportSource) -> Sentence:
    """What n is, and what it allows to say."""
    n, rounds = len(source.units), sum(len(group.episodes) for group in source.groups)
    who = {"person": "simulated persons", "user": "trained users"}.get(
        source.unit, f"levels of {source.unit}"
    )
    if n == 1:
        text = (
            "n is 1: one trained user. Its rounds show how much it varies, not how much other "
            "users or people do, so there is no p value for differences between conditions."
        )
    elif source.unit == "user":
        text = (
            f"n is {n} trained users, each in its own right: what distinguishes them is seen here, "
            "but not whether another training of the same kind would be the same."
        )
    else:
        text = f"n is {n} {who}; rounds of one of them count as one value, their mean."
    return Sentence(text, f"n = {n}, {rounds} rounds in {len(source.groups)} groups")


def _score(source: ReportSource) -> Iterator[Sentence]:
    score = source.score
    found = [(g, s) for g in source.groups if (s := summary_of(g, score.name)) is not None]
    if not found:
        return
    label = _lower(score.label)
    if len(found) == 1:
        group, summary = found[0]
        yield Sentence(
            f"The {label} in {group.label} is {in_words(summary.mean, score)}.",
            _numbers(summary, score),
        )
        return
    ordered = sorted(found, key=lambda pair: pair[1].mean)
    low, high = ordered[0][1], ordered[-1][1]
    if in_words(high.mean, score) == in_words(low.mean, score):
        yield Sentence(
            f"The {label} is the same in all: {in_words(low.mean, score)}.", _numbers(low, score)
        )
        return
    highest, lowest = (
        [g.label for g, s in found if in_words(s.mean, score) == in_words(end.mean, score)]
        for end in (high, low)
    )
    yield Sentence(
        f"The {label} is highest in {_groups(highest, len(found))} and lowest in "
        f"{_groups(lowest, len(found))}.",
        f"{in_words(high.mean, score)} against {in_words(low.mean, score)}",
    )


def _numbers(summary: Summary, measure: Measure) -> str:
    text = f"mean {in_words(summary.mean, measure)}"
    if summary.spread is not None:
        text += f", SD {summary.spread:.{measure.digits}f}"
    return f"{text}, {summary.rounds} rounds"


def _people(source: ReportSource, published: Published) -> Iterator[Sentence]:
    score = source.score
    inside: list[str] = []
    above: list[str] = []
    below: list[str] = []
    told = []
    for group in source.groups:
        people = published.people_in(group.condition, score.name)
        summary = summary_of(group, score.name)
        if len(people) < 2 or summary is None:
            continue
        fewer = sum(value < summary.mean for value in people)
        place = inside if min(people) <= summary.mean <= max(people) else (
            above if summary.mean > max(people) else below)  # fmt: skip
        place.append(group.label)
        told.append(
            f"{group.label}: {in_words(summary.mean, score)}, people {in_words(min(people), score)}"
            f" to {in_words(max(people), score)} (higher than {fewer} of {len(people)} people)"
        )
    parts = [
        f"{words} in {_groups(groups, len(told))}"
        for words, groups in (
            ("inside the range of the people", inside),
            ("above all of them", above),
            ("below all of them", below),
        )
        if groups
    ]
    if parts:
        yield Sentence(f"The {_lower(score.label)} is {', '.join(parts)}.", _some(told))


def _places(source: ReportSource) -> Iterator[Sentence]:
    for grid in source.grids:
        if grid.grid is None:
            continue
        means = []
        for i in range(grid.grid[0] * grid.grid[1]):
            per_group = [known(group.values(f"{grid.name}_{i}")) for group in source.groups]
            pooled = [float(np.mean(values)) for values in per_group if values]
            means.append(float(np.mean(pooled)) if pooled else np.nan)
        if np.isfinite(means).sum() < 2 or np.nanmax(means) == np.nanmin(means):
            continue
        low, high = int(np.nanargmin(means)), int(np.nanargmax(means))
        yield Sentence(
            f"{grid.label}: the hardest place is {_cell(low, grid)}, the easiest "
            f"{_cell(high, grid)}.",
            f"{means[low]:.2f} against {means[high]:.2f}, mean over {_count(source.groups)}",
        )


def _cell(index: int, grid: Measure) -> str:
    rows, columns = grid.grid or (1, 1)
    row, column = divmod(index, columns)
    if (rows, columns) != (3, 3):
        return f"row {row + 1}, column {column + 1}"
    words = (("top", "middle", "bottom")[row], ("left", "middle", "right")[column])
    return "the middle" if words == ("middle", "middle") else " ".join(words)


def _times(source: ReportSource, published: Published) -> Iterator[Sentence]:
    told, faster = [], []
    for group in source.groups:
        rows = group.events.dropna(subset=["latency_s", "success"])
        rows = rows[rows["success"].astype(bool)]
        if not len(rows):
            continue
        middle = float(rows["latency_s"].median())
        people = published.people_in(group.condition, "latency_s")
        text = f"{group.label}: {middle:.2f} s ({len(rows)} items)"
        if people:
            text += f", people {min(people):.2f} to {max(people):.2f} s"
            faster.append(middle < min(people))
        told.append((middle, text))
    if not told:
        return
    (low, low_text), (high, high_text) = min(told), max(told)
    labels = (low_text.partition(":")[0], high_text.partition(":")[0])
    text = f"Half of the successes come within {low:.2f} s"
    text += f" ({labels[0]}) to {high:.2f} s ({labels[1]})" if high - low > 0.005 else ""
    text += " of the item's coming"
    if faster and all(faster):
        text += "; all of the people are slower"
    yield Sentence(f"{text}.", _some([words for _, words in told]))


def _tiring(source: ReportSource) -> Iterator[Sentence]:
    measure = source.measure("max_fatigued")
    if measure is None or len(source.groups) < 2:
        return
    found = [(g, s) for g in source.groups if (s := summary_of(g, measure.name)) is not None]
    if len(found) < 2:
        return
    ordered = sorted(found, key=lambda pair: pair[1].mean)
    (low_group, low), (high_group, high) = ordered[0], ordered[-1]
    if f"{high.mean:.3f}" == f"{low.mean:.3f}":
        yield Sentence(
            "All tire the muscles alike.",
            f"largest share of fatigued motor units, mean of the muscles: {high.mean:.3f}",
        )
        return
    yield Sentence(
        f"{high_group.label} tires the muscles most, {low_group.label} least.",
        f"largest share of fatigued motor units, mean of the muscles: {high.mean:.3f} against "
        f"{low.mean:.3f}",
    )


def _muscles(source: ReportSource, loads: Sequence[Load | None]) -> Iterator[Sentence]:
    told = [(g, load) for g, load in zip(source.groups, loads, strict=True) if load is not None]
    if not told:
        return
    group, load = max(told, key=lambda pair: float(pair[1].values.max()))
    order = np.argsort(-load.values)[:3]
    names = _list([load.names[i] for i in order])
    numbers = ", ".join(f"{load.names[i]} {load.values[i]:.2f}" for i in order)
    verb = "The most tired muscles are" if load.fatigue else "Most is asked of"
    yield Sentence(f"{verb} {names} (in {group.label}).", f"{load.what}: {numbers}")


def _effort(source: ReportSource) -> Iterator[Sentence]:
    shares = [(effort_share(group), group.label) for group in source.groups]
    found = [(share, label) for share, label in shares if share is not None]
    if not found:
        return
    low, high = min(found), max(found)
    if len(found) == 1 or f"{low[0]:.1%}" == f"{high[0]:.1%}":
        text = f"Effort costs {high[0]:.0%} of the game's reward."
    else:
        text = (
            f"Effort takes the largest share of the game's reward in {high[1]}, the smallest in "
            f"{low[1]}."
        )
    yield Sentence(text, _some([f"{label}: {share:.1%}" for share, label in found]))


def _tests(source: ReportSource) -> Iterator[Sentence]:
    shown = 0
    for result in source.comparisons:
        p = result.get("p_holm") if result.get("p_holm") is not None else result.get("p")
        difference = result.get("difference")
        if p is None or p >= _SIGNIFICANT or not difference or shown == _MOST_TESTS:
            continue
        shown += 1
        measure = source.measure(str(result["measure"]))
        label = measure.label if measure else str(result["measure"])
        first, second = result["levels"][:2]
        word = "higher" if difference["mean"] > 0 else "lower"
        where = place_of(result)
        yield Sentence(
            f"{label}: {word} in {first} than in {second}{where}.",
            test_numbers(result, measure),
        )


def place_of(result: Mapping[str, Any]) -> str:
    """Where a comparison was made: `` (game=easy)``; empty without other factors."""
    by = ", ".join(f"{name}={label}" for name, label in (result.get("by") or {}).items())
    return f" ({by})" if by else ""


def test_numbers(result: Mapping[str, Any], measure: Measure | None) -> str:
    """The numbers of a test, in a line."""
    parts = []
    difference = difference_words(result, measure, "()")
    if difference:
        parts.append(f"difference {difference}")
    if result.get("z") is not None:
        parts.append(f"Z = {result['z']:.3f}")
    if result.get("p") is not None:
        parts.append(f"p {_equal(p_words(result['p']))}")
    if result.get("p_holm") is not None and result.get("family", 1) > 1:
        parts.append(f"Holm p {_equal(p_words(result['p_holm']))}")
    parts.append(f"n = {counted_units(result)}")
    return ", ".join(parts)


def number(value: float, measure: Measure | None) -> str:
    """A number of a measure, with as many digits as the measure has."""
    return f"{value:.3g}" if measure is None else f"{value:,.{measure.digits}f}"


def difference_words(
    result: Mapping[str, Any], measure: Measure | None, brackets: Literal["[]", "()"]
) -> str:
    """The difference of a comparison with its interval; empty without one."""
    difference = result.get("difference")
    if not difference:
        return ""
    text = number(difference["mean"], measure)
    if difference.get("low") is not None:
        inside = f"{number(difference['low'], measure)} to {number(difference['high'], measure)}"
        text += f" [{inside}]" if brackets == "[]" else f" (95 % {inside})"
    return text


def counted_units(result: Mapping[str, Any]) -> str:
    """What n is and counts in a result: ``12 simulated persons``."""
    n, unit = result["n"], str(result.get("unit"))
    one = {
        "round": "round{} of one policy (no sample of people)",
        "person": "simulated person{}",
        "user": "trained user{}",
    }.get(unit, f"of {unit}")
    counts = ", ".join(map(str, n)) if isinstance(n, list) else str(n)
    return f"{counts} {one.format('' if n == 1 else 's')}"


def p_words(p: float) -> str:
    """A p value, not smaller than it is worth."""
    return "< .0001" if p < 1e-4 else f"{p:.4f}"


def _equal(p: str) -> str:
    return p if p.startswith("<") else f"= {p}"


def _lower(label: str) -> str:
    return label if label[:2].isupper() else label[:1].lower() + label[1:]


def _some(told: Sequence[str]) -> str:
    """What is told of groups, of the first ones only where there are many."""
    more = len(told) - _MOST_GROUPS
    return "; ".join([*told[:_MOST_GROUPS], *([f"and {more} more below"] if more > 0 else [])])


def _groups(names: Sequence[str], count: int) -> str:
    """Names of some of the groups, or their number where they are many."""
    return _list(names) if len(names) <= _MOST_GROUPS else f"{len(names)} of {count} groups"


def _list(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _count(groups: Sequence[Group]) -> str:
    return "one group" if len(groups) == 1 else f"{len(groups)} groups"
