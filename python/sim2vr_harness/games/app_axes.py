"""MuJoCo's axes as the app's, for the differentiable game models."""

import torch
from torch import Tensor


def to_app(vectors: Tensor) -> Tensor:
    """(..., 3) of MuJoCo's axes (x forward, y left, z up)."""
    return torch.stack([-vectors[..., 1], vectors[..., 2], vectors[..., 0]], -1)


def head_of(place: Tensor) -> Tensor:
    """(B, 3) the headset's position, app's axes, m; it is the last of the devices."""
    return to_app(place[:, -1, :3, 3])
