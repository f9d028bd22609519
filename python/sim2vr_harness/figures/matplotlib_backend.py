"""The same panels by Matplotlib, as PNG and PDF for papers and slides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from sim2vr_harness.base.files import naming
from sim2vr_harness.figures.figure import (
    Band,
    Bars,
    Figure,
    Heat,
    Line,
    Panel,
    Path,
    Points,
    Ranges,
    keys_of,
)

__all__ = ["write_stills"]

_COLUMNS = 3
_PANEL_INCHES = (4.2, 3.1)
_ROW_INCHES = 0.16
_DPI = 120
_MOST_KEYS = 6
"""Names that have room in a panel; more stand below all of them."""
_SYMBOLS = {"circle": "o", "diamond": "D", "x": "x", "square": "s"}


def write_stills(figures: Sequence[Figure], folder: FilePath) -> list[FilePath]:
    """Write every figure as ``KEY.png`` and ``KEY.pdf``.

    Args:
        figures: Of a report.
        folder: Made if needed.

    Raises:
        OSError: names the file, on a full disk for example.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for figure in figures:
        drawn = _drawn(figure)
        for ending in ("png", "pdf"):
            file = folder / f"{figure.key}.{ending}"
            # Without a date in it, the same figure is the same bytes.
            metadata = {"CreationDate": None} if ending == "pdf" else {"Software": None}
            with naming(file):
                drawn.savefig(file, dpi=_DPI, metadata=metadata)
            files.append(file)
    return files


def _drawn(figure: Figure) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    columns = min(_COLUMNS, len(figure.panels))
    lines = -(-len(figure.panels) // columns)
    height = max(_PANEL_INCHES[1], *(1.0 + _ROW_INCHES * p.rows for p in figure.panels))
    size = (_PANEL_INCHES[0] * columns, height * lines + 0.4)
    canvas = Canvas(figsize=size, layout="constrained")
    FigureCanvasAgg(canvas)
    together = max(len(keys_of(panel)) for panel in figure.panels) > _MOST_KEYS
    for index, panel in enumerate(figure.panels):
        kind = {"projection": "3d"} if panel.in_space else {}
        axes = canvas.add_subplot(lines, columns, index + 1, **kind)
        _draw(axes, panel)
        if panel.legend and not together:
            handles = _handles(axes, panel)
            axes.legend(handles.values(), handles.keys(), fontsize=7, frameon=False)
    if together:
        named = [_handles(axes, p) for axes, p in zip(canvas.axes, figure.panels, strict=True)]
        handles = {name: handle for own in named for name, handle in own.items()}
        canvas.legend(
            handles.values(),
            handles.keys(),
            fontsize=7,
            loc="outside lower center",
            ncol=max(2, 2 * columns),
            frameon=False,
        )
        lines_below = -(-len(handles) // max(2, 2 * columns))
        canvas.set_size_inches(size[0], size[1] + 0.16 * lines_below)
    canvas.suptitle(figure.title, fontsize=11)
    return canvas


def _draw(axes: Any, panel: Panel) -> None:
    grounds: dict[str, dict[str, float]] = {"up": {}, "down": {}}
    bars = [layer for layer in panel.layers if isinstance(layer, Bars)]
    for layer in panel.layers:
        if isinstance(layer, Bars):
            _draw_bars(axes, layer, panel, grounds, bars.index(layer), len(bars))
        elif isinstance(layer, Path):
            x, y, z = (_array(values) for values in (layer.x, layer.y, layer.z))
            if layer.places:
                axes.scatter(x, y, z, color=layer.colour, s=10, label=layer.name)
            else:
                axes.plot(x, y, z, color=layer.colour, linewidth=0.8, label=layer.name)
        else:
            _draw_flat(axes, layer, _turn(panel))
    axes.set_title(panel.title, fontsize=9)
    if panel.in_space:
        axes.set_xlabel("right (m)", fontsize=8)
        axes.set_ylabel("forward (m)", fontsize=8)
        axes.set_zlabel("up (m)", fontsize=8)
    else:
        axes.set_xlabel(panel.x_label, fontsize=8)
        axes.set_ylabel(panel.y_label, fontsize=8)
    axes.tick_params(labelsize=7)
    if panel.ticks is not None:
        axes.set_xticks(range(len(panel.ticks)), panel.ticks, rotation=_turn(panel), ha="right")
        axes.set_xlim(-0.6, len(panel.ticks) - 0.4)
    elif bars and not panel.sideways:
        axes.set_xticks(range(len(bars[0].x)), list(bars[0].x), rotation=_turn(panel), ha="right")
    if panel.sideways:
        axes.invert_yaxis()
    if panel.y_range is not None:
        axes.set_ylim(*panel.y_range)
    if panel.square:
        axes.set_aspect("equal", adjustable="datalim")


def _handles(axes: Any, panel: Panel) -> dict[str, Any]:
    """Name -> what stands for it in a legend."""
    keys = [name for name, _ in keys_of(panel)]
    handles, names = axes.get_legend_handles_labels()
    found = dict(zip(names, handles, strict=True))
    return {name: found[name] for name in keys if name in found}


def _turn(panel: Panel) -> int:
    """Of the names of categories, degrees."""
    return 45 if panel.crowded else 25


def _draw_flat(axes: Any, layer: Line | Points | Band | Ranges | Heat, turn: int) -> None:
    if isinstance(layer, Line):
        how = {"drawstyle": "steps-post"} if layer.stepped else {}
        dash = "--" if layer.dashed else "-"
        x, y = _array(layer.x), _array(layer.y)
        axes.plot(x, y, dash, color=layer.colour, linewidth=1.4, label=layer.name, **how)
    elif isinstance(layer, Points):
        spread = None if layer.spread is None else np.nan_to_num(_array(layer.spread))
        axes.errorbar(
            _array(layer.x),
            _array(layer.y),
            yerr=spread,
            fmt=_SYMBOLS.get(layer.symbol, "o"),
            color=layer.colour,
            markersize=layer.size * 0.6,
            capsize=2,
            label=layer.name,
        )
    elif isinstance(layer, Band):
        axes.fill_between(layer.x, layer.low, layer.high, color=layer.colour, alpha=0.2, lw=0)
    elif isinstance(layer, Ranges):
        heights = _array(layer.high) - _array(layer.low)
        look = {"color": layer.colour, "alpha": 0.35, "width": 0.8, "label": layer.name}
        axes.bar(layer.x, heights, bottom=layer.low, **look)
    else:
        values = np.array([_array(row) for row in layer.values])
        axes.imshow(values, cmap="Blues", vmin=layer.low, vmax=layer.high, aspect="auto")
        axes.set_xticks(range(len(layer.columns)), layer.columns, rotation=turn, ha="right")
        axes.set_yticks(range(len(layer.rows)), layer.rows)
        if layer.labelled:
            middle = (layer.low + layer.high) / 2
            for row, column in np.argwhere(np.isfinite(values)):
                value = values[row, column]
                ink = "white" if value > middle else "black"
                text = f"{value:.{layer.digits}f}"
                axes.text(column, row, text, ha="center", va="center", fontsize=6, color=ink)


def _draw_bars(
    axes: Any,
    layer: Bars,
    panel: Panel,
    grounds: dict[str, dict[str, float]],
    index: int,
    count: int,
) -> None:
    """Bars upon each other (gains up, losses down), or side by side."""
    values = np.nan_to_num(_array(layer.y))
    if panel.stacked:
        below = [
            grounds["up" if value >= 0 else "down"].get(name, 0.0)
            for name, value in zip(layer.x, values, strict=True)
        ]
        for name, value in zip(layer.x, values, strict=True):
            side = grounds["up" if value >= 0 else "down"]
            side[name] = side.get(name, 0.0) + float(value)
        if panel.sideways:
            axes.barh(list(layer.x), values, left=below, color=layer.colour, label=layer.name)
        else:
            axes.bar(list(layer.x), values, bottom=below, color=layer.colour, label=layer.name)
        return
    thick = 0.8 / count
    places = np.arange(len(values)) + (index + 0.5) * thick - 0.4
    if panel.sideways:
        axes.barh(places, values, height=thick, color=layer.colour, label=layer.name)
        axes.set_yticks(range(len(values)), list(layer.x))
    else:
        axes.bar(places, values, width=thick, color=layer.colour, label=layer.name)
        axes.set_xticks(range(len(values)), list(layer.x))


def _array(values: Any) -> Any:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
