"""Output files of ``sim2vr-harness rewards``: a table, a page and a picture."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim2vr_harness.base.files import naming
from sim2vr_harness.figures.figure import Figure, Line, Panel, colour_of
from sim2vr_harness.figures.html import save_page, table
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.tools.rewards.contributions import APPROACHES, EFFORTS, Contributions


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
    figure = Figure("rewards", f"Reward of {found.reward.name}", "", _panels(found))
    picture = write_figure(figure, out / "rewards.png")
    return [_csv(found, out), _page(found, warnings, out), picture]


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
    parts = [
        f"<p>A movement to one target of <b>{_escaped(reward.name)}</b>, {reward.start_m:g} m "
        f"away, in {reward.seconds:g} s. Effort: {found.effort_name}, weight "
        f"{found.effort_weight:g}.</p>",
        told or "<p>Nothing looks out of proportion.</p>",
        table(*sums(found)),
        *_panels(found),
    ]
    return save_page(out / "rewards.html", f"Reward of {reward.name}", parts)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")


def _panels(found: Contributions) -> list[Panel]:
    """The terms over time, one panel per approach; effort, and the distance to the target."""
    times = found.times_s
    panels = [
        Panel(
            f"{approach} approach: {found.total(approach):.3g}",
            [
                Line(term.name, times, found.terms[approach][term.name], colour_of(k))
                for k, term in enumerate(found.reward.terms)
            ],
            "time (s)",
            "reward per user step",
            legend=True,
        )
        for approach in APPROACHES
    ]
    efforts = [
        Line(f"effort, {kind}", times, -found.efforts[kind], colour_of(k), dashed=True)
        for k, kind in enumerate(EFFORTS)
    ]
    distances = [
        Line(f"distance, {approach}", times, found.distances_m[approach], colour_of(8 + k))
        for k, approach in enumerate(APPROACHES)
    ]
    effort = f"effort, {found.effort_name}"
    panels.append(Panel(effort, efforts, "time (s)", "reward per user step", legend=True))
    panels.append(Panel("distance", distances, "time (s)", "distance (m)", legend=True))
    return panels
