"""The headset's picture as the user's visual perception."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.perception.foveation import Foveation
from sim2vr_harness.perception.sense import IntArray, Sensed, StepContext, rows_of

CHANNELS: tuple[str, ...] = ("red", "green", "blue", "depth")
"""Channels of the application's RGBA picture; depth is linear, 0 at the eye and 255 at the far
plane or beyond."""

UInt8Array = NDArray[np.uint8]


def vision(
    name: str,
    n: int,
    *,
    channels: Sequence[str],
    eyes: int,
    height: int,
    width: int,
    frame_grid: int,
    foveation: Foveation | None = None,
    zoom: int = 1,
) -> Sensed:
    """The sense of N headset pictures.

    Observations stay uint8, channel first: rollouts take a quarter of the memory that float32
    takes, and the policy network scales them itself to (x / 255 - 0.5) * 2, the values that the
    SIM2VR paper's network sees. With two eyes the left one's channels come first.

    Args:
        name: key in the observation.
        n: number of users N.
        channels: any of :data:`CHANNELS`, in the order wanted. The SIM2VR paper's Whac-A-Mole user
            sees green and depth.
        eyes: 1 or 2.
        height: of the pictures, pixels.
        width: of the pictures, pixels.
        frame_grid: physics steps between app frames.
        foveation: how the resolution falls towards the edge; None: it does not.
        zoom: odd; of pictures drawn so many times as wide and as high, every so many pixels: those
            whose rays are the ones of a picture of ``height`` x ``width``.

    Raises:
        ValueError: unknown or repeated channels.
    """
    channel_indices(channels)

    def look(moment: StepContext, ids: IntArray | None) -> UInt8Array:
        pictures = moment.pictures[rows_of(ids)][..., zoom // 2 :: zoom, zoom // 2 :: zoom]
        if foveation is None:
            return pictures
        gaze = moment.gaze_deg[rows_of(ids)] if moment.gaze_deg.size else None
        return foveation.look(pictures, gaze)

    return _pictures(name, n, look, (eyes * len(channels), height, width), eyes, frame_grid)


def fovea(
    name: str,
    n: int,
    *,
    channels: Sequence[str],
    eyes: int,
    height: int,
    width: int,
    frame_grid: int,
    zoom: int,
) -> Sensed:
    """The middle of N headset pictures, at ``zoom`` times the detail of :func:`vision`.

    People see sharply where they look, and look where things come from: 120 x 80 pixels over 90
    degrees are 1.4 degrees a pixel in the middle.

    Args:
        name, n, channels, eyes, height, width, frame_grid: as of :func:`vision`.
        zoom: how many times as wide and as high the drawn pictures are.

    Raises:
        ValueError: nothing is drawn larger than it is seen.
    """
    if zoom == 1:
        raise ValueError("senses: got 'fovea', expected vision.zoom: 3 or 5 for more to be seen")
    top, left = (zoom - 1) * height // 2, (zoom - 1) * width // 2

    def look(moment: StepContext, ids: IntArray | None) -> UInt8Array:
        pictures = moment.pictures[rows_of(ids)]
        return pictures[..., top : top + height, left : left + width]

    return _pictures(name, n, look, (eyes * len(channels), height, width), eyes, frame_grid)


def _pictures(
    name: str, n: int, look: Any, shape: tuple[int, int, int], eyes: int, frame_grid: int
) -> Sensed:
    space: spaces.Box[Any] = spaces.Box(0, 255, shape, np.uint8)
    needs = "two_eyes" if eyes == 2 else None
    return Sensed(name, space, n, look, frame_grid=frame_grid, needs=needs)


def channel_indices(channels: Sequence[str]) -> list[int]:
    """Return the indices of these channels in an RGBA image.

    Raises:
        ValueError: unknown or repeated channels, or none.
    """
    for name in channels:
        if name not in CHANNELS:
            raise ValueError(f"channels: got {name!r}, expected some of {', '.join(CHANNELS)}")
    if not channels or len(set(channels)) != len(channels):
        raise ValueError(f"channels: got {tuple(channels)}, expected each at most once, at least 1")
    return [CHANNELS.index(name) for name in channels]


def pick_channels(images: UInt8Array, indices: Sequence[int]) -> UInt8Array:
    """Return a copy of the selected channels of an app's images, channel first.

    Args:
        images: (H, W, 4) of one eye, or (2, H, W, 4), left and right.
        indices: C of them.

    Returns:
        (C, H, W), or (2 C, H, W).
    """
    picked = np.moveaxis(images, -1, -3)[..., list(indices), :, :]
    return picked.reshape(-1, *picked.shape[-2:])
