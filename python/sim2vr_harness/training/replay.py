"""The replay store: user steps or decisions in the order of collection, pictures in files."""

import errno
import math
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming
from sim2vr_harness.base.state import State


class ReplayStore(State):
    """Collected frames, in the order of collection, with images in files.

    The files are only appended to, so that a resumed stage reads exactly the frames that the
    stopped one had. A store of the last frames reuses its files as ring buffers, and is ``slack``
    frames longer than what can be read: frames that a stage collects between two of its checkpoints
    do not overwrite those that the older one needs.

    Args:
        file: of images (bytes of three or more axes); ``*`` in its name stands for their key. It
            is made, or reused.
        capacity: number of frames that can be read.
        shapes: key -> (shape, dtype) of a frame's data.
        slack: additional frames; a multiple of the number appended at a time, as is capacity.

    Raises:
        InputError: The disk has no room for the images; the message says how much they need.
    """

    def __init__(
        self,
        file: Path,
        capacity: int,
        shapes: Mapping[str, tuple[tuple[int, ...], Any]],
        slack: int = 0,
    ) -> None:
        self.count = 0
        """Number of frames appended so far, including overwritten ones."""
        self.capacity = capacity
        self._length = length = capacity + slack
        self._arrays: dict[str, NDArray[Any]] = {}
        pictures = {
            key: (length, *shape)
            for key, (shape, dtype) in shapes.items()
            if dtype == np.uint8 and len(shape) >= 3
        }
        needed = sum(map(math.prod, pictures.values()))
        for key, (shape, dtype) in shapes.items():
            if key in pictures:
                own = file.with_name(file.name.replace("*", key))
                self._arrays[key] = _mapped(own, pictures[key], needed)
            else:
                self._arrays[key] = np.zeros((length, *shape), dtype)

    @property
    def first(self) -> int:
        """Index of the oldest frame that can be read."""
        return max(0, self.count - self.capacity)

    def append(self, frame: Mapping[str, NDArray[Any]]) -> None:
        """Append (N, ...) of keys; those that are left out follow by :meth:`amend`."""
        rows = len(next(iter(frame.values())))
        self.count += rows
        self.amend(frame)

    def amend(self, frame: Mapping[str, NDArray[Any]]) -> None:
        """Replace (N, ...) of keys in the latest N frames."""
        for key, values in frame.items():
            at = (self.count - len(values)) % self._length
            self._arrays[key][at : at + len(values)] = values

    def read(self, key: str, *indices: NDArray[np.integer]) -> NDArray[Any]:
        """Return a copy of one key of frames, by :attr:`first` to :attr:`count`.

        Args:
            indices: frames, and entries of the axes within them, as NumPy broadcasts them.
        """
        frames, *within = indices
        return np.asarray(self._arrays[key][(frames % self._length, *within)])

    def rows(self, indices: NDArray[np.integer]) -> dict[str, Tensor]:
        """Return copies of all keys of frames, by :attr:`first` to :attr:`count`."""
        return {key: torch.from_numpy(self.read(key, indices)) for key in self._arrays}

    def state_dict(self) -> dict[str, Any]:
        """Return all data except the images, and ensure that these are in their files.

        Frames that are appended later do not overwrite any frame of this state, as long as they are
        within the slack.
        """
        known: dict[str, Any] = {"count": self.count}
        for key, array in self._arrays.items():
            if isinstance(array, np.memmap):
                array.flush()
            else:
                known[key] = torch.from_numpy(array[: self.count])
        return known

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Return to the frames of :meth:`state_dict`."""
        self.count = state["count"]
        for key in state.keys() - {"count"}:
            values = state[key]
            self._arrays[key][: len(values)] = values.cpu().numpy()


def _mapped(file: Path, shape: tuple[int, ...], needed: int) -> NDArray[np.uint8]:
    """Map bytes of a file that is made, or reused, with room on the disk for all of them.

    Writing to a mapped page for which a full disk has no room would end the process by SIGBUS.
    """
    there = file.is_file()
    with naming(file), open(file, "r+b" if there else "w+b") as stream:
        try:
            os.posix_fallocate(stream.fileno(), 0, math.prod(shape))
        except OSError as error:
            if not there:
                file.unlink()
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            got = f"a disk with {shutil.disk_usage(file.parent).free / 2**30:,.2f} GiB of room"
            expected = (
                f"{needed / 2**30:,.2f} GiB for all pictures of this training; make room, or train "
                "in a folder on another disk (--out)"
            )
            raise InputError(str(file), got, expected) from error
        return np.memmap(stream, np.uint8, "r+", shape=shape)
