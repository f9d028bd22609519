"""Scripted players for the contract suite: poses as functions of the frame number."""

import numpy as np

from sim2vr_harness.client import DevicePoses

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
