"""What a student has seen: every collected user step, images in a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["FrameStore"]


class FrameStore:
    """Every collected user step, in the order of collection, images in a file.

    The file is only ever appended to, so that a stage which is resumed sees just the frames that
    the stopped one saw.

    Args:
        file: where images go; made or reused.
        capacity: number of frames.
        shapes: key -> (shape, dtype) of what a frame holds.
    """

    def __init__(
        self, file: Path, capacity: int, shapes: Mapping[str, tuple[tuple[int, ...], Any]]
    ) -> None:
        self.count = 0
        self.capacity = capacity
        self._arrays: dict[str, NDArray[Any]] = {}
        for key, (shape, dtype) in shapes.items():
            if key == "vision":
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
        """Return all but the images, which are made sure to be in the file."""
        vision = self._arrays.get("vision")
        if isinstance(vision, np.memmap):
            vision.flush()
        return {key: array[: self.count] for key, array in self._arrays.items() if key != "vision"}

    def restore(self, count: int, state: Mapping[str, NDArray[Any]]) -> None:
        """Go back to the first ``count`` frames."""
        self.count = count
        for key, values in state.items():
            self._arrays[key][:count] = values
