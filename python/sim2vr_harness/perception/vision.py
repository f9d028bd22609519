"""The headset's picture as the user's visual perception."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

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

    Raises:
        ValueError: unknown or repeated channels.
    """
    channel_indices(channels)

    def look(moment: StepContext, ids: IntArray | None) -> UInt8Array:
        return moment.pictures[rows_of(ids)]

    space: spaces.Box[Any] = spaces.Box(0, 255, (eyes * len(channels), height, width), np.uint8)
    needs = "two_eyes" if eyes == 2 else None
    return Sensed(name, space, n, look, frame_grid=frame_grid, needs=needs)


def fovea(
    name: str,
    n: int,
    channels: Sequence[str] | None,
    size: tuple[int, int] | None,
    frame_grid: int,
) -> Sensed:
    """Return the sense of N pictures around the gaze; in a saccade nothing is seen.

    Args:
        name, n, frame_grid: as of :func:`vision`.
        channels: as of :func:`vision`, 0 in a saccade; None: the depths alone, metres, float32, 0
            where nothing is seen.
        size: height and width, pixels.

    Raises:
        ValueError: none is drawn.
    """
    if size is None:
        got = "fovea" if channels else "fovea_depth"
        raise ValueError(f"senses: got {got!r}, expected vision.fovea for it to be drawn")
    picked = channel_indices(channels) if channels else []

    def look(moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        rows = rows_of(ids)
        seen = ~moment.blind[rows, None, None]
        if channels is None:
            return moment.fovea_depth[rows][:, None] * seen[:, None]
        return np.moveaxis(moment.fovea[rows][..., picked] * seen[..., None], -1, 1)

    high, kind = (255, np.uint8) if channels else (np.inf, np.float32)
    space: spaces.Box[Any] = spaces.Box(0, high, (len(picked) or 1, *size), kind)
    return Sensed(name, space, n, look, frame_grid=frame_grid, needs="fovea")


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
