"""Bounds on values and on gradients through many user steps, of every user alone.

A body model that a network stands for is steep in a few states, and a gradient that goes through
sixteen of its steps now and then a hundred thousand times too long: one user then decides where
every user's policy goes. Of the others nothing is changed.
"""

from typing import Any

import torch
from torch import Tensor


def limited(values: Tensor, most: float) -> Tensor:
    """Return ``values`` (B, N), through which no row's gradient goes longer than ``most``.

    Longer ones are shortened, those that are not finite are 0.
    """
    if values.requires_grad:
        values.register_hook(lambda gradient: _shortened(gradient, most))  # type: ignore[no-untyped-call]
    return values


def _shortened(gradient: Tensor, most: float) -> Tensor:
    length = gradient.norm(dim=1, keepdim=True)
    shorter = gradient * (most / length.clamp(min=most))
    return torch.where(torch.isfinite(length), shorter, 0.0)


def within(values: Tensor, low: float, high: float) -> Tensor:
    """Return ``values`` clamped, with the gradients that point back inside.

    A plain clamp has no gradient outside the range, so values outside would never be corrected.
    Gradients that point further out are zero here too. The sign assumes a loss, which decreases.
    """
    clamped: Tensor = _Within.apply(values, low, high)  # type: ignore[no-untyped-call]
    return clamped


class _Within(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, low: float, high: float) -> Tensor:
        ctx.save_for_backward(values)
        ctx.range = low, high
        return values.clamp(low, high)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        (values,) = ctx.saved_tensors
        low, high = ctx.range
        outwards = ((values > high) & (gradient < 0.0)) | ((values < low) & (gradient > 0.0))
        return gradient.masked_fill(outwards, 0.0), None, None
