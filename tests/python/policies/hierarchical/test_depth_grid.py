"""Places of what is seen, by hand."""

import numpy as np
import pytest
import torch

from sim2vr_harness.policies.hierarchical.action_selection import best_choices
from sim2vr_harness.policies.hierarchical.depth_grid import (
    CELL_PX,
    FAR_M,
    DepthGrid,
    Fovea,
    rotation,
)
from sim2vr_harness.policies.hierarchical.primitives import MOVES


def test_the_middle_of_the_picture_is_straight_ahead() -> None:
    sight = DepthGrid(80, 120)
    assert (sight.rows, sight.columns, sight.cells) == (20, 30, 600)
    depth = torch.full((1, 80, 120), 255, dtype=torch.uint8)
    depth[0, 40, 60] = 25  # just right of and below the axis
    place = sight.places(depth, torch.tensor([[1.0, 2.0, 3.0]]), torch.eye(3)[None])
    far = 25 * FAR_M / 255.0
    got = place[0, :, 40 // CELL_PX, 60 // CELL_PX].tolist()
    # 90 degrees from top to bottom: half a pixel beside the axis is 0.5 / 40 of the distance.
    assert got == pytest.approx([1.0 + far, 2.0 - far * 0.5 / 40.0, 3.0 - far * 0.5 / 40.0])


def test_the_upper_left_corner_is_up_and_left_of_a_turned_head() -> None:
    sight = DepthGrid(80, 120)
    depth = torch.full((1, 80, 120), 50, dtype=torch.uint8)
    half = np.sqrt(0.5)
    turned = rotation(np.array([[half, 0.0, 0.0, half]]))  # a quarter turn to the left
    place = sight.places(depth, torch.zeros(1, 3), turned)[0, :, 0, 0]
    far = 50 * FAR_M / 255.0
    # Of equal depths the pixel next to the cell's middle: row 1, column 1.
    up, left = (40 - 1.5) / 40.0 * far, (60 - 1.5) / 40.0 * far
    assert place.tolist() == pytest.approx([-left, far, up], abs=1e-5)


def test_only_what_is_there_is_chosen() -> None:
    """Two cells of a picture of 4 x 8 pixels; the last choice is to rest."""
    sight = DepthGrid(4, 8)
    depth = torch.full((3, 4, 8), 255, dtype=torch.uint8)
    depth[0, 3, 7] = 254  # one pixel, 9.98 m away
    depth[1] = 100
    something = sight.something(depth)
    assert something.tolist() == [[False, True], [True, True], [False, False]]
    values = torch.zeros(3, 1, len(MOVES) * sight.cells + 1)
    values[:, 0, 2 * 3] = 2.0  # move 3 in the left cell
    values[:, 0, 2 * 5 + 1] = 1.0  # move 5 in the right cell
    chosen = best_choices(values, something)[:, 0].tolist()
    assert chosen == [2 * 5 + 1, 2 * 3, 2 * len(MOVES)]


def button(rows: range, columns: range, depth: int = 38) -> torch.Tensor:
    """A picture of a red thing on a dark, tilted plate that fills it."""
    picture = torch.zeros(1, 8, 80, 120, dtype=torch.uint8)
    picture[0, 2] = 20
    picture[0, 3] = depth + torch.arange(80)[:, None] // 40
    for row in rows:
        picture[0, 0, row, columns.start : columns.stop] = 250
    return picture


def aimed_at(picture: torch.Tensor, row: int, column: int) -> list[float]:
    """Row and column in the picture of what is aimed at in the cell of a pixel."""
    sight = DepthGrid(80, 120)
    cell = torch.tensor([[row // CELL_PX * sight.columns + column // CELL_PX]])
    places, _ = sight.things(picture, cell, torch.zeros(1, 3), torch.eye(3)[None])
    x, y, z = places[0, 0].tolist()
    return [40.0 - z / x * 40.0, 60.0 - y / x * 40.0]


def test_rays_are_turned_to_the_middle_of_what_stands_out_in_a_cell() -> None:
    """A thing of 3 x 3 pixels reaches into four cells; each of them leads to its middle."""
    picture = button(range(38, 41), range(59, 62))
    for row, column in ((39, 59), (39, 60), (40, 59), (40, 60)):
        assert aimed_at(picture, row, column) == pytest.approx([39.5, 60.5], abs=1e-4)
    # The plate's own cell is aimed at where its middle is.
    assert aimed_at(picture, 10, 100) == pytest.approx([9.5, 101.5], abs=0.51)


def test_a_cursor_on_a_thing_is_not_taken_for_it() -> None:
    picture = button(range(36, 40), range(60, 64))
    picture[0, :3, 37, 61] = 255
    assert aimed_at(picture, 37, 61) == pytest.approx([38.0, 62.0], abs=0.1)


@pytest.mark.parametrize(
    ("rows", "columns", "depth", "expected_m"),
    [
        (2, 2, 10, 2.257 * 0.00980),  # 4 pixels of 9.8 mm: a disc of 2.257 pixels
        (3, 3, 20, 3.385 * 0.01961),
        (1, 1, 5, 0.01),  # 5.5 mm
        (9, 9, 40, 0.12),
    ],
)
def test_a_thing_is_as_wide_as_a_disc_with_its_pixels(
    rows: int, columns: int, depth: int, expected_m: float
) -> None:
    picture = button(range(37, 37 + rows), range(61, 61 + columns), depth)
    cell = torch.tensor([[37 // CELL_PX * 30 + 61 // CELL_PX]])
    width = DepthGrid(80, 120).things(picture, cell, torch.zeros(1, 3), torch.eye(3)[None])[1]
    assert float(width) == pytest.approx(expected_m, rel=0.06)  # the plate is tilted


@pytest.mark.parametrize("seen", ["whole", "partly", "saccade"])
def test_the_fovea_measures_what_the_gaze_is_on(seen: str) -> None:
    """A red disc of 2 cm, 0.7 m ahead and 3 mm to the right: two pixels of the picture."""
    pixel_m, far, middle = 2.0 / 80 / 6, 0.7, torch.tensor([[0.01, 0.0]])
    picture = button(range(39, 41), range(59, 61), 18)
    row, column = torch.meshgrid(torch.arange(72), torch.arange(72), indexing="ij")
    right = 0.01 + (column + 0.5 - 36) * pixel_m
    up = (36 - row - 0.5) * pixel_m
    disc = (far * right - 0.003) ** 2 + (far * up) ** 2 < 0.01**2
    if seen == "partly":
        disc = (far * right + 0.04).abs() < 0.04  # beyond the left edge
    pictures = torch.where(disc, torch.tensor([250, 0, 20])[:, None, None], 20)[None]
    depth = torch.full((1, 72, 72), 0.0 if seen == "saccade" else far)
    fovea = Fovea(pixel_m, pictures.to(torch.uint8), depth, middle)
    cell = torch.tensor([[39 // CELL_PX * 30 + 60 // CELL_PX]])
    given = picture, cell, torch.zeros(1, 3), torch.eye(3)[None]
    (plain,), (plain_m,) = DepthGrid(80, 120).things(*given)
    (place,), (width,) = DepthGrid(80, 120).things(*given, fovea)
    if seen == "saccade":
        assert (place == plain).all() and (width == plain_m).all()
    elif seen == "partly":
        assert place[0].tolist() == pytest.approx((plain[0] * far / plain[0, 0]).tolist())
        assert (width == plain_m).all()
    else:
        assert place[0].tolist() == pytest.approx([far, -0.003, 0.0], abs=0.001)
        assert float(width) == pytest.approx(0.02, abs=0.001)


@pytest.mark.parametrize("turned_deg", [0.0, 6.0])
@pytest.mark.parametrize(
    ("before_m", "expected_mps"),
    [(5.0, -5.0), (4.0, 0.0), (3.0, 0.0)],
)
def test_what_comes_is_told_from_what_stands_or_goes(
    before_m: float, expected_mps: float, turned_deg: float
) -> None:
    """A square of 0.4 m, now 4 m ahead and 0.2 m to the left, whatever the head did meanwhile."""
    half = np.radians(turned_deg) / 2.0
    heads = [np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[np.cos(half), 0.0, 0.0, np.sin(half)]])]
    picture = torch.zeros(1, 8, 80, 120, dtype=torch.uint8)
    picture[0, 3], picture[0, 7] = 255, 255
    row, column = torch.meshgrid(torch.arange(80), torch.arange(120), indexing="ij")
    ray = torch.stack([torch.ones(80, 120), -(column - 59.5) / 40.0, -(row - 39.5) / 40.0])
    for first, far, head in zip((0, 4), (4.0, before_m), heads, strict=True):
        axes = rotation(head)[0]
        world = torch.einsum("ij,jrc->irc", axes, ray)
        depth = far / world[0]
        square = ((world[1] * depth - 0.2).abs() < 0.2) & ((world[2] * depth).abs() < 0.2)
        picture[0, first][square] = 250
        picture[0, first + 3][square] = (depth[square] * 255.0 / FAR_M).round().to(torch.uint8)
    poses = torch.eye(4)[None].clone()
    poses[:, :3, :3] = rotation(heads[1])
    given = torch.tensor([[4.0, 0.2, 0.0]]), torch.zeros(1, 3), rotation(heads[0]), poses
    found = DepthGrid(80, 120).coming(picture, *given, 0.2)[0]
    assert float(found[0]) == pytest.approx(expected_mps, abs=0.2)
    assert found[1:].abs().max() < 0.5
