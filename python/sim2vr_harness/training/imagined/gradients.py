"""Bounds on gradients through many user steps, of every user alone.

A body model that a network stands for is steep in a few states, and a gradient that goes through
sixteen of its steps now and then a hundred thousand times too long: one user then decides where
everybody's policy goes. Of the others nothing is changed.
"""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["limited"]


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
    return torch.where(torch.isfinite(length), shorter, torch.zeros(()))
