"""Postures that bring a point to a place: bounded least squares, for many places at once."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from sim2vr_harness.users.kinematics.forward import Linkage

FloatArray = NDArray[np.float64]

CLOSE_M = 1e-3
"""A place is reached when the point comes so near."""

_DAMPING = 1e-3
_KEPT = 0.8
_LEAST, _MOST = 1e-9, 1e9
"""Bounds of the damping, m^2."""


def solve(
    linkage: Linkage,
    places: FloatArray,
    start: FloatArray,
    *,
    iterations: int = 60,
    close_m: float = 1e-5,
    gain_m: float = 2e-6,
) -> tuple[FloatArray, FloatArray]:
    """Bring the point as near to places as the joints' limits let it, from postures near by.

    Args:
        linkage: moves the point; one of a :class:`.StackedLinkage` has B rows.
        places: (B, 3) MuJoCo's world, m.
        start: (B, K) angles.
        close_m: distance at which the search stops.
        gain_m: smallest improvement; the search stops after four iterations below it.

    Returns:
        Angles (B, K) within the limits, and the remaining distances (B,) from the places, m.
    """
    q = np.clip(start, *np.moveaxis(linkage.limits, -1, 0))
    place, slope = linkage.place_and_slope(q)
    error = places - place
    distance = np.linalg.norm(error, axis=1)
    damping, stuck = np.full(len(q), _DAMPING), np.zeros(len(q), dtype=int)
    going = distance > close_m
    rows, part = np.arange(len(q)), linkage
    for _ in range(iterations):
        if not going.any():
            break
        if going.sum() < _KEPT * len(rows):  # to take rows out costs as much as some more of them
            rows = np.flatnonzero(going)
            part = linkage.take(rows)
        tried = _tried(q[rows], slope[rows], error[rows], damping[rows], part.limits)
        place, new_slope = part.place_and_slope(tried)
        new_error = places[rows] - place
        new_distance = np.linalg.norm(new_error, axis=1)
        gain = distance[rows] - new_distance
        better = (gain > 0.0) & going[rows]
        won = rows[better]
        q[won], slope[won] = tried[better], new_slope[better]
        error[won], distance[won] = new_error[better], new_distance[better]
        damping[rows] = np.clip(damping[rows] * np.where(better, 0.2, 8.0), _LEAST, _MOST)
        # A failure counts when steps have become small against what is left to go.
        idle = np.where(better, gain < gain_m, damping[rows] > 1.0 + distance[rows] ** 2)
        stuck[rows] = np.where(idle, stuck[rows] + 1, 0)
        going[rows] &= (distance[rows] > close_m) & (stuck[rows] < 4)
    return q, distance


def _tried(
    q: FloatArray,
    slope: FloatArray,
    error: FloatArray,
    damping: FloatArray,
    limits: FloatArray,
) -> FloatArray:
    """Postures (B, K) after a Levenberg-Marquardt step.

    Joints at a limit that would go on are left out; those that the first try takes to one stay.
    """
    low, high = np.moveaxis(limits, -1, 0)
    pull = np.einsum("bxk,bx->bk", slope, error)
    free = ~(((q <= low) & (pull < 0.0)) | ((q >= high) & (pull > 0.0)))
    first = q + _step(slope * free[:, None, :], error, damping)
    beyond = free & ((first < low) | (first > high))
    stopped = np.clip(first, low, high)
    # What the stopped joints still do is taken off; the others do the rest.
    done = np.einsum("bxk,bk->bx", slope, np.where(beyond, stopped - q, 0.0))
    rest = _step(slope * (free & ~beyond)[:, None, :], error - done, damping)
    return np.clip(np.where(beyond, stopped, q + rest), low, high)


def _step(slope: FloatArray, error: FloatArray, damping: FloatArray) -> FloatArray:
    normal = slope @ slope.transpose(0, 2, 1) + damping[:, None, None] * np.eye(3)
    return np.einsum("bxk,bx->bk", slope, np.linalg.solve(normal, error[..., None])[..., 0])


def bounded_least_squares(
    matrix: FloatArray, target: FloatArray, high: FloatArray | float = 1.0
) -> FloatArray:
    """Return the x within 0 and ``high`` that makes ``matrix @ x - target`` least.

    Active sets are exact and fast; where they divide by zero, a trust region does it.

    Args:
        matrix: (R, N) of full column rank.
        target: (R,).
        high: (N,) or one for all; may be infinite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        found: FloatArray = lsq_linear(matrix, target, bounds=(0.0, high), method="bvls").x
    if not np.isfinite(found).all():
        found = lsq_linear(matrix, target, bounds=(0.0, high)).x
    return found
