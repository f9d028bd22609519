"""Figures of a search: progress or Pareto front, slices, parallel coordinates."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from sim2vr_harness.client import Measure
from sim2vr_harness.figures.figure import GREY, Figure, Layer, Line, Panel, Points, colour_of
from sim2vr_harness.figures.html import table
from sim2vr_harness.studies.config import ParameterConfig
from sim2vr_harness.studies.report.source import ReportSource, Search, in_words
from sim2vr_harness.studies.search import parameter_column

_KEEPS, _BEYOND, _BEST = colour_of(0), GREY, colour_of(1)
_MOST_NAMED = 6
"""Of the best trials in parallel coordinates, with a colour of their own."""


@dataclass(frozen=True)
class _Axis:
    """A parameter, or a measure, of all trials.

    Attributes:
        name: With its unit.
        values: Numbers; of levels their places; None where a trial has none.
        labels: The levels, of a parameter that has some.
        log: Whether tenfold is the same distance everywhere.
    """

    name: str
    values: list[float | None]
    labels: tuple[str, ...] = ()
    log: bool = False

    @property
    def ends(self) -> tuple[float, float]:
        if self.labels:
            return 0.0, len(self.labels) - 1.0
        known = [value for value in self.values if value is not None]
        return min(known), max(known)

    @property
    def tick(self) -> str:
        """Name, least and greatest, for a tick."""
        low, high = self.ends
        if self.labels:
            return f"{self.name}: {self.labels[0]} … {self.labels[-1]}"
        return f"{self.name}: {low:.3g} … {high:.3g}"

    def shares(self) -> list[float | None]:
        """From 0 at the least to 1 at the greatest."""
        low, high = self.ends
        values = self.values
        if self.log:
            low, high = float(np.log10(low)), float(np.log10(high))
            values = [None if v is None else float(np.log10(v)) for v in values]
        if high <= low:
            return [None if value is None else 0.5 for value in values]
        return [None if value is None else (value - low) / (high - low) for value in values]


def figures_of_search(source: ReportSource) -> Iterator[Figure]:
    """Yield what a search found; nothing of a study that is none."""
    search = source.search
    if search is None:
        return
    limits = _limits(search)
    rule = " Diamonds: the best."
    rule += f" Grey crosses: beyond a limit ({limits})." if limits else ""
    objectives = [_measure_axis(source, search, name) for name in search.wanted.objectives]
    if len(objectives) == 1:
        objective = objectives[0]
        numbers = _Axis("trial", [float(n) for n in search.trials["trial"]])
        (way,) = search.wanted.objectives.values()
        better = min if way == "min" else max
        best: float | None = None
        line: list[float | None] = []
        for value, keeps in zip(objective.values, search.trials["keeps_limits"], strict=True):
            if keeps and value is not None:
                best = value if best is None else better(best, value)
            line.append(best)
        progress = Panel(
            "",
            [
                Line("best so far", numbers.values, line, _BEST, stepped=True),
                *_points(search, numbers, objective),
            ],
            "trial",
            objective.name,
            legend=True,
            wide=True,
        )
        objectives_figure = Figure(
            "search",
            "The search",
            f"Every trial, and the best so far that keeps the limits.{rule}",
            [progress],
        )
    else:
        objectives_figure = Figure(
            "search",
            "The best compromises",
            "Every trial; on the line (the Pareto front) none is better in one objective without "
            f"being worse in another.{rule}",
            [
                _front(search, first, second)
                for k, first in enumerate(objectives)
                for second in objectives[k + 1 :]
            ],
        )
    yield objectives_figure
    parameters = [_parameter_axis(search, name) for name in search.wanted.parameters]
    constraints = [
        _measure_axis(source, search, name)
        for name in search.wanted.constraints
        if name not in search.wanted.objectives
    ]
    yield Figure(
        "search_slices",
        "What each parameter does",
        "Every trial by one of its parameters; the others differ too, so that a cloud may hide "
        f"what a parameter does by itself.{rule}",
        [
            _slice(search, parameter, measure)
            for measure in (*objectives, *constraints)
            for parameter in parameters
        ],
    )
    yield Figure(
        "search_parallel",
        "Parallel coordinates of all parameters",
        "A line per trial, from the least to the greatest value of each; the best are coloured.",
        [_parallel(search, [*parameters, *constraints, *objectives])],
    )


def _limits(search: Search) -> str:
    return ", ".join(limits.words(name) for name, limits in search.wanted.constraints.items())


def _measure_axis(source: ReportSource, search: Search, name: str) -> _Axis:
    measure = source.measure(name)
    return _Axis(measure.heading if measure else name, search.numbers(name))


def _parameter_axis(search: Search, name: str) -> _Axis:
    parameter = search.wanted.parameters[name]
    column = parameter_column(name)
    if parameter.levels is None:
        return _Axis(name, search.numbers(column), log=parameter.log)
    labels = tuple(parameter.factor.levels)
    places = [float(labels.index(value)) for value in search.trials[column]]
    return _Axis(name, list(places), labels)


def _kinds(search: Search) -> list[tuple[str, str, str, int, list[int]]]:
    """Name, colour, symbol and size of a kind of trials, and which they are; back to front."""
    chosen = list(map(bool, search.trials["chosen"]))
    keeps = list(map(bool, search.trials["keeps_limits"]))
    rows = range(len(chosen))
    kinds = [
        ("beyond a limit", _BEYOND, "x", 6, [i for i in rows if not keeps[i]]),
        ("keeps the limits", _KEEPS, "circle", 6, [i for i in rows if keeps[i] and not chosen[i]]),
        ("best", _BEST, "diamond", 10, [i for i in rows if chosen[i]]),
    ]
    return [kind for kind in kinds if kind[-1]]


def _points(search: Search, x: _Axis, y: _Axis) -> list[Layer]:
    layers: list[Layer] = []
    for name, colour, symbol, size, rows in _kinds(search):
        there = [i for i in rows if x.values[i] is not None and y.values[i] is not None]
        texts = [search.told(i) for i in there]
        layers.append(
            Points(
                name,
                [x.values[i] for i in there],
                [y.values[i] for i in there],
                colour,
                size,
                symbol,
                text=texts,
            )
        )
    return layers


def _front(search: Search, x: _Axis, y: _Axis) -> Panel:
    layers: list[Layer] = _points(search, x, y)
    if len(search.wanted.objectives) == 2:
        best = [
            (x.values[i] or 0.0, y.values[i] or 0.0)
            for i, is_best in enumerate(search.trials["chosen"])
            if is_best
        ]
        best.sort()
        layers.insert(0, Line("front", [a for a, _ in best], [b for _, b in best], _BEST))
    return Panel("", layers, x.name, y.name, legend=True, wide=True)


def _slice(search: Search, parameter: _Axis, measure: _Axis) -> Panel:
    ticks = parameter.labels or None
    return Panel("", _points(search, parameter, measure), parameter.name, measure.name, ticks)


def _parallel(search: Search, axes: Sequence[_Axis]) -> Panel:
    places = [float(k) for k in range(len(axes))]
    shares = [axis.shares() for axis in axes]
    chosen = list(map(bool, search.trials["chosen"]))
    numbers = [int(number) for number in search.trials["trial"]]
    layers: list[Layer] = []
    for i, is_best in enumerate(chosen):
        if not is_best:
            layers.append(Line("other trials", places, [share[i] for share in shares], "#d5d9de"))
    best = [i for i, is_best in enumerate(chosen) if is_best]
    for k, i in enumerate(best):
        name = f"trial {numbers[i]}" if len(best) <= _MOST_NAMED else "best"
        colour = colour_of(k) if len(best) <= _MOST_NAMED else _BEST
        layers.append(Line(name, places, [share[i] for share in shares], colour))
    return Panel(
        "",
        layers,
        "",
        "least to greatest",
        [axis.tick for axis in axes],
        y_range=(-0.05, 1.05),
        legend=True,
        wide=True,
    )


def search_sentences(source: ReportSource) -> Iterator[str]:
    """Yield sentences about the result of a search."""
    search = source.search
    if search is None:
        return
    trials, limits = search.trials, _limits(search)
    best = trials[trials["chosen"]]
    kept, stopped = int(trials["keeps_limits"].sum()), int((trials["state"] == "stopped").sum())
    wanted = {
        name: measure.label.lower() if (measure := source.measure(name)) else name
        for name in search.wanted.objectives
    }
    if not len(best):
        yield f"No trial keeps the limits ({limits}): nothing was found."
    elif len(wanted) == 1:
        ((name, way),) = search.wanted.objectives.items()
        row = best.iloc[0]
        least = "least" if way == "min" else "greatest"
        where = f" with {limits}" if limits else ""
        value = _value(row[name], source.measure(name))
        yield (
            f"Trial {row['trial']} has the {least} {wanted[name]}{where}, {value}: "
            f"{_settings(search, row)}."
        )
    else:
        names = " and ".join(wanted.values())
        yield f"{len(best)} trials are the best compromises between {names}."
    counts = f"{len(trials)} trials by {search.sampler}, {kept} keep the limits"
    yield f"{counts}{f', {stopped} trainings were stopped early' if stopped else ''}."
    if len(best):
        yield (
            "The best of many trials owes something to luck: played again, with other seeds, "
            "expect it to be a little less good."
        )


def _settings(search: Search, row: Any) -> str:
    return ", ".join(
        f"{name} {_shown(row, name, p)}" for name, p in search.wanted.parameters.items()
    )


def _shown(row: Any, name: str, parameter: ParameterConfig) -> str:
    value = row[parameter_column(name)]
    return str(value) if parameter.levels is not None else f"{value:.5g}"


def _value(value: Any, measure: Measure | None) -> str:
    """A mean with its unit; a dash without a number."""
    if value is None or not np.isfinite(value):
        return "–"
    return in_words(float(value), measure) if measure else f"{value:.4g}"


def trial_table(source: ReportSource) -> Markup:
    """Every trial: parameters, what it is judged by, what became of it."""
    search = source.search
    if search is None:
        return Markup()
    measures = {name: source.measure(name) for name in search.wanted.measures}
    headings = [
        "Trial",
        *search.wanted.parameters,
        *(measure.heading if measure else name for name, measure in measures.items()),
        "",
    ]
    rows = []
    for _, row in search.trials.iterrows():
        became = "best" if row["chosen"] else "" if row["keeps_limits"] else "beyond a limit"
        if row["state"] != "measured":
            became = str(row["state"])
        cells = [
            str(row["trial"]),
            *(_shown(row, name, p) for name, p in search.wanted.parameters.items()),
            *(_value(row[name], measure) for name, measure in measures.items()),
            became,
        ]
        rows.append([Markup("<b>{}</b>").format(cell) if row["chosen"] else cell for cell in cells])
    return Markup("<h3>Every trial</h3>") + table(headings, rows)
