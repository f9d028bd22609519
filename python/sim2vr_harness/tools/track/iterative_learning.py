"""Iterative learning control: what a go at a path missed by moves the goals of the next one.

A hand that is led by goals lags behind fast ones and cuts their corners, the same way each time. So
the recording is followed again with goals that are shifted against the error (S. Arimoto, S.
Kawamura, F. Miyazaki: Bettering operation of robots by learning. Journal of Robotic Systems 1(2),
1984). That needs the whole recording beforehand, which a person does not have: the activations are
those of a person who has learned the movement by heart.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import uniform_filter1d
from scipy.sparse.linalg import splu

FloatArray = NDArray[np.float64]

_RESPONSE = (0.15, 0.38, 0.24, 0.13, 0.05)
"""What a goal's shift moves the hand by, the step before the goal's time first: measured in MuJoCo
with random shifts of 15 mm (motor layer of ``mobl_arms_wrist``, fast and slow paths)."""
_EASE = 0.15
"""Weight of shifts beside errors: the response is uncertain where it is fast."""
_GAIN, _GROWTH, _SETBACK = 0.6, 1.1, 0.5
"""Share of the correction that is tried at first; its change where errors shrank, or grew."""
_FURTHEST_M = 0.25
_NEARBY = 7
"""Steps over which errors are compared."""


class Correction:
    """Shifts of goals that become better from go to go.

    Where a shift made things worse, the best one so far is kept and less is tried.

    Args:
        places: (J, H, 3) where the hands shall be; the last goals lie beyond the last step.

    Attributes:
        shift: (J, H, 3) to be added to the goals' places in the next go, m.
    """

    def __init__(self, places: FloatArray) -> None:
        self._places = places
        self.shift: FloatArray = np.zeros_like(places)
        self._kept = self.shift.copy()
        self._errors: FloatArray | None = None
        self._size: FloatArray = np.full(places.shape[:2], np.inf)
        self._gain = np.full(places.shape[:2], _GAIN)
        self._response: tuple[Any, Any] | None = None

    def learn(self, reached: FloatArray) -> None:
        """Take in where the hands were, (M + 1, H, 3), with the present shift."""
        count = len(reached)
        errors = self._places[:count] - reached
        size = np.full(self._size.shape, np.inf)
        near = uniform_filter1d((errors**2).sum(-1), _NEARBY, axis=0)
        size[:count] = near
        size[count:] = near[-1:]
        better = size <= self._size
        if self._errors is None:
            self._errors = errors
        else:
            self._errors = np.where(better[:count, :, None], errors, self._errors)
            self._gain *= np.where(better, _GROWTH, _SETBACK)
            self._gain = np.minimum(self._gain, 1.0)
        self._kept = np.where(better[..., None], self.shift, self._kept)
        self._size = np.minimum(size, self._size)
        if self._response is None:
            self._response = _response(len(self._places), count)
        response, normal = self._response
        missed = response.T @ self._errors.reshape(count, -1)
        change = normal.solve(missed).reshape(self.shift.shape)
        gain = uniform_filter1d(self._gain, 5, axis=0)[..., None]
        shift = self._kept + gain * change
        far = np.linalg.norm(shift, axis=-1, keepdims=True)
        self.shift = shift * np.minimum(1.0, _FURTHEST_M / np.maximum(far, 1e-9))


def _response(goals: int, moments: int) -> tuple[Any, Any]:
    """What shifts of goals move the hand by, (moments, goals), and its factored normal matrix."""
    rows = np.arange(1, moments)
    parts = []
    for lag, share in enumerate(_RESPONSE):
        columns = rows + 1 - lag
        inside = (columns >= 2) & (columns < goals)
        place = (rows[inside], columns[inside])
        parts.append(
            sparse.csc_matrix((np.full(inside.sum(), share), place), shape=(moments, goals))
        )
    response = sum(parts[1:], parts[0])
    return response, splu((response.T @ response + _EASE * sparse.eye(goals)).tocsc())
