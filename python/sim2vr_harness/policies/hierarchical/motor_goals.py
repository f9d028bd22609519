"""Goals of the motor policy: position, time, speed and direction of a point of the hand.

A goal belongs to a hand and to a point that is fixed to it, the tip: the hand itself, a hammer's
head, any point of a blade. It is set in every user step, so that its target may move; a hand
without a goal rests. All positions are in MuJoCo's world frame (z up, x forward, m).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

GOAL_SIZE = 22
"""Numbers that a hand's goal has in an observation."""
_FAR_M, _FAST_MPS, _LATE_S = 0.3, 1.5, 0.5
"""Units of what is observed."""
WIDTH_M = 0.04
"""Of targets whose width is not known."""
WIDTHS_M = (0.01, 0.12)
"""Widths that human motor policies learn with: narrower or wider targets count as these."""
MOMENT_S = 0.005
"""Interval of the finite difference that gives velocities from positions, s."""


@dataclass
class MotorGoals:
    """Goals of B users' H hands.

    Attributes:
        tip: (B, H, 3) the point that is meant, in the device's frame (x forward, y left, z up), m.
        place: (B, H, 3) where it shall be.
        velocity: (B, H, 3) with which velocity, m/s.
        left_s: (B, H) in how long; what is over is requested at once.
        axis: (B, H, 3) where the device's x axis shall point then, a unit vector; 0: anywhere.
        active: (B, H) 1, or 0 for a hand that has nothing to do.
        width: (B, H) diameter of the target, m; plain layers do not know it.
        rays: (B, H) 1 for a hand of a person that turns its aim ray to the place. Its tip is the
            point of the ray that is as far away as the place.
    """

    tip: Tensor
    place: Tensor
    velocity: Tensor
    left_s: Tensor
    axis: Tensor
    active: Tensor
    width: Tensor
    rays: Tensor

    @staticmethod
    def none(users: int, hands: int) -> MotorGoals:
        """Hands that have nothing to do."""

        def zeros() -> Tensor:
            return torch.zeros(users, hands, 3)

        def plain() -> Tensor:
            return torch.zeros(users, hands)

        width = torch.full((users, hands), WIDTH_M)
        return MotorGoals(zeros(), zeros(), zeros(), plain(), zeros(), plain(), width, plain())

    def tensors(self) -> dict[str, Tensor]:
        """Everything, by name."""
        return dict(vars(self))

    def put(self, users: Tensor, hand: Tensor, new: MotorGoals) -> None:
        """Replace the goals of K hands by K goals, (K, 1, ...)."""
        for name, values in new.tensors().items():
            changed = getattr(self, name).clone()
            changed[users, hand] = values[:, 0]
            setattr(self, name, changed)


def tips(place: Tensor, tip: Tensor) -> Tensor:
    """(B, H, 3) where points (B, H, 3) of devices at (B, H, 4, 4) are, m."""
    at: Tensor = place[..., :3, 3] + (place[..., :3, :3] @ tip[..., None])[..., 0]
    return at


def describe(goals: MotorGoals, place: Tensor, soon: Tensor) -> Tensor:
    """(B, H, GOAL_SIZE) what a motor layer knows of its goals.

    Args:
        goals: of H hands.
        place: (B, H, 4, 4) where the hands' devices are.
        soon: the same ``MOMENT_S`` later, if they go on as they move.
    """
    now = tips(place, goals.tip)
    velocity = (tips(soon, goals.tip) - now) / MOMENT_S
    left = goals.left_s.clamp(min=0.0)[..., None]
    way = goals.place - now
    forward = place[..., :3, 0]
    pointed = (goals.axis.abs().sum(-1, keepdim=True) > 0.0).float()
    turned = (place[..., :3, :3] @ goals.tip[..., None])[..., 0]
    parts = [
        way / _FAR_M,
        way / (left + 0.1) / _FAST_MPS,
        velocity / _FAST_MPS,
        goals.velocity / _FAST_MPS,
        turned / _FAR_M,
        left / _LATE_S,
        0.1 / (left + 0.1),
        (goals.axis - forward) * pointed,
        pointed,
        torch.ones_like(pointed),
    ]
    described = torch.cat(parts, -1) * goals.active[..., None]
    return described.clamp(-8.0, 8.0)
