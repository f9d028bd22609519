"""Target areas of the conditions, as tensors."""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.whacamole.rules import (
    CELLS,
    COLUMNS,
    VOLUME_BEHIND_M,
    area_of,
)


def areas_of(
    conditions: Sequence[Mapping[str, float]], options: Sequence[Mapping[str, OptionValue]]
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the target areas of C conditions, from the head, in the app's axes, m.

    Args:
        conditions: the privileged numbers named ``round.*``.
        options: those that are set: they move the area.

    Returns:
        (C, 3) middles; (C, 3, 3) axes right, up and behind, as rows; (C, 3) directions whose speed
        hits are judged by; (C, cells, 3) middles of the targets' volumes.
    """
    placements = ("round.low", "round.mid", "round.high")
    place = torch.tensor([[c[name] for name in placements] for c in conditions]).argmax(1)
    where = [area_of(int(row), changes) for row, changes in zip(place, options, strict=True)]
    area, ups, behind, strike = (
        torch.tensor([getattr(one, name) for one in where])
        for name in ("middle_m", "up", "behind", "strike")
    )
    right = torch.tensor([1.0, 0.0, 0.0]).expand_as(ups)
    cell = torch.arange(CELLS)
    across, up = cell % COLUMNS - 1.0, 1.0 - cell // COLUMNS
    cell_m = torch.tensor([one.cell_m for one in where])[:, None, None]
    cells = (
        area[:, None]
        + (across[None, :, None] * cell_m) * right[:, None]
        + (up[None, :, None] * cell_m) * ups[:, None]
        + VOLUME_BEHIND_M * behind[:, None]
    )
    return area, torch.stack([right, ups, behind], 1), strike, cells
