"""Beats' numbers, as the true game has them (docs/reference/games/beats.md).

``tests/python/games/test_beats_rules.py`` asks the running app for them.
"""

import math

CELL_WIDTH_M, CELL_HEIGHT_M, MIDDLE_ROW_M = 0.40, 0.35, -0.30
COLUMNS, MIDDLE_ROW = 4, 1.0
CUT_PLANE_M = 0.80
"""Distance of a box's centre in front of the origin at its time, m."""
BOX_HALF_M, LINK_HALF_M, MINE_RADIUS_M = 0.175, 0.0875, 0.12
HEAD_RADIUS_M = 0.08
WALL_DEPTH_M, WALL_BEHIND_M = 0.05, 0.5
"""Least depth of a wall, and the distance of its back behind the head plane when it disappears."""

BLADE_FROM_M, BLADE_M, BLADE_RADIUS_M = 0.08, 1.0, 0.015
"""Start of the blade on the grip's axis, its length and its radius."""

MIN_CUT_MPS, FULL_CUT_MPS, ANGLE_LIMIT_DEG = 0.5, 5.0, 60.0
STAB_MPS = 0.01
"""Speed across the box's face below which the motion of a blade has no direction."""
BASE_POINTS, SPEED_POINTS, ANGLE_POINTS = 50.0, 75.0, 75.0

FAR_M = 10.0
"""Range of the head's camera; the game reports objects within it."""
TOLD_BOXES, TOLD_MINES, TOLD_WALLS = 2, 3, 2
"""Numbers of boxes of each hand, of mines and of walls in the privileged observations."""

_S = math.sqrt(0.5)
DIRECTIONS = (
    *((0.0, 1.0), (0.0, -1.0), (-1.0, 0.0), (1.0, 0.0)),
    *((-_S, _S), (_S, _S), (-_S, -_S), (_S, -_S), (0.0, 0.0)),
)
"""x (right) and y (up) of the cut directions, in the order of Beat Saber's numbers; any is none."""


def middle_m(column: float, row: float) -> tuple[float, float]:
    """Return x and y of a cell's middle, from the origin."""
    x = (column - (COLUMNS - 1) / 2.0) * CELL_WIDTH_M
    return x, MIDDLE_ROW_M + (row - MIDDLE_ROW) * CELL_HEIGHT_M
