"""A scripted player of the panel who sees: aims at the lit button and pulls the trigger.

A selection takes three frames: the ray goes elsewhere, to see; onto the button; the trigger.
"""

import numpy as np
from numpy.typing import NDArray
from players import HEAD
from scipy.spatial.transform import Rotation

from sim2vr_harness.client import DevicePoses
from sim2vr_harness.client.devices import INPUT_COUNT, input_named

# docs/reference/games/panel.md: the panel's distance from the head. The picture's vertical angle
# is 90 degrees.
DISTANCE_M = 1.5
HAND = np.array([0.2, 0.9, 0.3])
GRIP_TO_AIM = Rotation.from_euler("x", 60.0, degrees=True)
"""60 degrees down; in the app's left-handed frame a turn about x to the front is positive."""
TRIGGER = input_named("right.trigger").column


def find_lit(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """World place of the middle of what is red in the headset's picture, m; the app's axes."""
    height, width = image.shape[:2]
    red = np.clip(image[..., 0].astype(float) - image[..., 1:3].max(axis=2), 0.0, None)
    red[red < 40.0] = 0.0
    assert red.sum() > 0.0, "nothing is lit in the picture"
    rows, columns = np.indices((height, width)) + 0.5
    pixel = 2.0 / height
    x = (red * columns).sum() / red.sum() - width / 2.0
    y = height / 2.0 - (red * rows).sum() / red.sum()
    return HEAD[:3] + DISTANCE_M * np.array([pixel * x, pixel * y, 1.0])


def aimed(place: NDArray[np.float64], trigger: float) -> DevicePoses:
    """Right hand at HAND whose aim ray goes through a place."""
    x, y, z = (place - HAND) / np.linalg.norm(place - HAND)
    aim = Rotation.from_euler("YX", [np.arctan2(x, z), -np.arcsin(y)])
    inputs = np.zeros(INPUT_COUNT)
    inputs[TRIGGER] = trigger
    grip = np.concatenate([HAND, (aim * GRIP_TO_AIM.inv()).as_quat()])
    return DevicePoses(HEAD, grip, right_inputs=inputs)


class PanelPlayer:
    """Operates what it sees."""

    def __init__(self) -> None:
        self._place = HAND + np.array([0.0, 1.0, 1.0])

    def __call__(self, frame: int, image: NDArray[np.uint8]) -> DevicePoses:
        """Poses of a frame, by the picture of the frame before."""
        if frame % 3 == 1:
            self._place = find_lit(image)
        away = HAND + np.array([1.0, 1.0, 1.0])
        return aimed(away if frame % 3 == 0 else self._place, float(frame % 3 == 2))
