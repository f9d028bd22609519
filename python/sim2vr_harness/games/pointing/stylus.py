"""Position of the stylus' tip from the poses of controller and headset."""

import torch
from torch import Tensor

from sim2vr_harness.games.app_axes import head_of, to_app


class Stylus:
    """The tip by the controller's place: it is fixed to it."""

    def __init__(self) -> None:
        # Along the grip's forward axis, unless the true game says something else.
        self.fixed = torch.tensor([0.10, 0.0, 0.0])
        """(3,) tip in the controller's frame, MuJoCo's axes, m."""

    def calibrate(self, place: Tensor, tip: Tensor) -> None:
        """Find where the tip is, from (K, D, 4, 4) places and (K, 3) tips from the head."""
        world = tip + head_of(place)
        back = torch.stack([world[:, 2], -world[:, 0], world[:, 1]], -1) - place[:, 0, :3, 3]
        self.fixed = torch.einsum("kji,kj->ki", place[:, 0, :3, :3], back).median(0).values

    def __call__(self, place: Tensor) -> Tensor:
        """(B, 3) tip in the world, app's axes, m."""
        return to_app(place[:, 0, :3, :3] @ self.fixed + place[:, 0, :3, 3])
