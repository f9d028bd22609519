"""Columns of tensors."""

import torch

from sim2vr_harness.world_models.columns import Columns


def test_all_columns_in_their_order_are_the_tensor_itself() -> None:
    values = torch.arange(6.0).reshape(2, 3)
    assert Columns(range(3), 3)(values) is values
    torch.testing.assert_close(Columns([2, 0], 3)(values), torch.tensor([[2.0, 0.0], [5.0, 3.0]]))
    assert Columns([0, 1], 3)(values).shape == (2, 2)  # some are left out
    assert len(Columns([], 3)) == 0
