"""The surface around everything that can be reached."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from sim2vr_harness.tools.reach.extent import Volume

FloatArray = NDArray[np.float64]

_ROUNDS = 12
_SHRINK, _SWELL = 0.5, -0.53
"""Taubin's two steps of smoothing, which together keep the volume."""


def shell(volume: Volume) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the smoothed faces between cells that can be reached and others.

    Returns:
        Vertices (V, 3), MuJoCo's world, m, and triangles (T, 3) whose fronts, counter-clockwise,
        are outside.
    """
    padded = np.pad(volume.reached, 1)
    quads = []
    for axis, step in product(range(3), (1, -1)):
        cells = np.argwhere(padded & ~np.roll(padded, -step, axis)) - 1
        one, other = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        base = cells + (np.eye(3, dtype=int)[axis] if step > 0 else 0)
        ring = [base, base + one, base + one + other, base + other]
        quads.append(np.stack(ring if step > 0 else ring[::-1], axis=1))
    corners, flat = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    faces = flat.reshape(-1, 4)
    vertices = _smoothed(corners.astype(float), faces)
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return volume.low_m + (vertices - 0.5) * volume.cell_m, triangles


def _smoothed(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Pull each vertex towards the middle of its neighbours and push it back, a few times."""
    rows = np.concatenate([faces, np.roll(faces, 1, axis=1)], axis=1).ravel()
    columns = np.concatenate([np.roll(faces, 1, axis=1), faces], axis=1).ravel()
    count = len(vertices)
    beside = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    beside.data[:] = 1.0
    share = 1.0 / np.asarray(beside.sum(axis=1))
    for step in (_SHRINK, _SWELL) * _ROUNDS:
        vertices = vertices + step * (beside @ vertices * share - vertices)
    return vertices
