"""Figures of a comparison: latency, time to hit, and measures relative to people's range."""

from collections.abc import Callable, Sequence

import numpy as np

from sim2vr_harness.figures.figure import (
    GREY,
    Figure,
    Layer,
    Line,
    Numbers,
    Panel,
    Points,
    Ranges,
    colour_of,
)
from sim2vr_harness.human_comparison.comparing import ComparisonRow
from sim2vr_harness.human_comparison.fitts import STUDIES, Spread
from sim2vr_harness.human_comparison.measures import plain
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson
from sim2vr_harness.human_comparison.reaction import Effect
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Source

_BEYOND = 1.5
"""Of people's range, which is shown below and above it."""
_MOST_ROWS = 12
"""Measures that are shown first where the game names none."""

_MEAN = "mean ± SD over participants"

_Curve = Callable[[RecordedPerson], tuple[Numbers, Numbers] | None]


def figures_of(report: ComparisonReport) -> list[Figure]:
    """Return the figures that have content; the first one is the answer."""
    found = (_beside(report), _movement_time(report), _time_to_hit(report), _latency(report))
    return [each for each in found if each is not None]


def main_rows(report: ComparisonReport) -> list[list[ComparisonRow | None]]:
    """Return the main measures, each with an entry per user."""
    rows = [
        {(row.group, row.condition, row.measure.name): row for row in compared.rows}
        for compared in report.compared
    ]
    keys = dict.fromkeys(key for own in rows for key in own)
    main = [key for place in report.behaviour.headlines for key in keys if key[1:] == place]
    return [[own.get(key) for own in rows] for key in (main or list(keys)[:_MOST_ROWS])]


def row_name(row: ComparisonRow, report: ComparisonReport) -> str:
    """Return a measure's short name, with condition and group where there are several."""
    name = row.measure.label.partition(":")[0].partition(";")[0]
    rows = report.rows()
    for part in ("condition", "group"):
        if len({getattr(each, part) for each in rows}) > 1:
            name += f", {getattr(row, part)}"
    return name


def _cells(report: ComparisonReport) -> list[Cell]:
    """Return conditions that people and a user have played, in the order of the tables."""
    return [
        (group, condition)
        for group in report.behaviour.groups
        for condition in report.behaviour.conditions
        if report.people.persons.get((group, condition))
        and any(user.persons.get((group, condition)) for user in report.users)
    ]


def _layers(report: ComparisonReport, cell: Cell, curve: _Curve, *, stepped: bool) -> list[Layer]:
    """Return a line per person: people's in grey, behind those of the users."""
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
    text = (
        "How strongly the target's place steers the hand, after it came up: the earlier a curve "
        "rises, the faster the reaction. Grey: people."
    )
    return Figure("latency", "Visuomotor latency", text, panels, same_axes=True)


def _time_to_hit(report: ComparisonReport) -> Figure | None:
    def curve(person: RecordedPerson) -> tuple[Numbers, Numbers] | None:
        times = np.sort(person.samples.get("tth", np.zeros(0)))
        return (times, np.arange(1, len(times) + 1) / len(times)) if len(times) else None

    panels = [
        Panel(", ".join(cell), layers, "time to hit (s)", "proportion of the hits", legend=True)
        for cell in _cells(report)
        if (layers := _layers(report, cell, curve, stepped=True))
    ]  # fmt: skip
    text = "A curve further to the left is of faster hits; a line per participant. Grey: people."
    return Figure("time_to_hit", "Time to hit", text, panels, same_axes=True) if panels else None


def _beside(report: ComparisonReport) -> Figure | None:
    """Return the main measures of all users on a scale from people's least to their greatest."""
    rows = [
        (first, own)
        for own in main_rows(report)
        if (first := next(row for row in own if row is not None)).people_low is not None
        and first.people_high is not None
        and first.people_high > first.people_low
    ]
    if not rows:
        return None
    places = [float(place) for place in range(len(rows))]
    ranges = [f"people: {first.people_range}" for first, _ in rows]
    layers: list[Layer] = [
        Ranges("people", places, [0.0] * len(rows), [1.0] * len(rows), text=ranges)
    ]
    for index, compared in enumerate(report.compared):
        at, values, texts = [], [], []
        for place, (first, own) in zip(places, rows, strict=True):
            if (row := own[index]) is not None:
                low, high = first.people_low or 0.0, first.people_high or 0.0
                at.append(place)
                values.append(
                    float(np.clip((row.value - low) / (high - low), -_BEYOND, 1 + _BEYOND))
                )
                texts.append(f"{compared.name}: {plain(row.value)} {row.measure.unit}")
        layers.append(Points(compared.name, at, values, colour_of(index), 11, text=texts))
    names = [row_name(first, report) for first, _ in rows]
    panel = Panel(
        "", layers, "", "people's range: 0 to 1", ticks=names, legend=True,
        y_range=(-_BEYOND - 0.2, 1.2 + _BEYOND),  # whole dots at the ends
    )  # fmt: skip
    caption = (
        "A dot on the grey bar lies between the lowest (0) and the highest (1) of the recorded "
        "people; one at an end of the scale may lie further out."
    )
    return Figure("measures", "Users and people's range", caption, [panel])


def _movement_time(report: ComparisonReport) -> Figure | None:
    """Movement time, throughput and errors over the index of difficulty.

    Means over persons with their standard deviations; lines are MT = a + b ID of the means, dashed
    ones are published of people.
    """
    if not report.laws:
        return None
    times: list[Layer] = []
    throughputs: list[Layer] = []
    rates: list[Layer] = []
    for number, (user, law) in enumerate(report.laws.items()):
        bits, colour, line = [row.bits for row in law.rows], colour_of(number), law.line
        label = user
        if line is not None:
            label += f": {line.a_s:.2f} s + {line.b_s_per_bit:.2f} s/bit, R2 = {line.r2:.2f}"
            times.append(_straight(label, line.a_s, line.b_s_per_bit, bits, colour))
        for layers, key in (
            (times, "movement_time_s"),
            (throughputs, "throughput_bps"),
            (rates, "error_rate"),
        ):
            found: list[Spread] = [getattr(row, key) for row in law.rows]
            means, sds = [row.mean for row in found], [row.sd for row in found]
            spread = None if None in sds else sds
            name = label if layers is times else user
            layers.append(Points(name, bits, means, colour, spread=spread, key=_MEAN))
            if layers is not times:
                layers.append(Line(label, bits, means, colour))
    every = [row.bits for law in report.laws.values() for row in law.rows]
    times += [
        _straight(f"people: {s.label}", s.a_s, s.b_s_per_bit, every, GREY, dashed=True)
        for s in STUDIES
        if s.a_s is not None and s.b_s_per_bit is not None
    ]
    x = "index of difficulty (bits)"
    panels = [
        Panel("Movement time", times, x, "movement time (s)", y_range=(0.0, 0.0), legend=True),
        Panel("Throughput", throughputs, x, "throughput of a block (bits/s)", y_range=(0.0, 0.0)),
        Panel("Errors", rates, x, "proportion of errors", y_range=(-0.03, 1.03)),
    ]
    text = (
        "Harder targets (more bits) take longer; users on a dashed line take as long as the people "
        "of that publication."
    )
    return Figure("movement_time", "Aimed movements", text, panels)


def _straight(
    name: str, a_s: float, b: float, bits: Sequence[float], colour: str, *, dashed: bool = False
) -> Line:
    """MT = a + b ID over the indices that were played."""
    ends = [min(bits), max(bits)]
    return Line(name, ends, [a_s + b * end for end in ends], colour, dashed=dashed)
