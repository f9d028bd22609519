"""Scripted players for the contract suite: poses as functions of the frame number."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from sim2vr_harness.client import (
    INPUT_COUNT,
    AppClient,
    AppReply,
    DevicePoses,
    frame_time_ns,
    input_named,
)

Player = Callable[[int], DevicePoses]
HEAD = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
FRAME_NS = 50_000_000

# Whac-A-Mole's geometry (docs/reference/games/whacamole.md): the grid relative to the head for the
# middle placement, and the centre of the hammer's head in the controller's frame.
AREA_FROM_HEAD = np.array([0.15, -0.10, 0.40])
CELLS = [np.array([x, y, 0.0]) for y in (0.125, 0.0, -0.125) for x in (-0.125, 0.0, 0.125)]
HAMMER_FROM_CONTROLLER = np.array([0.0094392, 0.0393488, 0.0537127])


def controller_at(position: np.ndarray) -> np.ndarray:
    """Right controller, unrotated."""
    return np.concatenate([position, [0.0, 0.0, 0.0, 1.0]])


def idle(_frame: int) -> DevicePoses:
    """Stands still with the hand at the hip."""
    return DevicePoses(HEAD, controller_at(np.array([0.2, 0.8, 0.1])))


def wander(frame: int) -> DevicePoses:
    """Moves head and hand smoothly through the space in front of the body."""
    t = 0.05 * frame
    head = HEAD + np.array([0.02 * np.sin(t), 0.01 * np.cos(2 * t), 0, 0, 0, 0, 0])
    hand = np.array([0.15 + 0.2 * np.sin(1.3 * t), 1.0 + 0.2 * np.sin(1.7 * t), 0.3])
    hand[2] += 0.15 * np.sin(4.1 * t)
    return DevicePoses(head, controller_at(hand))


def flailing(frame: int) -> DevicePoses:
    """Head, both hands and their rotations at random, from frame to frame."""
    rng = np.random.default_rng(frame)
    poses = []
    for centre in (HEAD[:3], HEAD[:3] - AREA_FROM_HEAD, HEAD[:3] + AREA_FROM_HEAD):
        rotation = rng.standard_normal(4)
        position = centre + 0.15 * rng.standard_normal(3)
        poses.append(np.concatenate([position, rotation / np.linalg.norm(rotation)]))
    head, left, right = poses
    return DevicePoses(head, right, left)


def whacker(frame: int) -> DevicePoses:
    """Strikes the nine cells in turn: two frames 12 cm in front, one frame in the target.

    The strike moves the hammer 12 cm in 50 ms: 2.4 m/s, filtered to at least
    0.5 * (-0.3) + 0.5 * 2.4 = 1.05 m/s, above the threshold of 0.8 m/s.
    """
    cell = CELLS[(frame // 3) % 9]
    depth = 0.01 if frame % 3 == 2 else -0.11
    target = HEAD[:3] + AREA_FROM_HEAD + cell + np.array([0.0, 0.0, depth])
    return DevicePoses(HEAD, controller_at(target - HAMMER_FROM_CONTROLLER))


def trace(
    app: AppClient, player: Player, frames: int = 40, *, seed: int = 7, start: int = 0
) -> list[tuple[AppReply, bytes, int]]:
    """(reply, image bytes, state hash) of each frame; resets first unless start > 0.

    Ends with the round, which a game may cut short.
    """
    rows = []
    for frame in range(start, start + frames):
        if frame == 0:
            reply = app.reset(seed, player(0))
        else:
            reply = app.step(frame_time_ns(frame, 20), player(frame))
        rows.append((reply, app.image.tobytes(), app.state_hash()))
        if reply.finished:
            break
    return rows


def red_middle(image: np.ndarray, distance_m: float) -> np.ndarray:
    """Middle of what is red in the headset's picture, from the head, m; the app's axes."""
    height, width = image.shape[:2]
    red = np.clip(image[..., 0].astype(float) - image[..., 1:3].max(axis=2), 0.0, None)
    red[red < 40.0] = 0.0
    assert red.sum() > 0.0, "nothing red in the picture"
    rows, columns = np.indices((height, width)) + 0.5
    pixel = 2.0 / height  # the picture's vertical angle is 90 degrees
    x = (red * columns).sum() / red.sum() - width / 2.0
    y = height / 2.0 - (red * rows).sum() / red.sum()
    return distance_m * np.array([pixel * x, pixel * y, 1.0])


class PanelPlayer:
    """Aims at the lit button and pulls the trigger; a selection takes three frames.

    The ray goes elsewhere, to see; onto the button; the trigger. docs/reference/games/panel.md has
    the panel's distance from the head.
    """

    hand = np.array([0.2, 0.9, 0.3])
    # 60 degrees down; in the app's left-handed frame a turn about x to the front is positive.
    grip_to_aim = Rotation.from_euler("x", 60.0, degrees=True)

    def __init__(self) -> None:
        self._place = self.hand + np.array([0.0, 1.0, 1.0])

    def __call__(self, frame: int, image: np.ndarray) -> DevicePoses:
        """Poses of a frame, by the picture of the frame before."""
        if frame % 3 == 1:
            self._place = HEAD[:3] + red_middle(image, 1.5)
        place = self.hand + np.array([1.0, 1.0, 1.0]) if frame % 3 == 0 else self._place
        x, y, z = (place - self.hand) / np.linalg.norm(place - self.hand)
        aim = Rotation.from_euler("YX", [np.arctan2(x, z), -np.arcsin(y)])
        inputs = np.zeros(INPUT_COUNT)
        inputs[input_named("right.trigger").column] = float(frame % 3 == 2)
        grip = np.concatenate([self.hand, (aim * self.grip_to_aim.inv()).as_quat()])
        return DevicePoses(HEAD, grip, right_inputs=inputs)


class PointingPlayer:
    """Taps targets a little beside the middle, so that selections spread.

    A tap takes three frames: out of the way, to see; before the plane; through it.
    docs/reference/games/pointing.md has the circle's centre and the tip from the grip.
    """

    center, tip = np.array([0.15, -0.10, 0.40]), np.array([0.0, 0.0, 0.10])

    def __init__(self) -> None:
        self._aim, self._taps = self.center, 0

    def __call__(self, frame: int, image: np.ndarray) -> DevicePoses:
        """Poses of a frame, by the picture of the frame before."""
        if frame % 3 == 1:
            shift = 0.003 * (self._taps % 3 - 1)
            self._aim = red_middle(image, self.center[2]) + np.array([shift, 0.0, 0.0])
            self._taps += 1
        tip = np.array([0.0, -0.5, 0.1])
        if frame % 3:
            tip = self._aim + np.array([0.0, 0.0, -0.02 if frame % 3 == 1 else 0.02])
        return DevicePoses(HEAD, controller_at(HEAD[:3] + tip - self.tip))
