"""Learning curves of runs, from their ``metrics.jsonl``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.run_folder import RunFolder

__all__ = ["curve", "plot"]

PANELS: tuple[tuple[str, str], ...] = (
    ("rollout/ep_rew_mean", "Return per round"),
    ("rollout/ep_hit_rate", "Hit rate"),
    ("rollout/ep_Points_mean", "Hits per round"),
    ("rollout/ep_effort_cost_mean", "Effort per round"),
    ("train/std", "Standard deviation of actions"),
    ("train/approx_kl", "Approximate KL divergence"),
)


def curve(rows: Sequence[dict[str, Any]], key: str) -> tuple[list[float], list[float]]:
    """Return steps and values of one metric; rows without it are left out."""
    points = [(row["step"], row[key]) for row in rows if row.get(key) is not None]
    return [point[0] for point in points], [point[1] for point in points]


def plot(runs: Sequence[Path], out: Path) -> Path:
    """Draw the learning curves of one or more runs into a PNG file.

    Args:
        runs: Folders of runs.
        out: The file to write.

    Raises:
        InputError: A folder is not a run's or has no finished iteration, or ``out`` is no PNG.
    """
    if out.suffix.lower() != ".png":
        raise InputError("--out", repr(str(out)), "a file name that ends in .png")
    named = []
    for run in runs:
        folder = RunFolder.open(run)
        rows = folder.metrics()
        if not rows:
            raise InputError("RUN", f"{str(run)!r}, which has no metrics yet", "a trained run")
        named.append((folder.path.name, rows))
    _draw(named, out)
    return out


def _draw(named: Sequence[tuple[str, list[dict[str, Any]]]], out: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (key, title) in zip(figure.subplots(2, 3).flat, PANELS, strict=True):
        for name, rows in named:
            steps, values = curve(rows, key)
            marker = "o" if len(steps) < 30 else None
            axes.plot([step / 1e6 for step in steps], values, marker=marker, ms=3, label=name)
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("user steps (million)", fontsize=8)
        axes.grid(alpha=0.3)
        axes.tick_params(labelsize=8)
    figure.axes[0].legend(fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=120)
