"""Figures of strategy: the tool's depth over time, its paths, times and speeds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.figures.figure import Band, Figure, Layer, Line, Panel, Path, Points, colour_of
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.source import Group, ReportSource

FloatArray = NDArray[np.float64]

_AXES = ("x_m", "y_m", "z_m")
_WINDOW_S = 0.6
"""Around the moment of an outcome."""
_STEP_S = 0.05
_MOST_AREAS = 4
"""Groups whose quantiles can be told apart."""
_AREA = "10 % to 90 % quantile"
_BINS = 60
"""Of depth over time."""
_PATH_S = (2.0, 20.0)
"""The part of a round whose way is drawn; before it arms still rise from where they hung."""
_MOST_PLACES = 60
_DEVICES = ("head", "right", "left")


@dataclass(frozen=True)
class Depth:
    """Depth of the tool over time in one episode.

    Attributes:
        times_s: (T,) game time, s.
        values_m: (T,) depth, m.
        what: The quantity in words.
        places: (T, 3) positions of the tool, m; x right, y up, z forward in the app's world.
    """

    times_s: FloatArray
    values_m: FloatArray
    what: str
    places: FloatArray


def depth_of(group: Group) -> list[Depth]:
    """Return the depth of the tool over time, an entry per episode.

    The tool is what the game logs beside headset and controllers, or else the right controller.
    Depth is its distance behind the plane through the places where items come up (negative: in
    front of it, on the player's side); where these lie in no plane, how far the tool is in front
    of the headset.
    """
    # The pose in the app's log that belongs to no device; None without one.
    names = [c.removesuffix("_x_m") for c in group.columns("frames") if c.endswith("_x_m")]
    others = [name for name in names if name not in _DEVICES]
    tool = others[0] if others else None
    table = "frames" if tool is not None else "steps"
    name = tool or "right"
    columns = [f"{part}_{axis}" for part in (name, "head") for axis in _AXES]
    plane = _plane(group)
    found = []
    for rows in group.moments(table, columns):
        if any(column not in rows for column in columns):
            continue
        # A log's first row is from before the round.
        rows = rows.iloc[1:] if table == "frames" else rows
        places = rows[columns[:3]].to_numpy(np.float64)
        head = rows[columns[3:]].to_numpy(np.float64)
        times_s = rows["time_s"].to_numpy(np.float64)
        if plane is None:
            values = places[:, 2] - head[:, 2]
            what = "how far the right controller is in front of the headset" if tool is None else (
                f"how far the {name} is in front of the headset")  # fmt: skip
        else:
            origin, normal = plane
            if normal @ (origin - head[0]) < 0:
                normal = -normal
            values, what = (
                (places - origin) @ normal,
                f"how far the {name} is behind the plane of the items (negative: in front of it)",
            )
        found.append(Depth(times_s - times_s[0], values, what, places))
    return found


def _plane(group: Group) -> tuple[FloatArray, FloatArray] | None:
    """Middle and normal of the plane that items come up in; None where they do not."""
    rows = group.events.dropna(subset=["cell", *_AXES])
    if rows["cell"].nunique() < 3:
        return None
    places = rows.groupby("cell")[list(_AXES)].mean().to_numpy(np.float64)
    middle = places.mean(axis=0)
    _, spread, axes = np.linalg.svd(places - middle)
    if spread[1] < 1e-6 or spread[2] > 0.1 * spread[1]:  # a line, or a cloud
        return None
    return middle, axes[2]


def figures_of_strategy(source: ReportSource, published: Published) -> Iterator[Figure]:
    """Yield the figures that these data allow, people's times beside users'."""
    depths = [depth_of(group) for group in source.groups]
    if any(depths):
        yield _over_time(source.groups, depths)
        yield _in_space(source.groups, depths)
    yield from _distributions(source.groups, published)


def _over_time(groups: Sequence[Group], depths: Sequence[Sequence[Depth]]) -> Figure:
    layers: list[Layer] = []
    around: list[Layer] = []
    what = ""
    for index, (group, own) in enumerate(zip(groups, depths, strict=True)):
        if not own:
            continue
        what, colour = own[0].what, colour_of(index)
        ends = np.linspace(0.0, max(each.times_s[-1] for each in own), _BINS + 1)
        times = np.concatenate([each.times_s for each in own])
        values = np.concatenate([each.values_m for each in own])
        bins = np.clip(np.digitize(times, ends) - 1, 0, _BINS - 1)
        filled = [k for k in range(_BINS) if (bins == k).any()]
        middles = [float(ends[k] + ends[k + 1]) / 2 for k in filled]
        low, middle, high = (
            [float(np.quantile(values[bins == k], q)) for k in filled] for q in (0.1, 0.5, 0.9)
        )
        if sum(map(bool, depths)) <= _MOST_AREAS:
            layers.append(Band(group.label, middles, low, high, colour, key=_AREA))
        layers.append(Line(group.label, middles, middle, colour))
        around += _around_outcomes(group, own, colour)
    areas = (
        "; areas: from the 10 % to the 90 % quantile"
        if any(isinstance(layer, Band) for layer in layers)
        else ""
    )
    panels = [
        Panel("Over the round", layers, "time (s)", "depth (m)", legend=True, wide=True),
    ]
    if around:
        panels.append(
            Panel("Around a success", around, "time from the outcome (s)", "depth (m)", legend=True)
        )
    caption = (
        f"Depth: {what}. Lines: medians over frames and rounds{areas}. "
        "Around a success: median over all successful items."
    )
    return Figure("depth", "Depth of the tool", caption, panels)


def _around_outcomes(group: Group, own: Sequence[Depth], colour: str) -> Iterator[Line]:
    offsets = np.arange(-_WINDOW_S, _WINDOW_S + _STEP_S / 2, _STEP_S)
    rows = group.events.dropna(subset=["end_s", "success"])
    rows = rows[rows["success"].astype(bool)]
    curves = []
    episodes = [key for _, keys in group.parts for key in keys]
    for episode, depth in zip(episodes, own, strict=False):
        for end_s in rows[rows["episode"] == episode]["end_s"]:
            at = end_s + offsets
            if at[0] >= 0 and at[-1] <= depth.times_s[-1]:
                curves.append(np.interp(at, depth.times_s, depth.values_m))
    if len(curves) > 2:
        middle = np.median(curves, axis=0)
        yield Line(group.label, offsets, middle, colour)


def _in_space(groups: Sequence[Group], depths: Sequence[Sequence[Depth]]) -> Figure:
    layers: list[Layer] = []
    for index, (group, own) in enumerate(zip(groups, depths, strict=True)):
        if not own:
            continue
        first = own[0]
        part = first.places[(first.times_s >= _PATH_S[0]) & (first.times_s <= _PATH_S[1])]
        part = part[:: max(1, len(part) // 500)]
        x, y, z = (part[:, axis] for axis in (0, 2, 1))
        layers.append(Path(group.label, x, y, z, colour_of(index)))
        rows = group.events.dropna(subset=list(_AXES))[list(_AXES)].drop_duplicates()
        rows = rows.iloc[:_MOST_PLACES]
        if len(rows):
            at = (list(rows["x_m"]), list(rows["z_m"]), list(rows["y_m"]))
            layers.append(Path(f"{group.label}, items", *at, colour_of(index), places=True))
    caption = (
        f"The way of the tool in the first round of each, from {_PATH_S[0]:.0f} to at most "
        f"{_PATH_S[1]:.0f} s, and where items were. Turn it "
        "with the mouse or a finger; a click on a name hides it."
    )
    panel = Panel("", layers, legend=True, wide=True)
    return Figure("paths", "Tool paths", caption, [panel])


def _distributions(groups: Sequence[Group], published: Published) -> Iterator[Figure]:
    panels = []
    for column, title, label in (
        ("latency_s", "From an item's coming to success", "time (s)"),
        ("speed_mps", "Speed that decided", "speed (m/s)"),
    ):
        layers: list[Layer] = []
        for index, group in enumerate(groups):
            rows = group.events.dropna(subset=[column, "success"])
            values = np.sort(rows[rows["success"].astype(bool)][column].to_numpy(np.float64))
            if len(values) > 1:
                layers += _share_line(group.label, values, colour_of(index))
            people = published.people_in(group.condition, column) if len(values) > 1 else []
            if people:
                texts = [f"a person's median, {group.condition}: {v:.2f}" for v in people]
                halves = [0.5] * len(people)
                name = f"{group.label}, people"
                layers.append(
                    Points(name, people, halves, colour_of(index), 7, "diamond", text=texts)
                )
        if layers:
            range_ = (0.0, 1.02)
            panels.append(
                Panel(title, layers, label, "cumulative proportion of successes", y_range=range_,
                      legend=True)
            )  # fmt: skip
    speeds = [_speeds(group) for group in groups]
    layers = []
    for index, (group, own) in enumerate(zip(groups, speeds, strict=True)):
        if own is not None:
            layers += _share_line(group.label, own, colour_of(index))
    if layers:
        panels.append(
            Panel("Speed of the hand", layers, "speed (m/s)", "cumulative proportion of time",
                  y_range=(0.0, 1.02), legend=True)
        )  # fmt: skip
    if panels:
        text = (
            "Cumulative proportions: the curve that rises earlier belongs to faster times, or "
            "slower speeds; where it crosses 0.5 is the median (dot)."
        )
        if any(published.people_in(group.condition, "latency_s") for group in groups):
            text += " Diamonds: people's medians, one each."
        yield Figure("times", "Times and speeds", text, panels)


def _speeds(group: Group) -> FloatArray | None:
    """Speeds of the right controller from step to step, sorted."""
    columns = [f"right_{axis}" for axis in _AXES]
    found = []
    for rows in group.moments("steps", columns):
        if all(column in rows for column in columns) and len(rows) > 2:
            moved = np.diff(rows[columns].to_numpy(np.float64), axis=0)
            passed = np.diff(rows["time_s"].to_numpy(np.float64))
            found.append(np.linalg.norm(moved, axis=1) / passed)
    return np.sort(np.concatenate(found)) if found else None


def _share_line(name: str, values: Any, colour: str) -> list[Layer]:
    shares = np.linspace(0.0, 1.0, min(len(values), 101))
    at = np.quantile(values, shares)
    middle = float(np.median(values))
    return [
        Line(name, at, shares, colour),
        Points(
            f"{name}, median",
            [middle],
            [0.5],
            colour,
            8,
            text=[f"{name}: {middle:.3g}"],
            key="median",
        ),
    ]
