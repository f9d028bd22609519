"""Whac-A-Mole's numbers, as the true game has them (docs/reference/games/whacamole.md).

``tests/python/games/test_whacamole_rules.py`` asks the running app for every one of them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.base import OptionValue

Triple = tuple[float, float, float]

CELLS, COLUMNS = 9, 3
MOST_TARGETS = 3
"""Largest number of targets that a teacher observes in the order of their expiry."""

FRAME_S = 0.049999997
"""A user step in the app's binary32 clock."""
LIFE_S = 1.098
"""Remaining life of a target in the frame in which it appears, including growth."""
GROWING_FRAMES, LAST_FRAME = 2, 21
"""Frames until a target can be hit, and the last one in which it is there."""
FADING_FRAMES = 7
"""Frames in which an ended target still keeps its cell."""
BAN_S = 0.5
"""A target may appear up to so long after the one before it."""

_S = math.sqrt(0.5)

# By placement low, mid, high; the app's axes, from the head.
AREA_M = ((0.15, -0.30, 0.35), (0.15, -0.10, 0.40), (0.15, 0.20, 0.30))
"""Middle of the target area."""
UP = ((0.0, _S, _S), (0.0, 1.0, 0.0), (0.0, _S, -_S))
BEHIND = ((0.0, -_S, _S), (0.0, 0.0, 1.0), (0.0, _S, _S))
"""The area's axes: up in its plane, and away from the player."""
STRIKE = ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
"""The direction whose speed a hit is judged by."""

LIES_DEG = 22.5
"""An area tilted further by an option is struck down."""

CELL_M = 0.125
"""Distance of neighbouring cells, unless an option changes it."""
TARGET_RADIUS_M = 0.025
VOLUME_BEHIND_M = 0.010
"""Distance of the middle of a target's hit volume behind the area's plane."""
TARGET_HALF_M = (0.0225, 0.0225, 0.0125)
HAMMER_HALF_M = (0.05, 0.0275, 0.0275)
"""Half sizes of the boxes that meet in a hit, along the axes of each."""
MARKER_M = (-0.0482, 0.1385, -0.0005)
BOX_M = (-0.000401, 0.139758, -0.000818)
"""The marker, and the middle of the hammer's box, from its root along its axes."""
START_M = 0.10
"""Distance in front of a cell at which a stroke may begin."""


@dataclass(frozen=True)
class Area:
    """Pose of the target area.

    Attributes:
        middle_m: its middle relative to the head, in the app's axes, m.
        up, behind: the area's axes.
        strike: the direction along which the speed of a hit is measured.
        cell_m: distance of neighbouring cells.
    """

    middle_m: Triple
    up: Triple
    behind: Triple
    strike: Triple
    cell_m: float


def area_of(placement: int, options: Mapping[str, OptionValue]) -> Area:
    """Return the area of a placement (0 low, 1 mid, 2 high), moved and scaled as options say.

    Raises:
        InputError: the options change the targets' size, on which the other boxes depend.
    """
    radius_m = _number(options.get("target_radius_m"), TARGET_RADIUS_M)
    if radius_m != TARGET_RADIUS_M:
        wanted = f"{TARGET_RADIUS_M} with recipe 'distill'; recipe 'skills' takes any"
        raise InputError("env.app.options.target_radius_m", str(radius_m), wanted)
    across_m, height_m, distance_m = AREA_M[placement]
    middle_m = (
        across_m,
        _number(options.get("area_height_m"), height_m),
        _number(options.get("area_distance_m"), distance_m),
    )
    cell_m = _number(options.get("area_size_m"), 2.0 * CELL_M) / 2.0
    if options.get("area_tilt_deg") is None:
        return Area(middle_m, UP[placement], BEHIND[placement], STRIKE[placement], cell_m)
    tilt_deg = _number(options["area_tilt_deg"], 0.0)
    tilt_rad = math.radians(tilt_deg)
    sine, cosine = math.sin(tilt_rad), math.cos(tilt_rad)
    strike = STRIKE[0 if tilt_deg > LIES_DEG else 1]
    return Area(middle_m, (0.0, cosine, sine), (0.0, -sine, cosine), strike, cell_m)


def _number(value: OptionValue | None, otherwise: float) -> float:
    return float(value) if isinstance(value, (int, float)) else otherwise
