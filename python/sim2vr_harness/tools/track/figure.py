"""Summary figure of a tracked recording: error over time, hand path, most loaded muscles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.files import naming
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.tools.track.postures import REACHED_M
from sim2vr_harness.tools.track.tracking import Tracked

__all__ = ["draw"]

_MUSCLES = 12
_COLOURS = {"controller_right": "C0", "controller_left": "C1"}


def draw(tracked: Tracked, out: Path) -> Path:
    """Draw a tracked recording into a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 8), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 3)
    _draw_errors(tracked, figure.add_subplot(grid[0, :]))
    _draw_path(tracked, figure.add_subplot(grid[1, 0]), (0, 1), ("right (m)", "up (m)"))
    _draw_path(tracked, figure.add_subplot(grid[1, 1]), (0, 2), ("right (m)", "ahead (m)"))
    _draw_muscles(tracked, figure.add_subplot(grid[1, 2]))
    out.parent.mkdir(parents=True, exist_ok=True)
    with naming(out):
        figure.savefig(out, dpi=100)
    return out


def _draw_errors(tracked: Tracked, axes: Any) -> None:
    followed = tracked.followed
    for hand in np.flatnonzero(followed.wanted.followed):
        name = followed.wanted.hands[hand]
        errors = 1e3 * followed.errors_m[:, hand]
        colour = _COLOURS[name]
        axes.plot(followed.times_s, errors, color=colour, linewidth=0.8)
        axes.axhline(np.median(errors), color=colour, linestyle="--", linewidth=0.8)
        words = f"{name.removeprefix('controller_')} hand: median {np.median(errors):.0f} mm, "
        axes.plot([], [], color=colour, label=f"{words}95 % {np.quantile(errors, 0.95):.0f} mm")
        beyond = tracked.beyond_m[:, hand] > REACHED_M
        if beyond.any():
            axes.plot(
                followed.times_s[beyond],
                np.zeros(beyond.sum()),
                "|",
                color="black",
                label="beyond reach",
            )
    axes.set(xlabel="time (s)", ylabel="error of the hand (mm)", ylim=(0.0, None))
    axes.set_title(f"{tracked.path.name}, followed by {tracked.body.name}", fontsize=10)
    axes.legend(fontsize=8, loc="upper right")


def _draw_path(tracked: Tracked, axes: Any, which: tuple[int, int], words: tuple[str, str]) -> None:
    followed = tracked.followed
    for hand in np.flatnonzero(followed.wanted.followed):
        wanted = position_to_app(followed.targets[:, hand])
        reached = position_to_app(followed.places[1:, hand])
        colour = _COLOURS[followed.wanted.hands[hand]]
        axes.plot(*wanted[:, which].T, color="#a0a0a0", linewidth=0.6, label="recorded")
        axes.plot(*reached[:, which].T, color=colour, linewidth=0.6, label="followed")
    axes.set(xlabel=words[0], ylabel=words[1], aspect="equal")
    axes.legend(fontsize=8)


def _draw_muscles(tracked: Tracked, axes: Any) -> None:
    loads = tracked.muscles[:_MUSCLES][::-1]
    rows = np.arange(len(loads))
    axes.barh(rows, [load.most for load in loads], color="#e8c0c0", label="95 % of the time below")
    axes.barh(rows, [load.mean for load in loads], color="#c03030", label="mean")
    axes.set_yticks(rows, [load.muscle for load in loads], fontsize=8)
    axes.set(xlabel="activation", xlim=(0.0, 1.0))
    if loads:
        axes.legend(fontsize=8, loc="lower right")
