"""A comparison as pictures: latency, time to hit, and what is inside people's range."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np

from sim2vr_harness.figures.figure import (
    GREY,
    Figure,
    Heat,
    Layer,
    Line,
    Numbers,
    Panel,
    Points,
    Ranges,
    colour_of,
)
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.human_comparison.comparing import Compared, ComparisonRow
from sim2vr_harness.human_comparison.measures import FAMILIES, MEASURES, SESSION_MEASURES
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson
from sim2vr_harness.human_comparison.reaction import Effect
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Source

_FAR = 5.0
"""The distance from where on colours are the same."""

_Curve = Callable[[RecordedPerson], tuple[Numbers, Numbers] | None]


def draw(report: ComparisonReport, folder: Path) -> list[Path]:
    """Write ``latency``, ``time_to_hit``, ``measures``, ``overview``.png; those with content."""
    figures = (_latency(report), _time_to_hit(report), _headlines(report), _overview(report))
    return [write_figure(each, folder / f"{each.key}.png") for each in figures if each is not None]


def _cells(report: ComparisonReport) -> list[Cell]:
    """Conditions that people and a user have played, in the order of the tables."""
    return [
        (group, condition)
        for group in report.behaviour.groups
        for condition in report.behaviour.conditions
        if report.people.persons.get((group, condition))
        and any(user.persons.get((group, condition)) for user in report.users)
    ]


def _layers(report: ComparisonReport, cell: Cell, curve: _Curve, *, stepped: bool) -> list[Layer]:
    """A line per person: people's in grey, behind those of the users."""
    sources: list[tuple[Source, str]] = [(report.people, GREY)]
    sources += [(user, colour_of(i)) for i, user in enumerate(report.users)]
    layers: list[Layer] = []
    for source, colour in sources:
        name = "people" if source is report.people else source.name
        curves = [found for p in source.persons.get(cell, ()) if (found := curve(p)) is not None]
        width = 2.0 if len(curves) == 1 and source is not report.people else 0.9
        layers += [Line(name, x, y, colour, stepped=stepped, width=width) for x, y in curves]
    return layers


def _latency(report: ComparisonReport) -> Figure | None:
    def curve(person: RecordedPerson) -> tuple[Numbers, Numbers] | None:
        found = None if person.effect is None else person.effect.curve()
        return None if found is None else (Effect.times_s(), found)

    x = "time after the target came up (s)"
    y = "effect of the target's place on\nthe tool's velocity (m/s per m)"
    panels = []
    for cell in _cells(report):
        if cell[1] in report.behaviour.one_target:
            layers = _layers(report, cell, curve, stepped=False)
            if layers:
                panels.append(Panel(", ".join(cell), layers, x, y, legend=True))
    if not panels:
        return None
    return Figure("latency", "Visuomotor latency", "", panels, same_axes=True)


def _time_to_hit(report: ComparisonReport) -> Figure | None:
    def curve(person: RecordedPerson) -> tuple[Numbers, Numbers] | None:
        times = np.sort(person.samples.get("tth", np.zeros(0)))
        return (times, np.arange(1, len(times) + 1) / len(times)) if len(times) else None

    panels = [
        Panel(", ".join(cell), layers, "time to hit (s)", "proportion of the hits", legend=True)
        for cell in _cells(report)
        if (layers := _layers(report, cell, curve, stepped=True))
    ]  # fmt: skip
    return Figure("time_to_hit", "Time to hit", "", panels, same_axes=True) if panels else None


def _headlines(report: ComparisonReport) -> Figure | None:
    """Of sessions: what is shown first, people's range behind the users' points."""

    def both(rows: Sequence[ComparisonRow]) -> Iterator[tuple[int, tuple[Compared, ComparisonRow]]]:
        return enumerate(zip(report.compared, rows, strict=True))

    panels = []
    for condition, name in report.behaviour.headlines if report.behaviour.any_app else ():
        rows = [
            row
            for compared in report.compared
            for row in compared.rows
            if (row.condition, row.measure.name) == (condition, name)
        ]
        if len(rows) != len(report.compared):
            continue
        first, n = rows[0], len(rows)
        places = [float(i) for i in range(n + 1)]
        low, high = [first.people_low] * (n + 1), [first.people_high] * (n + 1)
        layers: list[Layer] = [Ranges("people", places, low, high)]
        layers += [Points(c.name, [i], [r.value], colour_of(i)) for i, (c, r) in both(rows)]
        layers.append(Points("people", [n], [first.people_mean], GREY))
        unit = f" ({first.measure.unit})" if first.measure.unit else ""
        ticks = [*(compared.name for compared in report.compared), "people"]
        panels.append(
            Panel(condition, layers, "", f"{fill(first.measure.label, 30)}{unit}", ticks=ticks)
        )
    return (
        Figure("measures", "Measures of users and people's range", "", panels) if panels else None
    )


def _overview(report: ComparisonReport) -> Figure | None:
    """A row per measure: 0 inside people's range, or the distance from people's mean."""
    columns = [(c, cell) for c in report.compared for cell in _cells(report) if cell in c.persons]
    if not columns or all(row.distance is None for row in report.rows()):
        return None
    found = {
        (compared.name, row.group, row.condition, row.measure): row
        for compared in report.compared
        for row in compared.rows
    }
    rows: list[str] = []
    values: list[list[float | None]] = []
    for family in FAMILIES:
        every = (*MEASURES, *SESSION_MEASURES)
        shown = [m for m in every if m.family == family and any(m == key[3] for key in found)]
        for measure in shown:
            beside = [found.get((compared.name, *cell, measure)) for compared, cell in columns]
            values.append([None if row is None else _outside(row) for row in beside])
        rows += [f"{family}: {measure.label}" for measure in shown]
    labels = [f"{compared.name}: {', '.join(cell)}" for compared, cell in columns]
    heat = Heat(values, labels, rows, 0.0, _FAR, digits=1)
    panel = Panel("0: inside people's range", [heat], wide=True, rows=len(rows))
    title = "Distance from people's mean, relative to a person's from the others"
    return Figure("overview", title, "", [panel])


def _outside(row: ComparisonRow) -> float | None:
    return row.distance if row.inside is None or row.inside <= 0.5 else 0.0
