"""Panels as Plotly's plain data: no library writes it, the page's own Plotly draws it."""

import math
import textwrap
from collections.abc import Iterable
from typing import Any

from sim2vr_harness.figures.figure import (
    Band,
    Bars,
    Heat,
    Layer,
    Line,
    Panel,
    Path,
    Points,
    Ranges,
    keys_of,
)

_HEIGHT, _HEIGHT_IN_SPACE, _ROW = 300, 460, 17
_HEIGHT_NAMED = 640
"""In space with names beside places, which need room."""
_SLANTED = 60
"""More height for names of many categories."""
_ROW_LETTERS, _NAME_LETTERS, _LINE_LETTERS = 32, 20, 42
"""Letters of a row's name, of a line of a group's name, and of all names below a panel."""
_SCALE = [[0, "#f7fbff"], [0.35, "#9ecae1"], [0.7, "#3182bd"], [1, "#08306b"]]
"""Of tables of colours: pale is little."""
_CLEAR = [[0, "rgba(0,0,0,0)"], [1, "rgba(0,0,0,0)"]]
_EYE, _CENTER = {"x": -1.84, "y": -2.19, "z": 0.92}, {"x": 0, "y": 0, "z": -0.12}
_SCENE = {
    "xaxis": {"title": {"text": "right (m)"}},
    "yaxis": {"title": {"text": "forward (m)"}},
    "zaxis": {"title": {"text": "up (m)"}},
    "aspectmode": "data",
    "camera": {"eye": _EYE, "center": _CENTER},
}
_DARK = 0.72
"""Share of the scale from where on white stands out more than black (luminance .18)."""


def plotly_of(panel: Panel) -> dict[str, Any]:
    """Return ``data``, ``layout`` and ``keys`` (name, colour) of a panel, ready for JSON.

    Colours of text, lines and ground are the page's, which may be dark.
    """
    traces = [trace for layer in panel.layers for trace in _traces(layer, panel)]
    if panel.flipped:
        turned = {"x": "y", "y": "x", "error_y": "error_x", "base": "base"}
        traces = [{turned.get(key, key): value for key, value in t.items()} for t in traces]
        for trace in traces:
            trace |= {"orientation": "h"} if trace["type"] == "bar" else {}
            if "shape" in (line := trace.get("line", {})):
                line["shape"] = line["shape"].replace("hv", "vh")
    return {"data": traces, "layout": _layout(panel), "keys": keys_of(panel)}


def _traces(layer: Layer, panel: Panel) -> list[dict[str, Any]]:
    common = {"name": getattr(layer, "name", "")}
    if isinstance(layer, Line):
        line = {
            "color": layer.colour,
            "width": min(2, 1.5 * layer.width),
            "dash": "dash" if layer.dashed else "solid",
            "shape": "hv" if layer.stepped else "linear",
        }
        x, y = _plain(layer.x), _plain(layer.y)
        return [{**common, "type": "scatter", "mode": "lines", "x": x, "y": y, "line": line}]
    if isinstance(layer, Points):
        trace: dict[str, Any] = {
            "type": "scatter",
            "mode": "markers",
            "x": _plain(layer.x),
            "y": _plain(layer.y),
            "marker": {"color": layer.colour, "size": layer.size, "symbol": layer.symbol},
        }
        if layer.spread is not None:
            points_look = {"color": layer.colour, "thickness": 1.5, "width": 4}
            trace["error_y"] = {"type": "data", "array": _plain(layer.spread), **points_look}
        if layer.text is not None:
            trace |= {"text": list(layer.text), "hoverinfo": "text"}
        return [common | trace]
    if isinstance(layer, Band):
        x = [*_plain(layer.x), *reversed(_plain(layer.x))]
        y = [*_plain(layer.high), *reversed(_plain(layer.low))]
        filled: dict[str, Any] = {
            "fill": "toself",
            "fillcolor": _pale(layer.colour),
            "line": {"width": 0},
        }
        return [
            {**common, "type": "scatter", "mode": "lines", "x": x, "y": y,
             "hoverinfo": "skip", **filled}
        ]  # fmt: skip
    if isinstance(layer, Ranges):
        heights = [high - low for low, high in zip(layer.low, layer.high, strict=True)]
        look: dict[str, Any] = {"marker": {"color": _pale(layer.colour, 0.35)}, "width": 0.8}
        return [
            {**common, "type": "bar", "x": _plain(layer.x), "y": _plain(heights),
             "base": _plain(layer.low), "hovertext": list(layer.text or ()),
             "hoverinfo": "text" if layer.text else "skip", **look}
        ]  # fmt: skip
    if isinstance(layer, Bars):
        bar = {"type": "bar", "x": list(layer.x), "y": _plain(layer.y)}
        return [{**common, **bar, "marker": {"color": layer.colour}}]
    if isinstance(layer, Heat):
        # The colours with black numbers where they are pale, then white numbers where they are
        # dark.
        colours = {
            "type": "heatmap",
            "z": [_plain(row) for row in layer.values],
            "x": list(layer.columns),
            "y": list(range(len(layer.rows))),
            "hovertext": [[f"{row}, {column}" for column in layer.columns] for row in layer.rows],
            "zmin": layer.low,
            "zmax": layer.high,
            "colorscale": _SCALE,
            "xgap": 2,
            "ygap": 1 if len(layer.rows) > 12 else 2,
            "showscale": False,
            "hovertemplate": f"%{{hovertext}}: %{{z:.{layer.digits}f}}<extra></extra>",
        }
        told = {"texttemplate": "%{text}"}
        white = {"colorscale": _CLEAR, "hoverinfo": "skip", "hovertemplate": None}
        return [
            colours | told | {"text": _texts(layer, dark=False), "textfont": {"color": "#000"}},
            colours
            | told
            | white
            | {"text": _texts(layer, dark=True), "textfont": {"color": "#fff"}},
        ]
    return [common | _path(layer)]


def _texts(layer: Heat, *, dark: bool) -> list[list[str]]:
    """The numbers of pale cells, or those of dark ones; empty elsewhere."""
    extent = layer.high - layer.low

    def text(value: float | None) -> str:
        if value is None or ((value - layer.low) > _DARK * extent) != dark:
            return ""
        return f"{value:.{layer.digits}f}"

    return [[text(value) for value in row] for row in layer.values]


def _path(layer: Path) -> dict[str, Any]:
    trace: dict[str, Any] = {"type": "scatter3d", "mode": "markers" if layer.places else "lines"}
    trace |= {"x": _plain(layer.x), "y": _plain(layer.y), "z": _plain(layer.z)}
    if layer.places:
        if layer.text is not None:
            trace |= {"mode": "markers+text", "text": list(layer.text), "textfont": {"size": 10}}
        if layer.hover is not None:
            trace |= {"hovertext": list(layer.hover), "hoverinfo": "text"}
        return trace | {"marker": {"color": layer.colour, "size": 4}}
    return trace | {"line": {"color": layer.colour, "width": 3}}


def _layout(panel: Panel) -> dict[str, Any]:
    height = _HEIGHT_IN_SPACE if panel.in_space else _HEIGHT
    if panel.rows:
        height = max(180, 112 + _ROW * panel.rows)
    elif panel.flipped:
        names = [_in_lines(name, _NAME_LETTERS) for name in panel.categories]
        lines = max(2, *(1 + name.count("<br>") for name in names))
        height = max(180, 80 + _ROW * lines * len(names))
    layout: dict[str, Any] = {
        "height": height,
        "font": {"family": "system-ui, sans-serif", "size": 12},
        "margin": {"l": 40, "r": 16, "t": 12, "b": 30},
        "hovermode": "closest",
        "showlegend": False,
        "barmode": "relative" if panel.stacked else "group",
        "bargap": 0.25,
    }
    if any(isinstance(layer, Ranges) for layer in panel.layers):
        layout["barmode"] = "overlay"
    if panel.in_space:
        layout |= {"scene": _SCENE, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}
        if any(isinstance(layer, Path) and layer.text is not None for layer in panel.layers):
            layout["height"] = _HEIGHT_NAMED
        return layout
    x_axis, y_axis = _axis(panel.x_label), _axis(panel.y_label)
    count = len(panel.categories)
    letters = _NAME_LETTERS if panel.flipped else max(8, _LINE_LETTERS // max(1, count))
    names = [_in_lines(name, letters) for name in panel.categories]
    if panel.ticks is not None:
        x_axis |= {"tickvals": list(range(count)), "ticktext": names}
        ends = [-0.6, count - 0.4]
        x_axis |= {"range": ends[::-1] if panel.flipped else ends, "showgrid": False}
    elif count:
        # Every name, also where the names of groups are numbers.
        x_axis |= {"type": "category", "showgrid": False}
        x_axis |= {"tickvals": list(panel.categories), "ticktext": names}
        if panel.flipped:
            x_axis["autorange"] = "reversed"
    for layer in panel.layers:
        if isinstance(layer, Heat):
            rows = [textwrap.shorten(row, _ROW_LETTERS, placeholder=" …") for row in layer.rows]
            y_axis |= {"autorange": "reversed", "showgrid": False}
            y_axis |= {"tickvals": list(range(len(rows))), "ticktext": rows}
            y_axis |= {"tickfont": {"size": 10}} if len(rows) > 12 else {}
            if panel.many:
                x_axis |= {"tickangle": -45, "ticktext": list(panel.categories)}
                layout["height"] += _SLANTED
    if panel.y_range is not None:
        y_axis["autorangeoptions"] = {"include": list(panel.y_range)}
    if panel.square:
        y_axis |= {"scaleanchor": "x", "scaleratio": 1}
    if panel.flipped:
        x_axis, y_axis = y_axis, x_axis
    return layout | {"xaxis": x_axis, "yaxis": y_axis}


def _axis(label: str) -> dict[str, Any]:
    return {"title": {"text": label.replace("\n", "<br>")}, "automargin": True}


def _in_lines(name: str, letters: int) -> str:
    """Return a name in lines of at most so many letters, where its words allow it."""
    return "<br>".join(textwrap.wrap(name, letters, break_on_hyphens=False)) or " "


def _plain(values: Iterable[float | None]) -> list[float | None]:
    """Five digits are more than a picture shows, and half as long to send."""
    return [
        None if value is None or not math.isfinite(value) else float(f"{value:.5g}")
        for value in values
    ]


def _pale(colour: str, share: float = 0.22) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{share})"
