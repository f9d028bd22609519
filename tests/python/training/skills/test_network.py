"""Values of places and moves."""

from __future__ import annotations

import pytest
import torch

from sim2vr_harness.training.skills.network import PlaceValues
from sim2vr_harness.training.skills.sight import Sight, middle_cells


@pytest.mark.parametrize(
    ("zoom", "rows", "columns"),
    # Drawn 360 x 240 the middle has pixels 120 to 240 and 80 to 160, and cells have 12 pixels;
    # drawn 600 x 400 it has 240 to 360 and 160 to 240, and cells have 20.
    [(3, (7, 6), (10, 10)), (5, (8, 4), (12, 6))],
)
def test_what_is_seen_in_detail_is_told_of_the_cell_that_it_is_in(
    zoom: int, rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    assert middle_cells(80, zoom) == rows
    assert middle_cells(120, zoom) == columns
    torch.manual_seed(1)
    middle = PlaceValues(Sight(80, 120), 1, zoom=zoom).middle
    assert middle is not None
    seen = torch.full((1, 3, 80, 120), -1.0)
    changed = seen.clone()
    # The middle of the cell in row 9 and column 13, in the picture as it is drawn.
    top, left = (zoom - 1) * 40, (zoom - 1) * 60
    changed[0, :, round(9.5 * 4 * zoom) - top, round(13.5 * 4 * zoom) - left] = 1.0
    cells = torch.zeros(1, 32, 20, 30)
    with torch.inference_mode():
        apart = (middle.add(cells, changed) - middle.add(cells, seen)).abs().amax((0, 1))
    assert apart.argmax() == 9 * 30 + 13
    assert (apart > 0).nonzero().float().sub(torch.tensor([9, 13])).abs().max() <= 1
    with torch.no_grad():
        outside = middle.add(cells, seen)[0]
    outside[:, slice(rows[0], sum(rows)), slice(columns[0], sum(columns))] = 0.0
    assert not outside.any()


def test_it_learns_what_only_the_detail_tells() -> None:
    """Something is worth 1 in one of two cells where a line stands up there, 0 where it lies."""
    torch.manual_seed(2)
    sight = Sight(80, 120)
    net = PlaceValues(sight, 1, width=8, zoom=3)
    optimizer = torch.optim.Adam(net.parameters(), lr=0.01)
    pictures = torch.full((16, 11, 80, 120), 128, dtype=torch.uint8)
    stands = torch.arange(16) % 2 == 0
    for i in range(16):
        # Column 12 of cells begins 24 pixels from the left of the middle, row 8 16 from above.
        at = (slice(16, 28), 30) if stands[i] else (22, slice(24, 36))
        pictures[i, 8:, at[0], at[1]] = 255
    places, head = torch.zeros(16, 3, 20, 30), torch.zeros(16, 3)
    tips = torch.zeros(16, 1, 3)
    for _ in range(60):
        values = net(pictures, places, head, tips, tips)[:, 0, 8 * 30 + 12]
        loss = (values - stands.float()).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss < 0.02
