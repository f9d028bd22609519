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
    """Every collected user step, in the order of collection, pictures in files.

    The files are only ever appended to, so that a stage which is resumed sees just the frames that
    the stopped one saw.

    Args:
        folder: where files of pictures go (:data:`PICTURE_FILES`); made or reused.
        capacity: number of frames.
        shapes: key -> (shape, dtype) of what a frame holds.
    """

    def __init__(
        self, folder: Path, capacity: int, shapes: Mapping[str, tuple[tuple[int, ...], Any]]
    ) -> None:
        self.count = 0
        self.capacity = capacity
        self._arrays: dict[str, NDArray[Any]] = {}
        for key, (shape, dtype) in shapes.items():
            if dtype == np.uint8 and len(shape) == 3:
                file = folder / PICTURE_FILES.replace("*", key)
                self._arrays[key] = np.memmap(
                    file, dtype, "r+" if file.is_file() else "w+", shape=(capacity, *shape)
                )
            else:
                self._arrays[key] = np.zeros((capacity, *shape), dtype)

    def append(self, frame: Mapping[str, NDArray[Any]]) -> None:
        """Take (N, ...) of every key."""
        rows = len(next(iter(frame.values())))
        for key, array in self._arrays.items():
            array[self.count : self.count + rows] = frame[key]
        self.count += rows

    def rows(self, indices: NDArray[np.integer]) -> dict[str, Tensor]:
        """Return copies of these frames."""
        return {key: torch.from_numpy(array[indices]) for key, array in self._arrays.items()}

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
            self._arrays[key][:count] = values
