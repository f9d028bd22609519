"""What every move at every place in sight is worth."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from sim2vr_harness.training.skills.moves import MOVES
from sim2vr_harness.training.skills.sight import CELL_PX, Sight, middle_cells

__all__ = ["PlaceValues"]

_UNIT_M, _FAR_UNIT_M = 0.4, 2.0
"""What places are told in: within reach finely, farther away, where things come from, coarsely."""
_UNIT_MPS = 2.0
_WIDE = 8
"""Channels of the whole picture."""


class PlaceValues(nn.Module):
    """Values of moves by cell of the picture, and of resting; hands' values add up.

    Convolutions know what is where in the picture; each cell also knows where in the world it is,
    seen from the head and from the hands' tips, and how these move: who decides anew in the middle
    of a stroke knows that it is one. Cells in the middle may be seen in detail.

    Args:
        sight: geometry of the pictures.
        hands: H.
        width: channels.
        zoom: how many times finer than the rest the middle is seen; 1: no finer.
    """

    def __init__(self, sight: Sight, hands: int, *, width: int = 32, zoom: int = 1) -> None:
        super().__init__()
        self.sight, self.hands = sight, hands
        self.stem = nn.Sequential(
            nn.Conv2d(8, 16, 3, stride=2, padding=1),
            nn.SiLU(),
            nn.Conv2d(16, width, 3, stride=2, padding=1),
            nn.SiLU(),
        )
        geometry = 6 + 4 * hands
        self.enter = nn.Conv2d(width + geometry, width, 1)
        self.spread = nn.Conv2d(width, width, 3, padding=2, dilation=2)
        self.common = nn.Linear(width + 6 * hands, width)
        self.middle = None if zoom == 1 else _Middle(sight, width, zoom)
        self.leave = nn.Conv2d(width, hands * len(MOVES), 1)
        self.rest = nn.Linear(width, hands)
        for layer in (self.leave, self.rest):
            for parameter in layer.parameters():
                nn.init.zeros_(parameter)

    def forward(
        self, pictures: Tensor, places: Tensor, head: Tensor, tips: Tensor, velocities: Tensor
    ) -> Tensor:
        """(N, H, moves * cells + 1) values; the last one is that of resting.

        Args:
            pictures: (N, C, height, width) uint8: RGBD now and a moment ago; and of who sees the
                middle in detail RGB of that.
            places: (N, 3, rows, columns) of the cells, world, m.
            head: (N, 3).
            tips: (N, H, 3).
            velocities: (N, H, 3) m/s.
        """
        n, rows, columns = len(pictures), self.sight.rows, self.sight.columns
        seen = pictures.float() / 127.5 - 1.0
        x = self.stem(seen[:, :_WIDE])[:, :, :rows, :columns]
        from_head = places - head[:, :, None, None]
        maps = [from_head]
        for hand in range(self.hands):
            from_tip = places - tips[:, hand, :, None, None]
            maps += [from_tip, from_tip.norm(dim=1, keepdim=True)]
        fine, coarse = torch.cat(maps, 1) / _UNIT_M, from_head / _FAR_UNIT_M
        geometry = torch.cat([fine, coarse], 1).clamp(-3.0, 3.0)
        x = self.enter(torch.cat([x, geometry], 1))
        if self.middle is not None:
            x = self.middle.add(x, seen[:, _WIDE:])
        x = functional.silu(x)
        told = torch.cat([(tips - head[:, None]) / _UNIT_M, velocities / _UNIT_MPS], -1).flatten(1)
        common = self.common(torch.cat([x.mean((2, 3)), told], 1))
        x = functional.silu(self.spread(x) + x + common[:, :, None, None])
        moves = self.leave(x).reshape(n, self.hands, -1)
        rest = self.rest(functional.silu(common))[..., None]
        return torch.cat([moves, rest], -1)


class _Middle(nn.Module):
    """What the middle of the picture shows in detail, by cell.

    Args:
        sight: geometry of the pictures.
        width: channels.
        zoom: how many times finer than the rest the middle is seen.
    """

    def __init__(self, sight: Sight, width: int, zoom: int) -> None:
        super().__init__()
        self._pixels, self._cells = [], []
        for pixels in (sight.height, sight.width):
            first, count = middle_cells(pixels, zoom)
            begin = first * CELL_PX * zoom - (zoom - 1) * pixels // 2
            self._pixels.append(slice(begin, begin + count * CELL_PX * zoom))
            self._cells.append((first, count, pixels // CELL_PX))
        self.read = nn.Sequential(
            nn.Conv2d(3, 16, 3, stride=2, padding=1),
            nn.SiLU(),
            nn.Conv2d(16, width, 3, stride=2, padding=1),
            nn.SiLU(),
            nn.Conv2d(width, width, 3, padding=1),
            nn.SiLU(),
            nn.Conv2d(width, width, zoom, stride=zoom),
        )

    def add(self, x: Tensor, middle: Tensor) -> Tensor:
        """(N, C, rows, columns) cells, those in the middle with what is seen of them.

        Args:
            x: (N, C, rows, columns).
            middle: (N, 3, height, width), in [-1, 1].
        """
        rows, columns = self._pixels
        read = self.read(middle[:, :, rows, columns])
        around = []  # left, right, above, below
        for first, count, cells in reversed(self._cells):
            around += [first, cells - first - count]
        return x + functional.pad(read, around)
