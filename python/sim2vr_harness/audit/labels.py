"""Labels of places in space that do not overlap, as the figures' cameras see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

VIEWS = ((-130.0, 18.0), (-60.0, 30.0))
"""Azimuth and elevation of the cameras of web pages and of printed figures, degrees."""
_LETTER, _LINE = 0.02, 0.05
"""Width of a letter and height of a line, shares of the scene's extent."""


def screen(places: FloatArray, azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """(N, 2) places right, up, ahead as a far camera sees them: to the right, up."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    x, z, y = np.reshape(places, (-1, 3)).T  # figures have right, forward, up
    aside = -np.sin(a) * x + np.cos(a) * y
    upward = -np.sin(e) * (np.cos(a) * x + np.sin(a) * y) + np.cos(e) * z
    return np.stack([aside, upward], axis=1)


def labels_of(places: FloatArray, names: Sequence[str]) -> list[str]:
    """Return a label for each place, empty where another place's label speaks for it.

    Places whose labels would overlap share one: "key 1 and 8 more".

    Args:
        places: (N, 3) right, up, ahead, m.
        names: Of the places.
    """
    extent = max(float(np.ptp(places, axis=0).max(initial=0.0)), 1e-9) if len(places) else 1.0
    seen = [screen(places, *view) / extent for view in VIEWS]
    groups = [[i] for i in range(len(names))]
    merged = True
    while merged:
        merged = False
        for i in range(len(groups)):
            for j in range(len(groups) - 1, i, -1):
                if any(_overlap(view, groups[i], groups[j], names) for view in seen):
                    groups[i] += groups.pop(j)
                    merged = True
    found = [""] * len(names)
    for group in groups:
        found[group[0]] = _text(group, names)
    return found


def _text(group: Sequence[int], names: Sequence[str]) -> str:
    more = f" and {len(group) - 1} more" if len(group) > 1 else ""
    return f"{names[group[0]]}{more}"


def _overlap(
    seen: FloatArray, first: Sequence[int], second: Sequence[int], names: Sequence[str]
) -> bool:
    gap = np.abs(seen[first[0]] - seen[second[0]])
    width = _LETTER * (len(_text(first, names)) + len(_text(second, names))) / 2.0
    return bool(gap[0] < width and gap[1] < _LINE)
