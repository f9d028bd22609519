"""Geometry of the image cells: the headset's depth image as positions in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
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
_SAME_COLOUR, _SAME_DEPTH_M, _FINE_DEPTH_M = 32, 3.5 * FAR_M / 255.0, 0.05
"""Differences up to which neighbouring pixels show the same object: of colours, of 255, and of
depths, m, in the headset's picture, where they have steps of 4 cm, and in the fovea."""
_BESIDE = np.array([np.zeros((3, 3)), np.ones((3, 3)), np.zeros((3, 3))])
"""Neighbours of a pixel in a stack of pictures."""
_POINTS, _FAR_OFF_M = 8, 0.999 * FAR_M
"""Points per side of a cell that the fovea is searched at, and the depth of nothing there."""
_SAME_HUE, _COLOURED, _SHADED = 0.25, 40, 0.45
"""Criteria for pixels of one shaded object: largest difference of hue (sixths of the circle), least
chroma (largest minus smallest channel, of 255), and least brightness relative to the brighter
pixel."""
_ONE_THING_M, _COMING_MPS, _BACKGROUND = 0.25, 0.5, 0.125
"""Radius within which a picture shows one thing, m; least speed of things that come towards a user,
m/s; share of a picture that is no thing."""
_CLEAR, _ENOUGH = 128, 0.25
"""Colour difference, and proportion of a cell, above which an object is not more salient."""


@dataclass
class Fovea:
    """Pictures around the gazes of N users.

    Attributes:
        pixel_m: width of a pixel at a depth of 1 m.
        pictures: (N, 3 or more, h, w) uint8 red, green, blue.
        depth: (N, h, w) m, 0 during a saccade.
        middle: (N, 2) where their middles meet a plane 1 m ahead, right and up, m.
    """

    pixel_m: float
    pictures: Tensor
    depth: Tensor
    middle: Tensor


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
        self,
        pictures: Tensor,
        cells: Tensor,
        head: Tensor,
        turned: Tensor,
        fovea: Fovea | None = None,
    ) -> tuple[Tensor, Tensor]:
        """(N, H, 3) middles of what stands out in cells, world, and (N, H) its width, m.

        Of a cell's pixels those count whose colour is the least like what surrounds them. Pixels of
        that colour and depth that hang together with them are the thing. Its width is the diameter
        of a disc with as many pixels. What the gaze is on is measured in the fovea.

        Args:
            pictures: (N, 4 or more, H, W) uint8: red, green, blue and depth, as in :meth:`places`.
            cells: (N, H) numbers of cells.
            head: (N, 3), and ``turned``: as in :meth:`places`.
            turned: (N, 3, 3).
            fovea: pictures around the gaze that were drawn with these.
        """
        row0 = (cells // self.columns * CELL_PX).flatten()
        column0 = (cells % self.columns * CELL_PX).flatten()
        windows, pixel_m = _windows(pictures[:, :4], cells.shape[1], row0, column0), 2 / self.height
        depth = _metres(windows[:, 3]).masked_fill(windows[:, 3] >= _NOTHING, torch.inf)
        own = _AROUND_PX + torch.stack([_MIDDLE_FIRST // CELL_PX, _MIDDLE_FIRST % CELL_PX])
        inner = (own[0] * windows.shape[-1] + own[1]).expand(len(windows), -1)
        # (K, 2) where the middles of cells meet a plane 1 m ahead, right and up.
        right, up = column0 - 0.5 * (self.width - CELL_PX), 0.5 * (self.height - CELL_PX) - row0
        middle = torch.stack([right, up], 1) * pixel_m
        given = windows[:, :3], depth, middle, pixel_m, inner, _SAME_DEPTH_M
        ahead, far, width, _ = _things(*given, torch.ones_like(inner, dtype=torch.bool))
        if fovea is not None:
            _measure(fovea, cells.shape[1], middle, CELL_PX * pixel_m, ahead, far, width)
        local = (ahead * far.clamp(max=FAR_M)[:, None]).reshape(*cells.shape, 3)
        placed = torch.einsum("nij,nhj->nhi", turned, local) + head[:, None]
        return placed, width.clamp(*WIDTHS_M).reshape(cells.shape)

    def coming(
        self,
        pictures: Tensor,
        places: Tensor,
        head: Tensor,
        turned: Tensor,
        before: Tensor,
        apart_s: float,
    ) -> Tensor:
        """Return (K, 3) velocities of things that come towards the user, world, m/s; 0 of others.

        A thing is compared with what had its colour in the picture before, nearest to it.
        What comes, comes from ahead, and is faster than it moves aside.

        Args:
            pictures: (K, 8, H, W) uint8: red, green, blue and depth, now and before.
            places: (K, 3) of the things, m; ``head`` and ``turned``: as in :meth:`places`.
            before: (K, 4, 4) poses of the head before.
            apart_s: time between the pictures, s.
        """
        local = torch.einsum("kji,kj->ki", turned, places - head)
        at = -0.5 * self.height * local[:, 1:] / local[:, :1].clamp(min=1e-3)
        column = (at[:, 0] + 0.5 * (self.width - 1)).round().long().clamp(0, self.width - 1)
        row = (at[:, 1] + 0.5 * (self.height - 1)).round().long().clamp(0, self.height - 1)
        count = len(places)
        own = pictures[torch.arange(count), :3, row, column].short()[..., None, None]
        middles, poses = [], ((head, turned), (before[:, :3, 3], before[:, :3, :3]))
        for first, (eye, axes) in zip((0, 4), poses, strict=True):
            off = (pictures[:, first : first + 3].short() - own).abs().amax(1)
            same = (off <= _SAME_COLOUR) & (pictures[:, first + 3] < _NOTHING)
            same &= same.sum((1, 2), keepdim=True) < _BACKGROUND * same[0].numel()
            which, row, column = torch.nonzero(same, as_tuple=True)
            left, up = self._left[row, column], self._up[row, column]
            ray = torch.stack([torch.ones_like(left), left, up], 1)
            far = _metres(pictures[which, first + 3, row, column].float())
            seen = far[:, None] * torch.einsum("kij,kj->ki", axes[which], ray)
            seen = seen + (eye - places)[which]
            away = seen.norm(dim=1)
            least = torch.full((count,), torch.inf).scatter_reduce(0, which, away, "amin")
            nearest = torch.zeros(count, 3)
            nearest[which[away == least[which]]] = seen[away == least[which]]
            near = ((seen - nearest[which]).norm(dim=1) < _ONE_THING_M).float()[:, None]
            pixels = torch.zeros(count, 1).index_add(0, which, near)
            total = torch.zeros(count, 3).index_add(0, which, seen * near)
            middles.append(total / pixels.clamp(min=1.0))
        velocity = (middles[0] - middles[1]) / apart_s
        ahead = functional.normalize(turned[:, :, 0] * torch.tensor([1.0, 1.0, 0.0]), dim=-1)
        comes_mps = -(velocity * ahead).sum(-1, keepdim=True)
        aside = velocity + comes_mps * ahead
        aside_mps = aside.norm(dim=-1, keepdim=True)
        # Less than a pixel aside is none.
        unclear = 2.0 / self.height * local[:, :1] / apart_s
        aside = torch.where(aside_mps > unclear, aside, torch.zeros(()))
        comes = (comes_mps > _COMING_MPS) & (comes_mps > aside_mps) & (pixels > 0.0)
        return (aside - comes_mps * ahead) * comes

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


def _salient(colour: Tensor, there: Tensor, inner: Tensor, valid: Tensor) -> Tensor:
    """Return (K,) numbers of the pixels that stand out, of those in ``inner``.

    Args:
        colour: (K, 3, h, w) of windows.
        there: (K, h, w) whether anything is there.
        inner: (K, P) numbers of pixels.
        valid: (K, P) False for those that are out of sight.
    """
    mean = (colour * there[:, None]).sum((2, 3)) / there.sum((1, 2)).clamp(min=1)[:, None]
    differs = (colour - mean[:, :, None, None]).abs().sum(1).masked_fill(~there, -1.0)
    own = colour.flatten(2).gather(2, inner[:, None].expand(-1, 3, -1))
    alike = (own[..., None] - own[:, :, None]).abs().amax(1) <= _SAME_COLOUR
    # A cursor on a thing is smaller. Of equal pixels the one next to the middle.
    enough = _ENOUGH * inner.shape[1]
    clear = differs.flatten(1).gather(1, inner).masked_fill(~valid, -1.0).clamp(max=_CLEAR)
    much = (clear * (alike & valid[:, None]).sum(2).clamp(max=enough)).round()
    best = (much - 0.01 * torch.arange(inner.shape[1])).argmax(1)
    return inner.gather(1, best[:, None])[:, 0]


def _measure(
    fovea: Fovea,
    hands: int,
    cells: Tensor,
    cell_m: float,
    ahead: Tensor,
    far: Tensor,
    width: Tensor,
) -> None:
    """Put what the fovea shows of cells in the place of rays, depths and widths (K, ...).

    Of a thing that the fovea does not show whole only the depth is taken.

    Args:
        cells: (K, 2) where their middles meet a plane 1 m ahead, m.
        cell_m: their width there.
    """
    user = torch.arange(len(fovea.depth)).repeat_interleave(hands)
    high, wide = fovea.depth.shape[1:]
    line = ((torch.arange(_POINTS) + 0.5) / _POINTS - 0.5) * cell_m
    points = torch.cartesian_prod(line, line)
    points = cells[:, None] + points[points.square().sum(1).argsort()]
    off = (points - fovea.middle[user, None]) / fovea.pixel_m
    row, column = (
        (0.5 * high - off[..., 1]).floor().long(),
        (0.5 * wide + off[..., 0]).floor().long(),
    )
    inside = (row >= 0) & (row < high) & (column >= 0) & (column < wide)
    depth = fovea.depth[user]
    shows = (inside.float().mean(1) >= 0.5) & (depth > 0.0).flatten(1).any(1)
    if not shows.any():
        return
    inner = row.clamp(0, high - 1) * wide + column.clamp(0, wide - 1)
    depth = depth[shows].masked_fill(depth[shows] >= _FAR_OFF_M, torch.inf)
    colour, middle = fovea.pictures[user[shows], :3].float(), fovea.middle[user[shows]]
    given = colour, depth, middle, fovea.pixel_m, inner[shows], _FINE_DEPTH_M, inside[shows]
    finer, deep, fine_m, whole = _things(*given)
    found = deep.isfinite()
    ahead[shows] = torch.where((found & whole)[:, None], finer, ahead[shows])
    width[shows] = torch.where(found & whole, fine_m, width[shows])
    far[shows] = torch.where(found, deep, far[shows])


def _things(
    colour: Tensor,
    depth: Tensor,
    middle: Tensor,
    pixel_m: float,
    inner: Tensor,
    same_m: float,
    valid: Tensor,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """What stands out in windows: (K, 3) rays, (K,) depths and widths, m, and if seen as a whole.

    Args:
        colour: (K, 3, h, w), 0 to 255.
        depth: (K, h, w) m, infinite where nothing is.
        middle: (K, 2) where the windows' middles meet a plane 1 m ahead, right and up, m.
        pixel_m: width of a pixel there.
        inner: (K, P) and ``valid``: as of :func:`_salient`.
        same_m: difference in depth up to which pixels show the same thing.
        valid: (K, P).
    """
    which, (height, width) = torch.arange(len(depth)), depth.shape[1:]
    number = _salient(colour, depth.isfinite(), inner, valid)
    start = (which, number // width, number % width)
    own = colour.permute(0, 2, 3, 1)[start][:, :, None, None]
    same = ((colour - own).abs().amax(1) <= _SAME_COLOUR) | _shaded_alike(colour, own)
    like = same & ((depth - depth[start][:, None, None]).abs() <= same_m)
    like[start] = True
    labels = torch.from_numpy(ndimage.label(like.numpy(), _BESIDE)[0])
    thing = labels == labels[start][:, None, None]
    count = thing.sum((1, 2)).float()
    row = (thing.sum(2) * torch.arange(height)).sum(1) / count
    column = (thing.sum(1) * torch.arange(width)).sum(1) / count
    # The middle of what is bent around something else is not its own; a cursor's pixel is.
    at = (which, row.round().long(), column.round().long())
    around = functional.avg_pool2d(thing[:, None].float(), 3, 1, 1)[:, 0][at]
    hollow = ~thing[at] & (around < 0.5)
    far = torch.where(thing, depth, torch.zeros(())).sum((1, 2)) / count
    row, column, far = (
        torch.where(hollow, one, other)
        for one, other in zip((start[1], start[2], depth[start]), (row, column, far), strict=True)
    )
    right = middle[:, 0] + (column + 0.5 - 0.5 * width) * pixel_m
    up = middle[:, 1] - (row + 0.5 - 0.5 * height) * pixel_m
    edge = thing[:, [0, -1]].flatten(1).any(1) | thing[:, :, [0, -1]].flatten(1).any(1)
    wide = 2.0 * (count / torch.pi).sqrt() * far * pixel_m
    return torch.stack([torch.ones_like(far), -right, up], 1), far, wide, ~edge


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
