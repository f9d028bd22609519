"""Number of submovements of a movement.

A movement that needs no correction has one hump of speed. Peaks of the tip's speed in the target
plane are counted, so that moving out of the plane and into it again is none; on a grid of 20 Hz
that begins with the movement, so that users and people are measured alike, whatever the frame rate
of their logs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

FloatArray = NDArray[np.float64]

_GRID_S = 0.05
PROMINENCE_MPS = 0.05
"""A peak stands out from what is on both of its sides by so much."""


def submovements(times_s: FloatArray, places_m: FloatArray, began_s: float, ended_s: float) -> int:
    """Count the peaks of speed between two moments.

    Args:
        times_s: (N,) of the log's rows, ascending.
        places_m: (N, 2) of the tip in the target plane.
        began_s: of the movement.
        ended_s: of the movement.

    Returns:
        at least 1.
    """
    count = max(2, round((ended_s - began_s) / _GRID_S) + 1)
    grid = np.linspace(began_s, ended_s, count)
    way = np.stack([np.interp(grid, times_s, axis) for axis in places_m.T], 1)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1) / (grid[1] - grid[0])
    # It begins and ends at rest, or is cut there.
    padded = np.concatenate([[0.0], speed, [0.0]])
    return max(1, len(find_peaks(padded, prominence=PROMINENCE_MPS)[0]))
