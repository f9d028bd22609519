"""The same panels by Matplotlib, as PNG and PDF for papers and slides."""

import io
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path as FilePath
from textwrap import fill
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming
from sim2vr_harness.figures.figure import (
    INK,
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

PRINT: Any = {
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "font.size": 8,
    "axes.formatter.useoffset": False,
}
"""Matplotlib's settings: fonts that publishers accept (TrueType), and numbers as they are."""
_COLUMN_INCHES, _PAGE_INCHES = 3.5, 7.2
"""Widths of one and of two columns of a paper."""
_PANEL_INCHES = 2.5
_ROW_INCHES = 0.14
_DPI = 200
_ROOMY = 8
"""Categories that have room for their names beside each other in a panel."""
_LETTER_INCHES = 0.06
_SYMBOLS = {"circle": "o", "diamond": "D", "x": "x", "square": "s"}


def write_stills(figures: Sequence[Figure], folder: FilePath) -> list[FilePath]:
    """Write every figure as ``KEY.png`` and ``KEY.pdf``; ``folder`` is made if needed."""
    return [
        write_figure(figure, folder / f"{figure.key}.{ending}")
        for figure in figures
        for ending in ("png", "pdf")
    ]


@lru_cache(maxsize=32)
def still_of(figure: Figure, kind: str) -> bytes:
    """Return a figure as ``png`` or ``pdf``: a page on paper and a file beside it have the same."""
    from matplotlib import rc_context

    # Without a date in it, the same figure is the same bytes.
    metadata = {"Software": None} if kind == "png" else {"CreationDate": None}
    stream = io.BytesIO()
    with rc_context(PRINT):
        _drawn(figure).savefig(stream, format=kind, dpi=_DPI, metadata=metadata)
    return stream.getvalue()


def write_figure(figure: Figure, file: FilePath) -> FilePath:
    """Write a figure, as wide as one or two columns of a paper.

    Args:
        figure: At least one panel.
        file: PNG or PDF; its folder is made if needed.

    Raises:
        InputError: ``file`` ends in neither.
        OSError: names the file, on a full disk for example.
    """
    ending = file.suffix.lower()
    if ending not in (".png", ".pdf"):
        raise InputError("--out", repr(str(file)), "a file name that ends in .png or .pdf")
    content = still_of(figure, ending[1:])
    file.parent.mkdir(parents=True, exist_ok=True)
    with naming(file):
        file.write_bytes(content)
    return file


def _drawn(figure: Figure) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    panels = figure.panels
    most = max(len(panel.categories) for panel in panels)
    columns = figure.columns
    if not columns:
        few = len(panels) < 5 or any(panel.flipped for panel in panels)
        columns = 1 if len(panels) == 1 or most > 2 * _ROOMY else 2 if few else 3
    lines = -(-len(panels) // columns)
    wide = panels[0].wide and not panels[0].in_space
    alone = len(panels) == 1 and not (wide or most > _ROOMY)
    width = _COLUMN_INCHES if alone else _PAGE_INCHES
    rows = [max(p.rows, len(p.categories) if p.flipped else 0) for p in panels]
    tall = [
        max(_PANEL_INCHES, _COLUMN_INCHES * panel.in_space, 0.7 + _ROW_INCHES * count)
        for panel, count in zip(panels, rows, strict=True)
    ]
    heights = [max(tall[line * columns : (line + 1) * columns]) for line in range(lines)]
    canvas = Canvas(figsize=(width, sum(heights) + 0.3), layout="constrained")
    FigureCanvasAgg(canvas)
    grid = canvas.add_gridspec(lines, columns, height_ratios=heights)
    for index, panel in enumerate(panels):
        kind: dict[str, Any] = {"projection": "3d"} if panel.in_space else {}
        if figure.same_axes and index:
            kind |= {"sharex": canvas.axes[0], "sharey": canvas.axes[0]}
        axes = canvas.add_subplot(grid[index // columns, index % columns], **kind)
        _draw(axes, panel, width / columns)
    _add_legends(canvas, panels, width)
    canvas.suptitle(fill(figure.title, int(width / 0.085)), fontsize=9)
    return canvas


def _add_legends(canvas: Any, panels: Sequence[Panel], width: float) -> None:
    """Name every mark below all panels; below each where a name has another colour in another."""
    from matplotlib.container import ErrorbarContainer
    from matplotlib.legend_handler import HandlerErrorbar

    own = [_handles(axes, panel) for axes, panel in zip(canvas.axes, panels, strict=True)]
    colours: dict[str, set[str]] = {}
    for panel in panels:
        for name, colour in keys_of(panel):
            colours.setdefault(name, set()).add(colour)
    whiskers = {ErrorbarContainer: HandlerErrorbar(yerr_size=0.8)}
    look: dict[str, Any] = {"fontsize": 7, "frameon": False, "handler_map": whiskers}
    if any(len(several) > 1 for several in colours.values()):
        for axes, handles in zip(canvas.axes, own, strict=True):
            below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncol": 2}
            axes.legend(handles.values(), handles.keys(), **below, **look)
        return
    handles = {name: handle for named in own for name, handle in named.items()}
    if handles:
        longest = max(map(len, handles))
        columns = max(1, min(4, int(width / (0.55 + _LETTER_INCHES * longest))))
        below = {"loc": "outside lower center", "ncol": columns}
        canvas.legend(handles.values(), handles.keys(), **below, **look)
        wide, high = canvas.get_size_inches()
        canvas.set_size_inches(wide, high + 0.15 * -(-len(handles) // columns))


def _draw(axes: Any, panel: Panel, width: float) -> None:
    grounds: dict[str, dict[str, float]] = {"up": {}, "down": {}}
    bars = [layer for layer in panel.layers if isinstance(layer, Bars)]
    flipped = panel.flipped
    axes.locator_params(nbins=5)  # numbers do not overlap
    if not bars:
        axes.use_sticky_edges = False  # the end of a range is seen
    for layer in panel.layers:
        if isinstance(layer, Bars):
            _draw_bars(axes, layer, panel.stacked, flipped, grounds, bars.index(layer), len(bars))
        elif isinstance(layer, Path):
            x, y, z = (_array(values) for values in (layer.x, layer.y, layer.z))
            if layer.places:
                axes.scatter(x, y, z, color=layer.colour, s=6, label=layer.name)
                for place in zip(x, y, z, layer.text or (), strict=False):
                    axes.text(*place, fontsize=5)
            else:
                axes.plot(x, y, z, color=layer.colour, linewidth=0.8, label=layer.name)
        else:
            _draw_flat(axes, layer, flipped)
    axes.set_title(fill(panel.title, int(width / 0.075)), fontsize=8)
    axes.tick_params(labelsize=7)
    if panel.in_space:
        axes.set(xlabel="right (m)", ylabel="forward (m)", zlabel="up (m)")
        return
    labels = (panel.y_label, panel.x_label) if flipped else (panel.x_label, panel.y_label)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    names = panel.categories
    if flipped:
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
    elif panel.many:
        axes.set_xticks(range(len(names)), names, rotation=90)
    elif names:
        letters = max(5, int(0.8 * width / len(names) / _LETTER_INCHES))
        axes.set_xticks(range(len(names)), [fill(name, letters) for name in names])
        if panel.ticks is not None:
            axes.set_xlim(-0.6, len(names) - 0.4)
    if panel.y_range is not None:
        _limit(axes, panel.y_range, flipped)
    if panel.square:
        axes.set_aspect("equal", adjustable="datalim")


def _limit(axes: Any, y_range: tuple[float, float], flipped: bool) -> None:
    """Show this range, and every datum and whisker outside."""
    low, high = axes.dataLim.intervalx if flipped else axes.dataLim.intervaly
    room = 0.04 * (high - low)
    first, last = y_range
    ends = {"left" if flipped else "bottom": low - room if low < first else first}
    ends["right" if flipped else "top"] = high + room if high > last else last
    (axes.set_xlim if flipped else axes.set_ylim)(**ends)


def _handles(axes: Any, panel: Panel) -> dict[str, Any]:
    """Name -> what stands for it in a legend: every mark, those for all groups in one colour."""
    keyed = {
        layer.key: layer
        for layer in panel.layers
        if isinstance(layer, (Line, Points, Band)) and layer.key
    }
    if not panel.legend and not keyed:
        return {}
    for key, layer in keyed.items():
        grey = replace(layer, colour=INK) if not isinstance(layer, Line) else layer
        # A layer without data, for its look alone.
        nothing: dict[str, Any] = {"low": [], "high": []} if isinstance(grey, Band) else {"y": []}
        if isinstance(grey, Points) and grey.spread is not None:
            nothing["spread"] = []
        emptied = replace(grey, name=key, key="", x=[], **nothing)
        _draw_flat(axes, emptied, False)
    found: dict[str, Any] = {}
    for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
        found.setdefault(name, handle)
    if panel.legend:
        return found
    ranges = [layer.name for layer in panel.layers if isinstance(layer, Ranges)]
    return {name: found[name] for name in (*keyed, *ranges) if name in found}


def _draw_flat(axes: Any, layer: Line | Points | Band | Ranges | Heat, flipped: bool) -> None:
    # A layer with a key, and a table, have no name of their own in a legend.
    name = None if getattr(layer, "key", "") else getattr(layer, "name", None)
    label = {} if name is None else {"label": name}
    if isinstance(layer, Line):
        how = {"drawstyle": "steps-post"} if layer.stepped else {}
        dash = "--" if layer.dashed else "-"
        x, y = _placed(layer.x, layer.y, flipped)
        axes.plot(x, y, dash, color=layer.colour, linewidth=layer.width, **label, **how)
    elif isinstance(layer, Points):
        spread = None if layer.spread is None else np.nan_to_num(_array(layer.spread))
        axes.errorbar(
            *_placed(layer.x, layer.y, flipped),
            **{"xerr" if flipped else "yerr": spread},
            fmt=_SYMBOLS.get(layer.symbol, "o"),
            color=layer.colour,
            markersize=layer.size * 0.5,
            elinewidth=1.0,
            capsize=2,
            **label,
        )
    elif isinstance(layer, Band):
        look = {"color": layer.colour, "alpha": 0.2, "lw": 0, **label}
        axes.fill_between(layer.x, layer.low, layer.high, **look)
    elif isinstance(layer, Ranges):
        lengths = _array(layer.high) - _array(layer.low)
        look = {"color": layer.colour, "alpha": 0.35, **label}
        if flipped:
            axes.barh(layer.x, lengths, left=layer.low, height=0.8, **look)
        else:
            axes.bar(layer.x, lengths, bottom=layer.low, width=0.8, **look)
    else:
        values = np.array([_array(row) for row in layer.values])
        axes.imshow(values, cmap="Blues", vmin=layer.low, vmax=layer.high, aspect="auto")
        axes.set_yticks(range(len(layer.rows)), layer.rows)
        middle = (layer.low + layer.high) / 2
        for row, column in np.argwhere(np.isfinite(values)):
            value = values[row, column]
            ink = "white" if value > middle else "black"
            text = f"{value:.{layer.digits}f}"
            axes.text(column, row, text, ha="center", va="center", fontsize=6, color=ink)


def _placed(x: Any, y: Any, flipped: bool) -> tuple[Any, Any]:
    return (_array(y), _array(x)) if flipped else (_array(x), _array(y))


def _draw_bars(
    axes: Any,
    layer: Bars,
    stacked: bool,
    lying: bool,
    grounds: dict[str, dict[str, float]],
    index: int,
    count: int,
) -> None:
    """Draw stacked bars (gains up, losses down), or grouped bars."""
    values = np.nan_to_num(_array(layer.y))
    if stacked:
        below = [
            grounds["up" if value >= 0 else "down"].get(name, 0.0)
            for name, value in zip(layer.x, values, strict=True)
        ]
        for name, value in zip(layer.x, values, strict=True):
            side = grounds["up" if value >= 0 else "down"]
            side[name] = side.get(name, 0.0) + float(value)
        if lying:
            axes.barh(list(layer.x), values, left=below, color=layer.colour, label=layer.name)
        else:
            axes.bar(list(layer.x), values, bottom=below, color=layer.colour, label=layer.name)
        return
    thick = 0.8 / count
    places = np.arange(len(values)) + (index + 0.5) * thick - 0.4
    if lying:
        axes.barh(places, values, height=thick, color=layer.colour, label=layer.name)
        axes.set_yticks(range(len(values)), list(layer.x))
    else:
        axes.bar(places, values, width=thick, color=layer.colour, label=layer.name)
        axes.set_xticks(range(len(values)), list(layer.x))


def _array(values: Any) -> Any:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
