"""Geometry of the image cells: the headset's depth image as positions in the world."""

from collections.abc import Sequence
from functools import reduce

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from sim2vr_harness.policies.hierarchical.motor_policy import WIDTHS_M

CELL_PX = 4
"""Width and height of a cell, pixels."""
FAR_M = 10.0
"""Depth at which a picture's depth is 255 (docs/reference/protocol.md)."""
_NOTHING = 255
"""Depth value of a pixel without a surface in range."""
_MIDDLE_FIRST = torch.tensor([5, 6, 9, 10, 1, 2, 4, 7, 8, 11, 13, 14, 0, 3, 12, 15])
"""Pixels of a cell, by their distance from its middle."""
_AROUND_PX = 4
"""Margin around a cell, in pixels, in which an object's outline is still traced."""
_SAME_COLOUR, _SAME_DEPTH = 32, 3
"""Differences, of 255, up to which neighbouring pixels show the same object."""
_SAME_HUE, _COLOURED, _SHADED = 0.25, 40, 0.45
"""Criteria for pixels of one shaded object: largest difference of hue (sixths of the circle), least
chroma (largest minus smallest channel, of 255), and least brightness relative to the brighter
pixel."""
_CLEAR, _ENOUGH_PX = 128, 4
"""Colour difference, and number of pixels in a cell, above which an object is not more salient."""


class DepthGrid:
    """Geometry of pictures of H x W pixels with 90 degrees from top to bottom."""

    def __init__(self, height: int, width: int) -> None:
        self.height, self.width = height, width
        self.rows, self.columns = height // CELL_PX, width // CELL_PX
        focal = 0.5 * height
        y = (np.arange(height) + 0.5 - 0.5 * height) / focal
        x = (np.arange(width) + 0.5 - 0.5 * width) / focal
        left, up = np.meshgrid(-x, -y)
        self._left = torch.from_numpy(left).float()
        self._up = torch.from_numpy(up).float()
        number = torch.empty(CELL_PX * CELL_PX, dtype=torch.int16)
        number[_MIDDLE_FIRST] = torch.arange(CELL_PX * CELL_PX, dtype=torch.int16)
        self._number = number.reshape(CELL_PX, CELL_PX).repeat(self.rows, self.columns)
        """(rows, columns times ``CELL_PX``) numbers of pixels in their cells."""
        self._row0 = torch.arange(self.rows)[:, None] * CELL_PX
        self._column0 = torch.arange(self.columns)[None, :] * CELL_PX

    @property
    def cells(self) -> int:
        """Rows times columns."""
        return self.rows * self.columns

    def places(self, depth: Tensor, head: Tensor, turned: Tensor) -> Tensor:
        """Return (N, 3, rows, columns) nearest points per cell in MuJoCo's world frame, m.

        Args:
            depth: (N, H, W) uint8, linear along the view's axis.
            head: (N, 3) position of the headset.
            turned: (N, 3, 3) its rotation: x forward, y left, z up.
        """
        nearest = self._nearest(depth)
        pixel = _MIDDLE_FIRST[(nearest & 15).long()]
        row, column = self._row0 + pixel // CELL_PX, self._column0 + pixel % CELL_PX
        far = _metres((nearest >> 4).float())
        ray = torch.stack([torch.ones_like(far), self._left[row, column], self._up[row, column]], 1)
        local = ray * far[:, None]
        placed: Tensor = torch.einsum("nij,njrc->nirc", turned, local) + head[:, :, None, None]
        return placed

    def things(
        self, pictures: Tensor, cells: Tensor, head: Tensor, turned: Tensor
    ) -> tuple[Tensor, Tensor]:
        """(N, H, 3) middles of what stands out in cells, world, and (N, H) its width, m.

        Of a cell's pixels those count whose colour is the least like what surrounds them. Pixels of
        that colour and depth that hang together with them are the thing. Its width is the diameter
        of a disc with as many pixels.

        Args:
            pictures: (N, 4 or more, H, W) uint8: red, green, blue and depth, as in :meth:`places`.
            cells: (N, H) numbers of cells.
            head: (N, 3), and ``turned``: as in :meth:`places`.
            turned: (N, 3, 3).
        """
        row0 = (cells // self.columns * CELL_PX).flatten()
        column0 = (cells % self.columns * CELL_PX).flatten()
        windows = _windows(pictures[:, :4], cells.shape[1], row0, column0)
        row, column, depth, pixels = _things(windows)
        up = 0.5 * self.height - (row0 - _AROUND_PX + row + 0.5)
        left = 0.5 * self.width - (column0 - _AROUND_PX + column + 0.5)
        focal = 0.5 * self.height
        ray = torch.stack([torch.ones_like(up), left / focal, up / focal], 1)
        local = (ray * _metres(depth)[:, None]).reshape(*cells.shape, 3)
        width = (2.0 * (pixels / torch.pi).sqrt() * _metres(depth) / focal).clamp(*WIDTHS_M)
        placed = torch.einsum("nij,nhj->nhi", turned, local) + head[:, None]
        return placed, width.reshape(cells.shape)

    def something(self, depth: Tensor) -> Tensor:
        """Return (N, cells) True for cells with a surface within ``FAR_M``.

        Cells without a surface, such as sky, are excluded from action selection. ``depth`` is as in
        :meth:`places`.
        """
        there: Tensor = (self._nearest(depth) >> 4).flatten(1) < _NOTHING
        return there

    def _nearest(self, depth: Tensor) -> Tensor:
        """(N, rows, columns) of cells: 16 times the least depth, and which pixel has it.

        Pixels are numbered as in ``_MIDDLE_FIRST``: of equally near ones the one next to the
        middle. Minima of whole rows and columns are ten times as fast as those of blocks.
        """
        cut = depth[:, : self.rows * CELL_PX, : self.columns * CELL_PX].to(torch.int16)
        ranked = cut * 16 + self._number
        lines = _least([ranked[:, k::CELL_PX] for k in range(CELL_PX)])
        return _least([lines[..., k::CELL_PX] for k in range(CELL_PX)])


def _least(parts: Sequence[Tensor]) -> Tensor:
    """Return the least values of tensors of one shape."""
    return reduce(torch.minimum, parts)


def _metres(depth: Tensor) -> Tensor:
    """Distances along the view's axis, m, of depths of a picture, which apps round."""
    return depth * (FAR_M / 255.0)


def _windows(pictures: Tensor, hands: int, row0: Tensor, column0: Tensor) -> Tensor:
    """(K, 4, W, W) pixels of cells and around them; nothing is beyond the edges of pictures."""
    n, channels, height, width = pictures.shape
    inside = torch.arange(-_AROUND_PX, CELL_PX + _AROUND_PX)
    which = torch.arange(n).repeat_interleave(hands)[:, None, None]
    rows, columns = (row0[:, None] + inside)[:, :, None], (column0[:, None] + inside)[:, None]
    within = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    own = pictures[which, :, rows.clamp(0, height - 1), columns.clamp(0, width - 1)].float()
    nothing = torch.zeros(channels)
    nothing[3] = _NOTHING
    return torch.where(within[..., None], own, nothing).permute(0, 3, 1, 2)


def _salient(colour: Tensor, there: Tensor) -> tuple[Tensor, Tensor]:
    """(K,) row and column of the pixel of a window's cell that stands out.

    Args:
        colour: (K, 3, W, W) of windows.
        there: (K, W, W) whether anything is there.
    """
    mean = (colour * there[:, None]).sum((2, 3)) / there.sum((1, 2)).clamp(min=1)[:, None]
    differs = (colour - mean[:, :, None, None]).abs().sum(1).masked_fill(~there, -1.0)
    own, order = slice(_AROUND_PX, _AROUND_PX + CELL_PX), _MIDDLE_FIRST
    inner = colour[:, :, own, own].flatten(2)[..., order]
    alike = (inner[..., None] - inner[:, :, None]).abs().amax(1) <= _SAME_COLOUR
    # A cursor on a thing is smaller. Of equal pixels the one next to the middle.
    clear = differs[:, own, own].flatten(1)[:, order].clamp(max=_CLEAR)
    much = (clear * alike.sum(2).clamp(max=_ENOUGH_PX)).round()
    pixel = order[(much - 0.01 * torch.arange(len(order))).argmax(1)]
    return _AROUND_PX + pixel // CELL_PX, _AROUND_PX + pixel % CELL_PX


def _things(windows: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """(K,) of what stands out in the cells of windows: middle (row, column, depth) and pixels."""
    colour, depth, which = windows[:, :3], windows[:, 3], torch.arange(len(windows))
    start = (which, *_salient(colour, depth < _NOTHING))
    own = colour.permute(0, 2, 3, 1)[start][:, :, None, None]
    same = ((colour - own).abs().amax(1) <= _SAME_COLOUR) | _shaded_alike(colour, own)
    like = same & ((depth - depth[start][:, None, None]).abs() <= _SAME_DEPTH)
    thing = torch.zeros_like(depth)
    thing[start] = 1.0
    for _ in range(CELL_PX + _AROUND_PX):
        thing = functional.max_pool2d(thing[:, None], 3, 1, 1)[:, 0] * like
    number, count = torch.arange(thing.shape[-1]).float(), thing.sum((1, 2))
    row, column = (thing.sum(2) * number).sum(1) / count, (thing.sum(1) * number).sum(1) / count
    # The middle of what is bent around something else is not its own; a cursor's pixel is.
    at = (which, row.round().long(), column.round().long())
    around = functional.avg_pool2d(thing[:, None], 3, 1, 1)[:, 0][at]
    hollow = (thing[at] == 0.0) & (around < 0.5)
    far = torch.where(hollow, depth[start], (depth * thing).sum((1, 2)) / count)
    return torch.where(hollow, start[1], row), torch.where(hollow, start[2], column), far, count


def _shaded_alike(colour: Tensor, own: Tensor) -> Tensor:
    """Return (K, W, W) True where colours (K, 3, W, W) have the same hue as others (K, 3, 1, 1)."""
    hues, chromas, values = zip(*(_hue(each) for each in (colour, own)), strict=True)
    apart = (hues[0] - hues[1]).abs()
    apart = torch.minimum(apart, 6.0 - apart)
    darker, brighter = torch.minimum(*values), torch.maximum(*values)
    coloured = torch.minimum(*chromas) >= _COLOURED
    return coloured & (apart <= _SAME_HUE) & (darker >= _SHADED * brighter)


def _hue(colour: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """(K, W, W) each: hue in sixths of the circle, chroma and value of colours (K, 3, W, W)."""
    red, green, blue = colour.unbind(1)
    value = colour.amax(1)
    chroma = value - colour.amin(1)
    of = chroma.clamp(min=1.0)
    hue = torch.where(value == red, (green - blue) / of % 6.0, (blue - red) / of + 2.0)
    hue = torch.where(
        (value == blue) & (value > red) & (value > green), (red - green) / of + 4.0, hue
    )
    return hue, chroma, value


def rotation(quaternion: NDArray[np.float64]) -> Tensor:
    """(N, 3, 3) of unit quaternions (N, 4), w x y z."""
    w, x, y, z = np.asarray(quaternion).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.from_numpy(np.array(rows).transpose(2, 0, 1)).float()
