"""The headset's picture as the user's visual perception."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

CHANNELS: tuple[str, ...] = ("red", "green", "blue", "depth")
"""Channels of the application's RGBA picture; depth is linear, 0 at the eye and 255 at the far
plane or beyond."""

ImageArray = NDArray[np.uint8]


class HeadsetVision:
    """Picks channels of N headset pictures and, if asked, remembers how they looked before.

    Observations stay uint8, channel first: rollouts take a quarter of the memory that float32
    takes, and the policy network scales them itself to (x / 255 - 0.5) * 2, the values that the
    SIM2VR paper's network sees.

    With a time buffer an observation holds the newest picture's channels and then those of the
    oldest picture in the buffer, `buffer_seconds` before. After a reset the whole buffer holds the
    first picture.

    Args:
        channels: any of `CHANNELS`, in the order wanted. The SIM2VR paper's Whac-A-Mole user sees
            green and depth.
        buffer_seconds: age of the old picture in s, None for no buffer. The SIM2VR paper's Beats
            user has 0.2 s: a buffer of 5 pictures at 20 Hz.
        n: number of users N.
        step_seconds: time between pictures in s.
        height, width: picture size in pixels.

    Raises:
        ValueError: unknown or repeated channels, or a number out of range.
    """

    def __init__(
        self,
        channels: Sequence[str] = ("green", "depth"),
        buffer_seconds: float | None = None,
        *,
        n: int = 1,
        step_seconds: float = 0.05,
        height: int = 80,
        width: int = 120,
    ) -> None:
        for field, value in (("n", n), ("height", height), ("width", width)):
            if int(value) != value or value < 1:
                raise ValueError(f"{field}: got {value}, expected a whole number, at least 1")
        self.n, self.height, self.width = n, height, width
        self.channels = _checked_channels(channels)
        self.channel_indices = [CHANNELS.index(name) for name in self.channels]
        self.frames = _frame_count(buffer_seconds, step_seconds)
        self._buffer = np.zeros((n, self.frames, len(channels), height, width), dtype=np.uint8)
        self._newest = np.zeros(n, dtype=np.int64)
        self._fresh = np.ones(n, dtype=bool)

    @property
    def observation_space(self) -> spaces.Box:
        """Space of one user's observation, (C, H, W) uint8; C counts old channels too."""
        count = len(self.channels) * (1 if self.frames == 1 else 2)
        return spaces.Box(0, 255, (count, self.height, self.width), np.uint8)

    def reset(self, ids: Sequence[int] | NDArray[np.integer] | None = None) -> None:
        """Forgets the past of these users, or of all; their next picture fills the buffer.

        Raises:
            ValueError: an index out of range.
        """
        self._fresh[self._checked_ids(ids)] = True

    def observe(
        self, images: ImageArray, ids: Sequence[int] | NDArray[np.integer] | None = None
    ) -> ImageArray:
        """Takes new pictures in and returns what the users see.

        Args:
            images: (K, H, W, 4) uint8 RGBA, first row at the top; not kept.
            ids: the K users whose pictures these are; None for all N.

        Returns:
            (K, C, H, W) uint8, owned by the caller.

        Raises:
            ValueError: the pictures have another shape or type, or an index is out of range.
        """
        rows = self._checked_ids(ids)
        shape = (len(rows), self.height, self.width, len(CHANNELS))
        if images.dtype != np.uint8 or images.shape != shape:
            raise ValueError(
                f"images: got {images.dtype} {images.shape}, expected uint8 {shape} (RGBA rows)"
            )
        self.take(self.pick(images), rows)
        return self.seen(rows)

    def pick(self, images: ImageArray) -> ImageArray:
        """The channels of pictures, (..., H, W, 4) -> (..., C, H, W), a copy."""
        return np.moveaxis(images, -1, -3)[..., self.channel_indices, :, :]

    def take(self, pictures: ImageArray, ids: NDArray[np.integer] | None = None) -> None:
        """Takes new pictures in, their channels picked already.

        Args:
            pictures: (K, C, H, W) uint8; copied.
            ids: (K,) whose pictures these are, each user once; None for all N.
        """
        rows = np.arange(self.n) if ids is None else ids
        self._newest[rows] = (self._newest[rows] + 1) % self.frames
        if ids is None and self.frames == 1:
            self._buffer[:, 0] = pictures  # several times as fast as an index list
        else:
            self._buffer[rows, self._newest[rows]] = pictures
        first = self._fresh[rows]
        if first.any():
            self._buffer[rows[first]] = pictures[first][:, None]
            self._fresh[rows] = False

    def seen(self, ids: NDArray[np.integer] | None = None) -> ImageArray:
        """What the users see now: (K, C, H, W) uint8, owned by the caller; None for all N."""
        rows = np.arange(self.n) if ids is None else ids
        if self.frames == 1:
            return self._buffer[:, 0].copy() if ids is None else self._buffer[rows, 0]
        count = len(self.channels)
        picture = np.empty((len(rows), 2 * count, self.height, self.width), dtype=np.uint8)
        picture[:, :count] = self._buffer[rows, self._newest[rows]]
        picture[:, count:] = self._buffer[rows, (self._newest[rows] + 1) % self.frames]
        return picture

    def get_state(self, i: int) -> dict[str, NDArray[np.generic]]:
        """Returns copies of what is remembered of user i."""
        return {
            "buffer": self._buffer[i].copy(),
            "newest": np.array(self._newest[i]),
            "fresh": np.array(self._fresh[i]),
        }

    def set_state(self, i: int, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Restores what `get_state` returned.

        Raises:
            ValueError: the state is of a buffer with another shape.
        """
        expected = self._buffer.shape[1:]
        if state["buffer"].shape != expected:
            raise ValueError(
                f"vision state buffer: got shape {state['buffer'].shape}, expected {expected}"
            )
        self._buffer[i] = state["buffer"]
        self._newest[i] = int(state["newest"])
        self._fresh[i] = bool(state["fresh"])

    def _checked_ids(self, ids: Sequence[int] | NDArray[np.integer] | None) -> NDArray[np.int64]:
        rows = np.arange(self.n) if ids is None else np.asarray(ids, dtype=np.int64)
        wrong = rows[(rows < 0) | (rows >= self.n)]
        if wrong.size:
            raise ValueError(f"ids: got {int(wrong[0])}, expected 0 to {self.n - 1}")
        return rows


def _checked_channels(channels: Sequence[str]) -> tuple[str, ...]:
    for name in channels:
        if name not in CHANNELS:
            raise ValueError(f"channels: got {name!r}, expected some of {', '.join(CHANNELS)}")
    if not channels or len(set(channels)) != len(channels):
        raise ValueError(f"channels: got {tuple(channels)}, expected each at most once, at least 1")
    return tuple(channels)


def _frame_count(buffer_seconds: float | None, step_seconds: float) -> int:
    """Pictures to keep so that the oldest is `buffer_seconds` older than the newest."""
    if not step_seconds > 0:
        raise ValueError(f"step_seconds: got {step_seconds}, expected a time above 0 s")
    if buffer_seconds is None:
        return 1
    # Rounded, not truncated, since 0.15 / 0.05 is a hair below 3 in floating point.
    steps = round(buffer_seconds / step_seconds)
    if steps < 1 or abs(steps * step_seconds - buffer_seconds) > 1e-6:
        raise ValueError(
            f"buffer_seconds: got {buffer_seconds}, expected None or a multiple of "
            f"step_seconds={step_seconds}"
        )
    return steps + 1
