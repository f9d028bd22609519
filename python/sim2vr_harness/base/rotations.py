"""Rotations by unit quaternions, in any frame."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def turned(axis: FloatArray, real: ArrayLike, vectors: ArrayLike) -> FloatArray:
    """Return (..., 3) vectors turned by unit quaternions.

    Args:
        axis: (..., 3) their imaginary parts x y z; with the other sign they turn back.
        real: (..., 1) their real parts w, or () of one.
        vectors: (..., 3).
    """
    given, w = np.asarray(vectors, dtype=np.float64), np.asarray(real, dtype=np.float64)
    across = 2.0 * _cross(axis, given)
    return np.asarray(given + w * across + _cross(axis, across))


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the (..., 4) rotations by b, then a, x y z w."""
    u, v, s, t = a[..., :3], b[..., :3], a[..., 3:], b[..., 3:]
    scalar = s * t - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([s * v + t * u + _cross(u, v), scalar], axis=-1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return cross products as ``np.cross``, which takes four times as long for a few of them."""
    return np.asarray(a.take(_NEXT, -1) * b.take(_LAST, -1) - a.take(_LAST, -1) * b.take(_NEXT, -1))
