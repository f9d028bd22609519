"""Aim a controller's ray at a place.

Plain motor layers bring a point that lies on the ray, ``_POINT_M`` before the hand, onto the line
from the hand to the place, as if it were the tip of a tool. What stays wrong is added up and taken
off. Persons turn the ray: see :mod:`~.ray_turning`.
"""

from __future__ import annotations

import torch
from torch import Tensor

from sim2vr_harness.client.frames import AIM_DIRECTION
from sim2vr_harness.policies.hierarchical.motor_goals import MotorGoals

_POINT_M = 0.8
_TO_REST = 0.2
"""How much of the way to its place of rest the hand is drawn. All of it would turn the ray."""
_GAIN, _KEPT = 0.12, 0.98
"""Share of the error that is added to the correction in a user step, and that is kept of it."""
_NEAR = 0.2
"""Errors of direction (rad) above this are the way there; they are not added up."""
_MPS, _SOONEST_S, _LATEST_S = 1.5, 0.1, 1.2
_LEAST_M = 0.4
"""Places that are nearer to a person's hand are taken to be that far away."""
_FORWARD = 0.9
"""Cosine: rays of postures that point this much forward tell where hands that point rest."""


def aim_of(place: Tensor) -> Tensor:
    """(..., 3) directions of the aim rays of devices at (..., 4, 4)."""
    direction: Tensor = place[..., :3, :3] @ torch.from_numpy(AIM_DIRECTION).float()
    return direction


def off_ray(place: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
    """(...) how far targets (..., 3) are from the aim rays of devices at (..., 4, 4), and along.

    Both in m; what is behind the hand has a negative distance along the ray.
    """
    way = target - place[..., :3, 3]
    aim = aim_of(place)
    along = (way * aim).sum(-1)
    return (way - along[..., None] * aim).norm(dim=-1), along


def turn_rays(goals: MotorGoals, which: Tensor, place: Tensor) -> None:
    """Let hands turn their rays to ``goals.place`` as persons do.

    Args:
        goals: changed in place.
        which: (N, H) the hands that point.
        place: (N, H, 4, 4) where the devices are.
    """
    far = (goals.place - place[..., :3, 3]).norm(dim=-1, keepdim=True).clamp(min=_LEAST_M)
    point = far * torch.from_numpy(AIM_DIRECTION).float()
    goals.tip = torch.where(which[..., None], point, goals.tip)
    goals.rays = which.float()


class Pointing:
    """Turns the aim rays of hands to places.

    Args:
        poses: (P, H, 4, 4) places that the devices can be at.
    """

    def __init__(self, poses: Tensor) -> None:
        forward = aim_of(poses)[..., 0] > _FORWARD
        hands = range(poses.shape[1])
        found = [poses[forward[:, h], h, :3, 3] for h in hands]
        everywhere = [poses[:, h, :3, 3] for h in hands]
        pairs = zip(found, everywhere, strict=True)
        self._rest = torch.stack([(f if len(f) else e).median(0).values for f, e in pairs])

    def aim(self, goals: MotorGoals, correction: Tensor, which: Tensor, place: Tensor) -> None:
        """Set the goals of hands that point; the place to point at is ``goals.place``.

        Args:
            goals: changed in place.
            correction: (N, H, 3) of the ray's direction, from earlier user steps; changed in place.
            which: (N, H) the hands that point.
            place: (N, H, 4, 4) where the devices are.
        """
        hand, aim = place[..., :3, 3], aim_of(place)
        wanted = torch.nn.functional.normalize(goals.place - hand, dim=-1)
        wrong = wanted - aim
        near = wrong.norm(dim=-1, keepdim=True) < _NEAR
        added = _KEPT * correction + _GAIN * wrong * near
        correction.copy_(torch.where(which[..., None], added, torch.zeros(())))
        base = hand + _TO_REST * (self._rest - hand)
        ahead = torch.nn.functional.normalize(goals.place - base, dim=-1)
        there = base + _POINT_M * (ahead + correction)
        far = (there - hand - _POINT_M * aim).norm(dim=-1)
        point = (_POINT_M * torch.from_numpy(AIM_DIRECTION).float()).expand_as(there)
        goals.tip = torch.where(which[..., None], point, goals.tip)
        goals.place = torch.where(which[..., None], there, goals.place)
        goals.left_s = torch.where(which, (far / _MPS).clamp(_SOONEST_S, _LATEST_S), goals.left_s)
