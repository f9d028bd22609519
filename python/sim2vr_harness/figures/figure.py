"""Figures as plain data: panels of a few kinds of layers.

A panel is drawn twice: by Plotly on the screen (:mod:`plotly_backend`) and by Matplotlib on paper
(:mod:`matplotlib_backend`). Both know these layers and nothing of games or muscles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

COLOURS = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f3c8d", "#5b5b5b"),
    *("#8c510a", "#1f2a6b", "#a6b727", "#e3211c", "#00b8c4", "#f28cb1", "#4d6b2f", "#b39ddb"),
)
"""Okabe and Ito's, which colour-blind people can tell apart, and others behind them."""
_CROWDED, _LETTERS = 8, 36
"""Categories, and letters of their names, that have room below a panel on a telephone."""
INK = "#444444"
"""Of marks that stand for all groups."""
GREY = "#9aa0a6"
"""Of people, and of what is there to compare with."""

Numbers = Sequence[float | None] | NDArray[np.floating[Any]]


def colour_of(index: int) -> str:
    """The colour of the thing of that number; they come again after the last one."""
    return COLOURS[index % len(COLOURS)]


@dataclass(frozen=True)
class Line:
    """A line through points; a missing value interrupts it.

    ``key``: what the mark stands for, in the legend of a printed figure; empty: ``name``.
    """

    name: str
    x: Numbers
    y: Numbers
    colour: str
    dashed: bool = False
    stepped: bool = False
    width: float = 1.4
    key: str = ""


@dataclass(frozen=True)
class Points:
    """Single points, with whiskers of ``spread`` where there is one; ``key`` as above."""

    name: str
    x: Numbers
    y: Numbers
    colour: str
    size: int = 6
    symbol: str = "circle"
    spread: Numbers | None = None
    text: Sequence[str] | None = None
    key: str = ""


@dataclass(frozen=True)
class Band:
    """The area between two lines over the same ``x``; ``key`` as above."""

    name: str
    x: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    colour: str
    key: str = ""


@dataclass(frozen=True)
class Ranges:
    """Upright boxes from ``low`` to ``high``: people's ranges behind users' points."""

    name: str
    x: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    colour: str = GREY
    text: Sequence[str] | None = None


@dataclass(frozen=True)
class Bars:
    """Bars upon categories; those of one panel are stacked or grouped."""

    name: str
    x: Sequence[str]
    y: Numbers
    colour: str


@dataclass(frozen=True)
class Heat:
    """A table of colours; ``rows`` from top to bottom."""

    values: Sequence[Numbers]
    columns: Sequence[str]
    rows: Sequence[str]
    low: float
    high: float
    digits: int = 2


@dataclass(frozen=True)
class Path:
    """A way through space, or single places of it; x right, y forward, z up, m.

    ``text``: a name beside each place; ``hover``: what the mouse shows there, without one the name.
    """

    name: str
    x: Numbers
    y: Numbers
    z: Numbers
    colour: str
    places: bool = False
    text: Sequence[str] | None = None
    hover: Sequence[str] | None = None


Layer = Line | Points | Band | Ranges | Bars | Heat | Path


@dataclass(frozen=True)
class Panel:
    """Axes and what is drawn on them.

    Attributes:
        title: Above.
        layers: From back to front.
        x_label, y_label: With units.
        ticks: Names of x = 0, 1, 2 ...; None: numbers.
        stacked: Whether bars are put on each other.
        square: Whether a metre is as long in both directions.
        y_range: Least and greatest y, if no layer needs more; None: as the layers need it.
        legend: Whether to name the layers.
        wide: Whether it takes a whole line of the page.
    """

    title: str
    layers: Sequence[Layer]
    x_label: str = ""
    y_label: str = ""
    ticks: Sequence[str] | None = None
    stacked: bool = False
    square: bool = False
    y_range: tuple[float, float] | None = None
    legend: bool = False
    wide: bool = False

    @property
    def rows(self) -> int:
        """Number of rows of a table of colours; 0 without one."""
        return max((len(x.rows) for x in self.layers if isinstance(x, Heat)), default=0)

    @property
    def categories(self) -> Sequence[str]:
        """Names along one axis, which is the horizontal one unless they have no room there."""
        if self.ticks is not None:
            return self.ticks
        named = (layer for layer in self.layers if isinstance(layer, (Bars, Heat)))
        first = next(named, None)
        return () if first is None else first.x if isinstance(first, Bars) else first.columns

    @property
    def many(self) -> bool:
        """True if there are more categories than columns have room for."""
        return len(self.categories) > _CROWDED

    @property
    def crowded(self) -> bool:
        """True if names of categories have no room beside each other."""
        return self.many or sum(len(name) + 2 for name in self.categories) > _LETTERS

    @property
    def flipped(self) -> bool:
        """True if the categories are on the vertical axis, where each has a line for its name."""
        heat = any(isinstance(layer, Heat) for layer in self.layers)
        return self.crowded and not heat

    @property
    def in_space(self) -> bool:
        """True if the panel is drawn in three dimensions."""
        return any(isinstance(layer, Path) for layer in self.layers)


def keys_of(panel: Panel) -> list[list[str]]:
    """Names and colours of a panel's legend, which stand beside it; empty without one."""
    if not panel.legend:
        return []
    named: list[Layer] = [layer for layer in panel.layers if isinstance(layer, (Line, Bars, Path))]
    shown = named or [layer for layer in panel.layers if isinstance(layer, Points)]
    whole = [layer for layer in shown if not (isinstance(layer, Path) and layer.places)]
    pairs = [(x.name, x.colour) for x in whole if not isinstance(x, Heat)]
    return [list(pair) for pair in dict.fromkeys(pairs)]


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels that belong together.

    Attributes:
        key: Name of its files.
        title: A heading.
        caption: What is to be seen, and how it was worked out.
        panels: At least one.
        columns: Panels beside each other in a still picture; 0: as fits their number.
        same_axes: Whether the panels of a still picture have the same limits.
    """

    key: str
    title: str
    caption: str
    panels: Sequence[Panel] = field(default_factory=tuple)
    columns: int = 0
    same_axes: bool = False
