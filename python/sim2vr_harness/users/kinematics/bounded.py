"""Bounded linear least squares of a few dozen unknowns, such as activations of muscles."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

FloatArray = NDArray[np.float64]


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
