"""Pose of the hammer, and its depth in a target."""

from functools import cache

import torch
from torch import Tensor

from sim2vr_harness.games.whacamole.rules import (
    BOX_M,
    HAMMER_HALF_M,
    MARKER_M,
    TARGET_HALF_M,
)

POSE_FIELDS = (
    *(f"hammer.{axis}_m" for axis in "xyz"),
    *(f"hammer.{part}_{axis}" for part in ("face", "handle") for axis in "xyz"),
)
"""The privileged numbers that :meth:`Hammer.calibrate` goes by."""


class Hammer:
    """The hammer's pose by the places of controller and headset: it is fixed to the controller."""

    def __init__(self) -> None:
        self.fixed = torch.zeros(13, 9)
        """Marker, face and handle, linear in the place's position, rotation and 1."""

    def calibrate(self, place: Tensor, pose: Tensor) -> None:
        """Find how the hammer is fixed, from (K, 2, 4, 4) places and (K, 9) poses that belong."""
        known = self._known(place)
        least = known.double().cpu(), pose.double().cpu()  # GPUs do not have this driver
        self.fixed.copy_(torch.linalg.lstsq(*least, driver="gelsd").solution)

    @staticmethod
    def _known(place: Tensor) -> Tensor:
        hand, head, ones = place[:, 0], place[:, 1], torch.ones(len(place), 1)
        # From the head, since that is where the target area is placed, and people differ in height.
        return torch.cat([hand[:, :3, 3] - head[:, :3, 3], hand[:, :3, :3].flatten(1), ones], 1)

    def __call__(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 3) marker from the head, m, and (B, 3, 3) axes x, y, z as rows, the app's axes."""
        pose = self._known(place) @ self.fixed
        x, y = -pose[:, 3:6], pose[:, 6:]
        return pose[:, :3], torch.stack([x, y, torch.cross(x, y, dim=1)], 1)


@cache
def _sizes(device: torch.device) -> tuple[Tensor, ...]:
    """(3,) from root to marker and to the collider, and the half extents of hammer and target."""
    sizes = MARKER_M, BOX_M, HAMMER_HALF_M, TARGET_HALF_M
    return tuple(torch.tensor(size, device=device) for size in sizes)


def points(marker: Tensor, axes: Tensor) -> tuple[Tensor, Tensor]:
    """Root of the hammer and middle of its collider, (B, 3) m each."""
    to_marker, to_box, _, _ = _sizes(axes.device)
    root = marker - torch.einsum("k,bkx->bx", to_marker, axes)
    box = root + torch.einsum("k,bkx->bx", to_box, axes)
    return root, box


def depths(frame: Tensor, cells: Tensor, axes: Tensor, box: Tensor) -> Tensor:
    """How deep the hammer's box is in the targets' (separating axes), m; all > 0 inside.

    Args:
        frame: (B, 3, 3) axes of the targets, as rows.
        cells: (B, C, 3) middles of their boxes.
        axes: (B, 3, 3) axes of the hammer.
        box: (B, 3) middle of its box.

    Returns:
        (B, C, 7): along the axes of the target and of the hammer, and the least along the nine
        directions across an edge of each. Without the last, 8 % more boxes seem to overlap, and
        without the hammer's axes 60 %.
    """
    _, _, hammer, target = _sizes(axes.device)
    edges = torch.cross(frame[:, :, None], axes[:, None], dim=3).flatten(1, 2)  # (B, 9, 3)
    length = edges.norm(dim=2, keepdim=True)
    edges = edges / length.clamp(min=1e-3)
    directions = torch.cat([frame, axes, edges], 1)
    reach = ((directions @ frame.transpose(1, 2)).abs() * target).sum(2)
    reach = reach + ((directions @ axes.transpose(1, 2)).abs() * hammer).sum(2)
    apart = ((cells - box[:, None]) @ directions.transpose(1, 2)).abs()
    deep = reach[:, None] - apart  # (B, C, 15)
    parallel = (length[..., 0] < 1e-2)[:, None]  # no direction of its own
    across = torch.where(parallel, 1.0, deep[..., 6:]).amin(2, keepdim=True)
    return torch.cat([deep[..., :6], across], 2)
