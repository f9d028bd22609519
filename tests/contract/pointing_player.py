"""A scripted player of pointing who sees: finds the target in the headset's picture and taps it.

A tap takes three frames: out of the way, to see; before the plane; through it.
"""

import numpy as np
from numpy.typing import NDArray
from players import HEAD, controller_at

from sim2vr_harness.client import DevicePoses

# docs/reference/games/pointing.md: the circle's centre from the head, the tip from the grip.
CENTER = np.array([0.15, -0.10, 0.40])
TIP = np.array([0.0, 0.0, 0.10])
AWAY = np.array([0.0, -0.5, 0.1])
# The picture's vertical angle is 90 degrees.
HALF_HEIGHT = 1.0
SPREAD_M = 0.003


def find_target(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The red disc's middle from the head, m; the app's axes."""
    height, width = image.shape[:2]
    red = np.clip(image[..., 0].astype(float) - image[..., 1:3].max(axis=2), 0.0, None)
    red[red < 40.0] = 0.0
    assert red.sum() > 0.0, "no target in the picture"
    rows, columns = np.indices((height, width)) + 0.5
    pixel = 2.0 * HALF_HEIGHT / height
    x = (red * columns).sum() / red.sum() - width / 2.0
    y = height / 2.0 - (red * rows).sum() / red.sum()
    return CENTER[2] * np.array([pixel * x, pixel * y, 1.0])


class PointingPlayer:
    """Taps what it sees, a little beside the middle, so that selections spread."""

    def __init__(self) -> None:
        self._aim = CENTER
        self._taps = 0

    def __call__(self, frame: int, image: NDArray[np.uint8]) -> DevicePoses:
        """Poses of a frame, by the picture of the frame before."""
        phase = frame % 3
        if phase == 1:
            shift = SPREAD_M * (self._taps % 3 - 1)
            self._aim = find_target(image) + np.array([shift, 0.0, 0.0])
            self._taps += 1
        from_aim = [None, -0.02, 0.02][phase]
        tip = AWAY if from_aim is None else self._aim + np.array([0.0, 0.0, from_aim])
        return DevicePoses(HEAD, controller_at(HEAD[:3] + tip - TIP))
