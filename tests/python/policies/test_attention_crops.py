"""Attention crops: their pixels, and that a student learns to place them."""

import numpy as np
import pytest
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.policies.attention_crops import AttentionCrops, _cut_out
from sim2vr_harness.runs.attention_config import AttentionCropConfig
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.training.dagger.dagger import seen_at

SHAPES = {"vision": (2, 80, 120), "fovea": (2, 80, 120)}
"""Cells of 8 pixels: 10 rows of 15; the half height is 40 pixels, the place 1."""


def unlearned() -> AttentionCrops:
    """One whose locator says the same of all cells."""
    made = AttentionCrops(SHAPES, AttentionCropConfig(count=1))
    with torch.no_grad():
        for weights in made.grid.parameters():
            weights.zero_()
    return made


def test_a_cut_out_is_around_its_place_and_dark_grey_outside() -> None:
    picture = torch.zeros(1, 1, 80, 120, dtype=torch.uint8)
    picture[0, 0, 20, 90] = 255  # between 30 and 31 px right of the middle, 19 and 20 above it
    cut = _cut_out(picture, torch.tensor([[[30.0, 20.0], [62.0, 0.0]]]), 4, torch.float32)
    assert cut.shape == (2, 1, 4, 4)
    first = torch.full((4, 4), -127.5)
    first[2, 2] = 127.5  # columns 88 to 91, rows 18 to 21
    torch.testing.assert_close(cut[0, 0], first)
    # Columns 120 to 123: all of them are beyond the right edge.
    torch.testing.assert_close(cut[1, 0], torch.zeros(4, 4))


def test_the_locator_says_the_middles_of_its_cells_before_it_has_learned() -> None:
    made = unlearned()
    told = made.where(torch.zeros(1, 2, 80, 120, dtype=torch.uint8))
    assert told.shape == (1, 1, 3, 150)
    # The first cell's middle: 4 px from the left edge and the top, of 60 and 40; / 40.
    np.testing.assert_allclose(told[0, 0, 1:, 0].detach(), [-56 / 40, 36 / 40], atol=1e-6)
    # Row 5, column 7: the middle one across, the first below the middle.
    np.testing.assert_allclose(told[0, 0, 1:, 82].detach(), [0.0, -4 / 40], atol=1e-6)


def test_the_loss_is_that_of_the_cell_where_the_thing_is() -> None:
    made = unlearned()
    told = made.where(torch.zeros(3, 2, 80, 120, dtype=torch.uint8))
    places = torch.tensor([[[2.0 / 40, -6.0 / 40]], [[1.6, 0.0]], [[0.0, 0.0]]])
    there = torch.tensor([[1.0], [1.0], [0.0]])  # the second one is beyond the edge at 1.5
    # 150 cells alike, and 2 px each way from the middle of row 5, column 7, in cells.
    expected = np.log(150.0) + 4.0 / 8.0
    assert float(made.loss(told, places, there)) == pytest.approx(expected, rel=1e-5)
    assert float(made.loss(told, places, 0.0 * there)) == 0.0


def test_places_are_seen_as_the_head_is_turned() -> None:
    ahead = np.array([0.0, 0.0, 0.0, 1.0])
    right = np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])  # a quarter turn about y: z -> x
    thing = np.array([[[1.0, 1.0, -0.5, 4.0]], [[1.0, 4.0, 2.0, 1.0]], [[0.0, 1.0, 1.0, 4.0]]])
    seen = seen_at(thing, np.stack([ahead, right, ahead]))
    # Ahead: 1/4 right and 1/8 down. Turned right: 4 ahead, 2 up, and 1 to the left.
    np.testing.assert_allclose(seen[0, 0], [0.25, -0.125, 1.0], atol=1e-6)
    np.testing.assert_allclose(seen[1, 0], [-0.25, 0.5, 1.0], atol=1e-6)
    np.testing.assert_allclose(seen[2, 0], [0.0, 0.0, 0.0], atol=1e-6)
    assert seen_at(thing[:1], right[None])[0, 0, 2] == 1.0  # x = 1 is ahead of who looks right
    assert seen_at(thing[1:2] * [1, -1, 1, 1], right[None])[0, 0, 2] == 0.0  # behind


@pytest.mark.parametrize(
    ("changes", "field", "got"),
    [
        (["recipe=skills"], "policy.attention_crops", "some with recipe 'skills'"),
        (["env.vision.fovea.magnification=5"], "env.vision.fovea.magnification", "5"),
        (["policy.attention_crops.count=0"], "policy.attention_crops.count", "0"),
    ],
)
def test_what_cannot_be_looked_at_is_refused(changes: list[str], field: str, got: str) -> None:
    with pytest.raises(InputError) as error:
        load_config("beats_level", changes)
    assert str(error.value).startswith(f"{field}: got {got}")
