"""Summary figure of a tracked recording: error over time, hand path, most loaded muscles."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.figures.figure import (
    GREY,
    INK,
    Bars,
    Figure,
    Layer,
    Line,
    Panel,
    Points,
    colour_of,
)
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.tools.track.postures import REACHED_M
from sim2vr_harness.tools.track.tracking import Tracked

_MUSCLES = 12


def draw(tracked: Tracked, out: Path) -> Path:
    """Draw a tracked recording into a PNG or PDF file."""
    right, up, ahead = "right (m)", "up (m)", "ahead (m)"
    panels = [
        Panel("Error", [*_errors(tracked)], "time (s)", "error of the hand (mm)",
              y_range=(0.0, 0.0), legend=True),
        _muscles(tracked),
        Panel("From behind", [*_paths(tracked, (0, 1))], right, up, square=True, legend=True),
        Panel("From above", [*_paths(tracked, (0, 2))], right, ahead, square=True, legend=True),
    ]  # fmt: skip
    title = f"{tracked.path.name}, tracked by {tracked.body.name}"
    return write_figure(Figure("tracking", title, "", panels), out)


def _hands(tracked: Tracked) -> Iterator[tuple[int, str, str]]:
    """Number, name and colour of the tracked hands."""
    wanted = tracked.followed.wanted
    for hand in np.flatnonzero(wanted.followed).tolist():
        yield hand, wanted.hands[hand].removeprefix("controller_"), colour_of(hand)


def _errors(tracked: Tracked) -> Iterator[Layer]:
    times = tracked.followed.times_s
    for hand, name, colour in _hands(tracked):
        errors = 1e3 * tracked.followed.errors_m[:, hand]
        median, most = np.median(errors), np.quantile(errors, 0.95)
        label = f"{name} hand: median {median:.0f} mm, 95 % {most:.0f} mm"
        yield Line(label, times, errors, colour, width=0.8)
        yield Line("median", times[[0, -1]], [median, median], colour, dashed=True, width=0.8)
        beyond = times[tracked.beyond_m[:, hand] > REACHED_M]
        if len(beyond):
            yield Points("beyond reach", beyond, np.zeros(len(beyond)), INK, symbol="x")


def _paths(tracked: Tracked, which: tuple[int, int]) -> Iterator[Layer]:
    for hand, name, colour in _hands(tracked):
        x, y = position_to_app(tracked.followed.targets[:, hand])[:, which].T
        yield Line("recorded", x, y, GREY, width=0.8)
        x, y = position_to_app(tracked.followed.places[1:, hand])[:, which].T
        yield Line(f"{name} hand, tracked", x, y, colour, width=0.8)


def _muscles(tracked: Tracked) -> Panel:
    loads = tracked.muscles[:_MUSCLES]
    names = [load.muscle for load in loads]
    bars = [
        Bars("mean", names, [load.mean for load in loads], colour_of(1)),
        Bars("95 % of the time below", names, [load.most for load in loads], colour_of(4)),
    ]
    return Panel("Most loaded muscles", bars, "activation", sideways=True, legend=True)
