"""Action values of every motor option at every cell of the image."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid
from sim2vr_harness.policies.hierarchical.options import PLAIN, OptionSet

_UNIT_M, _FAR_UNIT_M = 0.4, 2.0
"""Units of positions: fine within reach, coarse farther away, where things come from."""
_UNIT_MPS = 2.0
_CHANNELS = 32
"""Channels of the convolutions, few because policies run on a CPU several times per second."""


class ActionValueMap(nn.Module):
    """Values of moves by cell of the picture, and of resting; hands' values add up.

    Convolutions read the picture. Each cell also receives its position in the world, relative to
    the head and to the hands' tips, and their velocities: a choice in the middle of a stroke
    depends on that stroke.
    """

    def __init__(self, sight: DepthGrid, hands: int, options: OptionSet = PLAIN) -> None:
        super().__init__()
        self.sight, self.hands, self.options = sight, hands, options
        width = _CHANNELS
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
        self.leave = nn.Conv2d(width, hands * len(options.placed), 1)
        self.rest = nn.Linear(width, hands * (1 + len(options.free)))
        for layer in (self.leave, self.rest):
            for parameter in layer.parameters():
                nn.init.zeros_(parameter)

    def forward(
        self, pictures: Tensor, places: Tensor, head: Tensor, tips: Tensor, velocities: Tensor
    ) -> Tensor:
        """(N, H, choices) values: of moves by cell, of resting, and of options without a place.

        Args:
            pictures: (N, 8, height, width) uint8: RGBD now and a moment ago.
            places: (N, 3, rows, columns) of the cells, world, m.
            head: (N, 3).
            tips: (N, H, 3).
            velocities: (N, H, 3) m/s.
        """
        return self.values(*self.inputs(pictures, places, head, tips, velocities))

    def inputs(
        self, pictures: Tensor, places: Tensor, head: Tensor, tips: Tensor, velocities: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return what the layers of any network of this geometry take; see :meth:`forward`.

        Pictures are channels last, which halves the processor time of the gradients of the
        convolutions.
        """
        from_head = places - head[:, :, None, None]
        maps = [from_head]
        for hand in range(self.hands):
            from_tip = places - tips[:, hand, :, None, None]
            # torch's norm of three numbers takes fifty times as long.
            maps += [from_tip, from_tip.square().sum(1, keepdim=True).sqrt()]
        fine, coarse = torch.cat(maps, 1) / _UNIT_M, from_head / _FAR_UNIT_M
        geometry = torch.cat([fine, coarse], 1).clamp_(-3.0, 3.0)
        hands = [(tips - head[:, None]) / _UNIT_M, velocities / _UNIT_MPS]
        pictures, geometry = (
            each.contiguous(memory_format=torch.channels_last) for each in (pictures, geometry)
        )
        seen = pictures.float().div_(127.5).sub_(1.0)
        return seen, geometry, torch.cat(hands, -1).flatten(1)

    def values(self, pictures: Tensor, geometry: Tensor, hands: Tensor) -> Tensor:
        """Return what :meth:`forward` does, for :meth:`inputs`."""
        rows, columns = self.sight.rows, self.sight.columns
        x = self.stem(pictures)[:, :, :rows, :columns]
        x = functional.silu(self.enter(torch.cat([x, geometry], 1)))
        common = self.common(torch.cat([x.mean((2, 3)), hands], 1))
        x = functional.silu(self.spread(x) + x + common[:, :, None, None])
        moves = self.leave(x).reshape(len(x), self.hands, -1)
        rest = self.rest(functional.silu(common)).reshape(len(x), self.hands, -1)
        return torch.cat([moves, rest], -1)
