"""Reachable positions of a body's hands."""

import numpy as np
import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy

INSIDE = 0.94
"""Share of the joints' ranges that postures are drawn from."""
_COUNT = 20_000


def reachable_poses(layer: MotorPolicy, seed: int) -> Tensor:
    """(P, H, 4, 4) places of the hands' devices in postures drawn at random, world frame."""
    rng = np.random.default_rng([seed, 58])
    low, high = layer.body.joint_ranges.T
    spread = rng.uniform(-1.0, 1.0, (_COUNT, len(low)))
    angles = torch.from_numpy(0.5 * (low + high) + 0.5 * INSIDE * (high - low) * spread).float()
    with torch.no_grad():
        return layer.places(angles, torch.zeros_like(angles))[0]
