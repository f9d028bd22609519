"""Output files of ``sim2vr-harness rewards``: a table, a page and a picture."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.files import naming
from sim2vr_harness.base.optional import needed
from sim2vr_harness.figures.figure import Figure, Line, Panel, colour_of
from sim2vr_harness.figures.html import save_page, table
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.tools.rewards.contributions import APPROACHES, EFFORTS, Contributions

__all__ = ["sums", "write"]

_COLORS = ("#2a6fd6", "#1a9e3f", "#e08a00", "#8b3fc4", "#c9211e", "#118a8a", "#777777")


def sums(found: Contributions) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the sums: terms and effort by approach."""
    header = ["", *APPROACHES]
    names = [term.name for term in found.reward.terms]
    rows = [
        [name, *(f"{found.total(approach, name):.3g}" for approach in APPROACHES)] for name in names
    ]
    rows.append(["game's reward", *(f"{found.total(approach):.3g}" for approach in APPROACHES)])
    for kind in EFFORTS[1:]:
        totals = [found.total(approach) - found.cost(kind) for approach in APPROACHES]
        rows.append([f"less {kind} effort", *(f"{total:.3g}" for total in totals)])
    return header, rows


def write(found: Contributions, warnings: Sequence[str], out: Path) -> list[Path]:
    """Write ``rewards.csv`` (a row per step and approach), ``rewards.html`` and ``rewards.png``."""
    out.mkdir(parents=True, exist_ok=True)
    return [_csv(found, out), _page(found, warnings, out), _picture(found, out)]


def _csv(found: Contributions, out: Path) -> Path:
    file = out / "rewards.csv"
    names = [term.name for term in found.reward.terms]
    with naming(file), file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(
            ["approach", "time_s", "distance_m", *names, *(f"effort, {kind}" for kind in EFFORTS)]
        )
        for approach in APPROACHES:
            columns = [found.times_s, found.distances_m[approach]]
            columns += [found.terms[approach][name] for name in names]
            columns += [found.efforts[kind] for kind in EFFORTS]
            writer.writerows([approach, *row] for row in np.stack(columns, axis=1).tolist())
    return file


def _page(found: Contributions, warnings: Sequence[str], out: Path) -> Path:
    reward = found.reward
    told = "".join(f'<p class="warn">{_escaped(line)}</p>' for line in warnings)
    parts: list[str | Any] = [
        f"<p>A movement to one target of <b>{_escaped(reward.name)}</b>, {reward.start_m:g} m "
        f"away, in {reward.seconds:g} s. Effort: {found.effort_name}, weight "
        f"{found.effort_weight:g}.</p>",
        told or "<p>Nothing looks out of proportion.</p>",
        table(*sums(found)),
        _figure(found),
    ]
    return save_page(out / "rewards.html", f"Reward of {reward.name}", parts)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")


def _figure(found: Contributions) -> Any:
    subplots = needed("plotly.subplots", "studies", "rewards")
    go = needed("plotly.graph_objects", "studies", "rewards")
    titles = [*(f"{name} approach" for name in APPROACHES), "effort"]
    figure = subplots.make_subplots(rows=len(titles), cols=1, subplot_titles=titles)
    for row, approach in enumerate(APPROACHES, start=1):
        for k, term in enumerate(found.reward.terms):
            figure.add_trace(
                go.Scatter(
                    x=found.times_s,
                    y=found.terms[approach][term.name],
                    name=term.name,
                    legendgroup=term.name,
                    showlegend=row == 1,
                    mode="lines+markers",
                    line={"color": _color(k)},
                ),
                row=row,
                col=1,
            )
    for k, kind in enumerate(EFFORTS):
        line = {"color": _color(k), "dash": "dot"}
        trace = go.Scatter(
            x=found.times_s, y=-found.efforts[kind], name=f"effort, {kind}", line=line
        )
        figure.add_trace(trace, row=len(titles), col=1)
    figure.update_xaxes(title_text="time (s)", row=len(titles), col=1)
    figure.update_yaxes(title_text="reward")
    figure.update_layout(
        height=260 * len(titles),
        margin={"l": 60, "r": 10, "t": 60, "b": 40},
        legend={"orientation": "h", "y": 1.04, "yanchor": "bottom"},
    )
    return figure


def _picture(found: Contributions, out: Path) -> Path:
    times = list(map(float, found.times_s))
    panels = [
        Panel(
            f"{approach}: {found.total(approach):.3g}",
            [
                Line(term.name, times, list(found.terms[approach][term.name]), _color(k))
                for k, term in enumerate(found.reward.terms)
            ],
            "time (s)",
            "reward per user step",
            legend=True,
        )
        for approach in APPROACHES
    ]
    efforts = [
        Line(f"effort, {kind}", times, list(-found.efforts[kind]), _color(k), dashed=True)
        for k, kind in enumerate(EFFORTS)
    ]
    distances = [
        Line(f"distance, {approach}", times, list(found.distances_m[approach]), colour_of(8 + k))
        for k, approach in enumerate(APPROACHES)
    ]
    effort = f"effort, {found.effort_name}"
    panels.append(Panel(effort, efforts, "time (s)", "reward per user step", legend=True))
    panels.append(Panel("distance", distances, "time (s)", "distance (m)", legend=True))
    figure = Figure("rewards", f"Reward of {found.reward.name}", "", panels)
    return write_figure(figure, out / "rewards.png")


def _color(index: int) -> str:
    return _COLORS[index % len(_COLORS)]
