"""Learning curves of runs, from what their stages have written down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.run_folder import RunFolder, read_rows

__all__ = ["curve", "plot"]

PANELS: tuple[tuple[str, str], ...] = (
    ("rollout/ep_rew_mean", "Return per round"),
    ("rollout/ep_hit_rate", "Hit rate"),
    ("rollout/ep_Points_mean", "Hits per round"),
    ("rollout/ep_effort_cost_mean", "Effort per round"),
    ("train/std", "Standard deviation of actions"),
    ("train/approx_kl", "Approximate KL divergence"),
)


Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class _Run:
    """What a run has written down: each stage's rows, empty where there is none."""

    name: str
    practice: Rows
    student: Rows
    rows: Rows


def curve(rows: Rows, key: str) -> tuple[list[float], list[float]]:
    """Return steps and values of one metric; rows without it are left out."""
    points = [(row["step"], row[key]) for row in rows if row.get(key) is not None]
    return [point[0] for point in points], [point[1] for point in points]


def plot(runs: Sequence[Path], out: Path) -> Path:
    """Draw the learning curves of one or more runs into a PNG file.

    Runs of the distilled recipe get a row more: their teacher's practice and their student.

    Args:
        runs: Folders of runs.
        out: The file to write.

    Raises:
        InputError: A folder is not a run's or has no finished iteration, or ``out`` is no PNG.
    """
    if out.suffix.lower() != ".png":
        raise InputError("--out", repr(str(out)), "a file name that ends in .png")
    found = [_read(RunFolder.open(run)) for run in runs]
    for run, each in zip(runs, found, strict=True):
        if not (each.rows or each.practice or each.student):
            raise InputError("RUN", f"{str(run)!r}, which has no metrics yet", "a trained run")
    _draw(found, out)
    return out


def _read(folder: RunFolder) -> _Run:
    return _Run(
        name=folder.path.name,
        practice=read_rows(folder.path / "teacher" / "practice.jsonl"),
        student=read_rows(folder.path / "student" / "metrics.jsonl"),
        rows=folder.metrics(),
    )


def _draw(runs: Sequence[_Run], out: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    stages = any(run.practice or run.student for run in runs)
    height = 3 if stages else 2
    figure = Figure(figsize=(12, 3.5 * height), layout="constrained")
    FigureCanvasAgg(figure)
    grid = list(figure.subplots(height, 3).flat)
    if stages:
        _draw_stages(grid[:3], runs)
    for axes, (key, title) in zip(grid[3 * stages :], PANELS, strict=True):
        for run in runs:
            _line(axes, *curve(run.rows, key), label=run.name)
        _dress(axes, f"{title} (from pixels)" if stages else title)
    grid[0].legend(fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=120)


def _draw_stages(grid: Sequence[Any], runs: Sequence[_Run]) -> None:
    """The stages before the training from pixels: practice in the mind, then imitation."""
    for number, run in enumerate(runs):
        color = f"C{number % 10}"
        for key, style, where in (("imagined", "--", "in the mind"), ("played", "-", "in the app")):
            steps, values = [], []
            for row in run.practice:
                known = [rate for rate in row[key] if not math.isnan(rate)]
                if known:
                    steps.append(row["step"])
                    values.append(sum(known) / len(known))
            _line(grid[0], steps, values, style, color=color, label=f"{run.name}, {where}")
        for axes, key in (
            (grid[1], "student/imitation_error"),
            (grid[2], "rollout/ep_hit_rate"),
        ):
            _line(axes, *curve(run.student, key), color=color, label=run.name)
    _dress(grid[0], "Teacher: hit rate in practice")
    _dress(grid[1], "Student: difference to the teacher")
    _dress(grid[2], "Student: hit rate")


def _line(
    axes: Any, steps: Sequence[float], values: Sequence[float], style: str = "-", **how: Any
) -> None:
    marker = "o" if len(steps) < 30 else None
    axes.plot([step / 1e6 for step in steps], values, style, marker=marker, ms=3, **how)


def _dress(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("user steps (million)", fontsize=8)
    axes.grid(alpha=0.3)
    axes.tick_params(labelsize=8)
    axes.ticklabel_format(useOffset=False)
