"""The mean of weights over the last updates, against values worked out by hand."""

import torch

from sim2vr_harness.world_models.weight_average import WeightAverage


def updated(average: WeightAverage, weight: torch.Tensor, values: list[float]) -> None:
    for value in values:
        weight.fill_(value)
        average.add()


def test_the_first_weights_count_alike_and_later_ones_more() -> None:
    """(2 + 4) / 2 = 3, then by a half: (3 + 8) / 2 = 5.5, (5.5 + 0) / 2 = 2.75."""
    weight = torch.tensor([9.0])
    average = WeightAverage([weight], 2)
    updated(average, weight, [2.0, 4.0, 8.0, 0.0])
    with average.in_place():
        assert weight.item() == 2.75
    assert weight.item() == 0.0  # what learns goes on from where it was
    average.settle()
    assert weight.item() == 2.75


def test_without_updates_weights_are_as_they_are() -> None:
    weight = torch.tensor([9.0])
    average = WeightAverage([weight], 0)
    updated(average, weight, [2.0, 4.0])
    with average.in_place():
        assert weight.item() == 4.0
    average.settle()
    assert weight.item() == 4.0
