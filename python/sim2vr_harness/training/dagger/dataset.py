"""What a student has seen: every collected user step, pictures in files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["PICTURE_FILES", "FrameStore"]

PICTURE_FILES = "frames.*.bin"
"""Files of pictures, the star being the sense's key."""


class FrameStore:
    """Collected user steps, in the order of collection, pictures in files.

    The files are only ever appended to, so that a stage which is resumed sees just the frames that
    the stopped one saw. A store that keeps the last ones only goes round in its files, and is
    ``slack`` frames longer than what may be asked for: what a stage collects between two of its
    checkpoints is written over nothing that the older one needs.

    Args:
        folder: where files of pictures go (:data:`PICTURE_FILES`); made or reused.
        capacity: number of frames that can be asked for.
        shapes: key -> (shape, dtype) of what a frame holds.
        slack: frames beyond these; a multiple of how many are appended at a time, as is capacity.
    """

    def __init__(
        self,
        folder: Path,
        capacity: int,
        shapes: Mapping[str, tuple[tuple[int, ...], Any]],
        slack: int = 0,
    ) -> None:
        self.count = 0
        """Frames so far, whether they are still there or not."""
        self.capacity = capacity
        self._length = length = capacity + slack
        self._arrays: dict[str, NDArray[Any]] = {}
        for key, (shape, dtype) in shapes.items():
            if dtype == np.uint8 and len(shape) == 3:
                file = folder / PICTURE_FILES.replace("*", key)
                self._arrays[key] = np.memmap(
                    file, dtype, "r+" if file.is_file() else "w+", shape=(length, *shape)
                )
            else:
                self._arrays[key] = np.zeros((length, *shape), dtype)

    @property
    def first(self) -> int:
        """The oldest frame that is there."""
        return max(0, self.count - self.capacity)

    def append(self, frame: Mapping[str, NDArray[Any]]) -> None:
        """Take (N, ...) of every key."""
        rows = len(next(iter(frame.values())))
        at = self.count % self._length
        for key, array in self._arrays.items():
            array[at : at + rows] = frame[key]
        self.count += rows

    def rows(self, indices: NDArray[np.integer]) -> dict[str, Tensor]:
        """Return copies of these frames, from :attr:`first` on to :attr:`count`."""
        at = indices % self._length
        return {key: torch.from_numpy(array[at]) for key, array in self._arrays.items()}

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all but the pictures, which are made sure to be in their files."""
        known = {}
        for key, array in self._arrays.items():
            if isinstance(array, np.memmap):
                array.flush()
            else:
                known[key] = array[: self.count]
        return known

    def restore(self, count: int, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to the first ``count`` frames."""
        self.count = count
        for key, values in state.items():
            self._arrays[key][: len(values)] = values
