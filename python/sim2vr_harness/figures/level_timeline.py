"""A level as a picture: what comes when, and where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import Timeline, TimelineItem

_STRIP_S = 15.0
"""Seconds in one strip of the picture."""
_MOST_STRIPS = 40
_STRIP_INCHES = (14.0, 2.6)
_MARKERS = {"box": ("s", 90.0), "disc": ("o", 70.0), "dot": ("o", 14.0)}
"""Marker and its area in square points, by shape."""
_ARROW_INCHES = 0.11


def draw_timeline(timeline: Timeline, out: Path) -> Path:
    """Draw a level into a PNG file, in strips of 15 s: lanes upwards, time to the right.

    Thin vertical lines are beats. Arrows show directions; what is wrong has a black ring. Of a
    level of more than ten minutes the first ten are drawn.

    Raises:
        InputError: ``out`` is no PNG.
    """
    if out.suffix.lower() != ".png":
        raise InputError("--out", repr(str(out)), "a file name that ends in .png")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    count = min(max(1, math.ceil(timeline.length_s / _STRIP_S - 1e-6)), _MOST_STRIPS)
    width, height = _STRIP_INCHES
    figure = Figure(figsize=(width, height * count + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    for number in range(count):
        axes = figure.add_subplot(count, 1, number + 1)
        _draw_strip(axes, timeline, number * _STRIP_S)
    figure.suptitle(f"{timeline.name}, {timeline.length_s:.1f} s")
    _add_legend(figure, timeline.items)
    figure.axes[-1].set_xlabel("time (s)")
    figure.savefig(out, dpi=80)
    return out


def _draw_strip(axes: Any, timeline: Timeline, start_s: float) -> None:
    end_s = start_s + _STRIP_S
    axes.set(xlim=(start_s - 0.2, end_s + 0.2), ylim=(-0.6, len(timeline.lanes) - 0.4))
    axes.set_yticks(range(len(timeline.lanes)), timeline.lanes, fontsize=7)
    axes.grid(axis="y", color="#e8e8e8", linewidth=0.5)
    axes.set_axisbelow(True)
    for index, beat_s in enumerate(timeline.beats_s):
        if start_s - 0.2 <= beat_s <= end_s + 0.2:
            strong = index % 4 == 0
            axes.axvline(beat_s, color="#b0b0b0" if strong else "#dcdcdc", linewidth=0.7, zorder=0)
    axes.axvline(timeline.length_s, color="black", linewidth=1.0)
    inside = [
        item
        for item in timeline.items
        if item.time_s + item.duration_s >= start_s - 0.2 and item.time_s <= end_s + 0.2
    ]
    _draw_bars(axes, [item for item in inside if item.shape == "bar"])
    _draw_markers(axes, [item for item in inside if item.shape != "bar"])


def _draw_bars(axes: Any, items: Sequence[TimelineItem]) -> None:
    """Draw what is visible of the bars, equal ones once: a map may have thousands of walls."""
    from matplotlib.collections import PolyCollection

    first, last = axes.get_xlim()
    visible: dict[tuple[float, float, float, float, str], None] = {}
    for item in items:
        start = max(item.time_s, first)
        end = min(item.time_s + max(item.duration_s, 0.02), last)
        visible[start, end, item.lane - 0.5, item.lane - 0.5 + item.lanes, item.color] = None
    corners = [[(a, low), (b, low), (b, high), (a, high)] for a, b, low, high, _ in visible]
    colors = [color for *_, color in visible]
    axes.add_collection(PolyCollection(corners, facecolors=colors, edgecolors=colors, alpha=0.35))


def _draw_markers(axes: Any, items: Sequence[TimelineItem]) -> None:
    for shape, (marker, area) in _MARKERS.items():
        chosen = [item for item in items if item.shape == shape]
        times = [item.time_s for item in chosen]
        lanes = [item.lane for item in chosen]
        axes.scatter(times, lanes, s=area, c=[i.color for i in chosen], marker=marker, zorder=3)
    arrows = [item for item in items if item.arrow_deg is not None]
    if arrows:
        turns = [math.radians(item.arrow_deg or 0.0) for item in arrows]
        axes.quiver(
            [item.time_s for item in arrows],
            [item.lane for item in arrows],
            [math.cos(turn) for turn in turns],
            [math.sin(turn) for turn in turns],
            pivot="middle",
            color="white",
            zorder=4,
            units="inches",
            scale_units="inches",
            scale=1.0 / _ARROW_INCHES,
            width=0.016,
            headwidth=4.0,
            headlength=4.0,
            headaxislength=3.5,
        )
    wrong = [item for item in items if item.marked]
    axes.scatter(
        [item.time_s for item in wrong],
        [item.lane for item in wrong],
        s=220.0,
        facecolors="none",
        edgecolors="black",
        linewidths=1.5,
        zorder=5,
    )


def _add_legend(figure: Any, items: Sequence[TimelineItem]) -> None:
    from matplotlib.lines import Line2D

    kinds = {item.kind: item for item in items}
    handles = [
        Line2D(
            [],
            [],
            linestyle="none",
            color=item.color,
            marker=_MARKERS.get(item.shape, ("|", 0.0))[0],
            label=kind,
        )
        for kind, item in kinds.items()
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), fontsize=8)
