"""Geometry of the image cells: the headset's depth image as positions in the world."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["CELL_PX", "FAR_M", "DepthGrid", "rotation"]

CELL_PX = 4
"""Width and height of a cell, pixels."""
FAR_M = 10.0
"""Depth at which a picture's depth is 255 (docs/reference/protocol.md)."""
_NOTHING = 255
"""Depth of a pixel that shows nothing, or something farther away."""


class DepthGrid:
    """Geometry of pictures of H x W pixels with 90 degrees from top to bottom.

    Args:
        height: H.
        width: W.
    """

    def __init__(self, height: int, width: int) -> None:
        self.height, self.width = height, width
        self.rows, self.columns = height // CELL_PX, width // CELL_PX
        focal = 0.5 * height
        y = (np.arange(height) + 0.5 - 0.5 * height) / focal
        x = (np.arange(width) + 0.5 - 0.5 * width) / focal
        left, up = np.meshgrid(-x, -y)
        self._left = torch.from_numpy(left).float()
        self._up = torch.from_numpy(up).float()

    @property
    def cells(self) -> int:
        """Rows times columns."""
        return self.rows * self.columns

    def places(self, depth: Tensor, head: Tensor, turned: Tensor) -> Tensor:
        """(N, 3, rows, columns) what is nearest in each cell, MuJoCo's world frame, m.

        Args:
            depth: (N, H, W) uint8, linear along the view's axis.
            head: (N, 3) where the headset is.
            turned: (N, 3, 3) its rotation: x forward, y left, z up.
        """
        rows, columns = self.rows, self.columns
        nearest = self._pixels(depth)
        # Of equally near pixels the one next to the middle.
        order = torch.tensor([5, 6, 9, 10, 1, 2, 4, 7, 8, 11, 13, 14, 0, 3, 12, 15])
        seen, which = nearest[..., order].min(-1)
        pixel = order[which]
        row = torch.arange(rows)[:, None] * CELL_PX + pixel // CELL_PX
        column = torch.arange(columns)[None, :] * CELL_PX + pixel % CELL_PX
        far = (seen.float() + 0.5) * (FAR_M / 255.0)
        ray = torch.stack([torch.ones_like(far), self._left[row, column], self._up[row, column]], 1)
        local = ray * far[:, None]
        placed: Tensor = torch.einsum("nij,njrc->nirc", turned, local) + head[:, :, None, None]
        return placed

    def something(self, depth: Tensor) -> Tensor:
        """(N, cells) whether anything is there, up to ``FAR_M`` away; depth as in :meth:`places`.

        There is nothing to be done with an empty sky.
        """
        there: Tensor = self._pixels(depth).amin(-1).flatten(1) < _NOTHING
        return there

    def _pixels(self, depth: Tensor) -> Tensor:
        """(N, rows, columns, pixels of a cell)."""
        rows, columns = self.rows, self.columns
        cut = depth[:, : rows * CELL_PX, : columns * CELL_PX]
        blocks = cut.reshape(-1, rows, CELL_PX, columns, CELL_PX).transpose(2, 3)
        return blocks.reshape(-1, rows, columns, CELL_PX * CELL_PX)


def rotation(quaternion: NDArray[np.float64]) -> Tensor:
    """(N, 3, 3) of unit quaternions (N, 4), w x y z."""
    w, x, y, z = np.asarray(quaternion).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.from_numpy(np.array(rows).transpose(2, 0, 1)).float()
