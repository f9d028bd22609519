"""A comparison as pictures: latency, time to hit, and what is inside people's range."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.files import naming
from sim2vr_harness.human_comparison.measures import MEASURES
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson
from sim2vr_harness.human_comparison.reaction import Effect
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Source

__all__ = ["draw"]

_COLOURS = ("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b")
_PEOPLE = "0.55"
_DPI = 110


def draw(report: ComparisonReport, folder: Path) -> list[Path]:
    """Write ``latency.png``, ``time_to_hit.png`` and ``overview.png``; those that have content."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, make in (
        ("latency", _latency),
        ("time_to_hit", _time_to_hit),
        ("overview", _overview),
    ):
        figure = make(report)
        if figure is None:
            continue
        file = folder / f"{name}.png"
        with naming(file):
            figure.savefig(file, dpi=_DPI)
        files.append(file)
    return files


def _figure(rows: int, columns: int, width: float, height: float) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)


def _drawn(report: ComparisonReport, cell: Cell) -> list[tuple[Source, str]]:
    """Users who have played in a condition, with their colours."""
    return [
        (user, _COLOURS[i % len(_COLOURS)])
        for i, user in enumerate(report.users)
        if user.persons.get(cell)
    ]


def _cells(report: ComparisonReport) -> list[Cell]:
    """Conditions that people and a user have played, in the order of the tables."""
    return [
        (group, condition)
        for group in report.behaviour.groups
        for condition in report.behaviour.conditions
        if report.people.persons.get((group, condition)) and _drawn(report, (group, condition))
    ]


def _latency(report: ComparisonReport) -> Any:
    cells = [cell for cell in _cells(report) if cell[1] in report.behaviour.one_target]
    if not cells:
        return None
    figure, axes = _figure(1, len(cells), 5.5 * len(cells), 4.0)
    for axis, cell in zip(axes[0], cells, strict=True):
        for i, curve in enumerate(_curves(report.people.persons[cell])):
            label = "people" if i == 0 else None
            axis.plot(Effect.times_s(), curve, color=_PEOPLE, linewidth=0.9, label=label)
        for user, colour in _drawn(report, cell):
            curves = _curves(user.persons[cell])
            for i, curve in enumerate(curves):
                alone = len(curves) == 1
                axis.plot(
                    Effect.times_s(),
                    curve,
                    color=colour,
                    linewidth=2.0 if alone else 0.9,
                    marker="." if alone else None,
                    label=user.name if i == 0 else None,
                )
        axis.axvline(0.0, color="black", linewidth=0.7)
        axis.set_title(", ".join(cell), fontsize=10)
        axis.set_xlabel("time after the target came up (s)")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    axes[0][0].set_ylabel("effect of the target's place on\nthe tool's velocity (m/s per m)")
    return figure


def _curves(persons: Sequence[RecordedPerson]) -> list[Any]:
    found = [person.effect.curve() for person in persons if person.effect is not None]
    return [curve for curve in found if curve is not None]


def _time_to_hit(report: ComparisonReport) -> Any:
    cells = _cells(report)
    if not cells:
        return None
    groups = list(dict.fromkeys(group for group, _ in cells))
    conditions = [c for c in report.behaviour.conditions if any(c == own for _, own in cells)]
    figure, axes = _figure(len(groups), len(conditions), 2.6 * len(conditions), 2.6 * len(groups))
    for row, group in enumerate(groups):
        for column, condition in enumerate(conditions):
            axis, cell = axes[row][column], (group, condition)
            axis.set_title(f"{group}, {condition}", fontsize=9)
            axis.grid(alpha=0.3)
            for i, person in enumerate(report.people.persons.get(cell, ())):
                _steps(axis, person, _PEOPLE, 0.8, "people" if i == 0 else None)
            for user, colour in _drawn(report, cell):
                persons = user.persons[cell]
                for i, person in enumerate(persons):
                    width = 2.0 if len(persons) == 1 else 0.8
                    _steps(axis, person, colour, width, user.name if i == 0 else None)
        axes[row][0].set_ylabel("share of the hits")
    for axis in axes[-1]:
        axis.set_xlabel("time to hit (s)")
    handles = {
        label: handle
        for axis in axes.flat
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), fontsize=8, loc="outside lower center", ncols=4)
    return figure


def _steps(axis: Any, person: RecordedPerson, colour: str, width: float, label: str | None) -> None:
    times = np.sort(person.samples.get("tth", np.zeros(0)))
    if len(times):
        share = np.arange(1, len(times) + 1) / len(times)
        axis.step(times, share, where="post", color=colour, linewidth=width, label=label)


def _overview(report: ComparisonReport) -> Any:
    """A square per measure and condition: inside people's range, or how far outside."""
    from matplotlib.colors import ListedColormap

    columns = [(c, cell) for c in report.compared for cell in _cells(report) if cell in c.persons]
    if not columns:
        return None
    measures = [m for m in MEASURES if any(row.measure == m for row in report.rows())]
    shown = np.full((len(measures), len(columns)), np.nan)
    for k, (compared, cell) in enumerate(columns):
        rows = {row.measure: row for row in compared.rows if (row.group, row.condition) == cell}
        for i, measure in enumerate(measures):
            if measure in rows:
                row = rows[measure]
                shown[i, k] = 0 if row.inside > 0.5 else 1 + (row.distance > 2) + (row.distance > 5)
    figure, axes = _figure(1, 1, 3.5 + 0.32 * len(columns), 1.6 + 0.17 * len(measures))
    axis = axes[0][0]
    colours = ListedColormap(["#4c9f70", "#f2d9a2", "#e79a6b", "#b8383d"])
    axis.imshow(shown, cmap=colours, vmin=0, vmax=3, aspect="auto")
    axis.set_yticks(range(len(measures)), [m.name for m in measures], fontsize=7)
    labels = [f"{compared.name}: {', '.join(cell)}" for compared, cell in columns]
    axis.set_xticks(range(len(columns)), labels, fontsize=7, rotation=90)
    for i in range(1, len(measures)):
        if measures[i].family != measures[i - 1].family:
            axis.axhline(i - 0.5, color="white", linewidth=2)
    for k in range(1, len(columns)):
        if columns[k][0] is not columns[k - 1][0]:
            axis.axvline(k - 0.5, color="white", linewidth=2)
    from matplotlib.patches import Patch

    meaning = ("inside people's range", "outside, distance to 2", "to 5", "beyond 5")
    figure.legend(
        handles=[Patch(color=colours(i), label=text) for i, text in enumerate(meaning)],
        loc="outside upper center",
        ncols=2,
        fontsize=8,
    )
    return figure
