"""Aim a controller's ray at a place.

Plain motor layers bring a point that lies on the ray, ``_POINT_M`` before the hand, onto the line
from the hand to the place, as if it were the tip of a tool. What stays wrong is added up and taken
off. Persons turn the ray: see :class:`~.human_motor.Turning`.

Rays are (H, 2, 3): of each hand the origin (m) and the direction, in the device's frame; (2, 3) is
the same of all hands.
"""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.client.frames import AIM_DIRECTION
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals, tips
from sim2vr_harness.policies.scripted.places import own_ray

AIM_RAYS = torch.stack([torch.zeros(3), torch.from_numpy(AIM_DIRECTION).float()])
"""(2, 3) WebXR's, and that of apps without pages."""

_POINT_M = 0.8
_TO_REST = 0.2
"""Proportion of the way to its rest position that a pointing hand moves; 1 would turn the ray."""
_GAIN, _KEPT = 0.12, 0.98
"""Share of the error that is added to the correction in a user step, and that is kept of it."""
_NEAR = 0.2
"""Errors of direction (rad) above this are the way there; they are not added up."""
_MPS, _SOONEST_S, _LATEST_S = 1.5, 0.1, 1.2
_LEAST_M = 0.4
"""Places that are nearer to a person's hand are taken to be that far away."""
_SAME = 0.02
"""Rays whose directions and origins (m) differ by less are the same."""
_FORWARD = 0.9
"""Cosine: rays of postures that point this much forward tell where hands that point rest."""


def rays_of(simulation: Any, hands: Sequence[str]) -> Tensor:
    """(H, 2, 3) with which the app of users points for hands such as ``controller_right``."""
    found = [own_ray(simulation, hand.removeprefix("controller_")) for hand in hands]
    return torch.tensor([[ray.origin_m.tolist(), ray.direction.tolist()] for ray in found])


def apart(rays: Tensor, others: Tensor = AIM_RAYS) -> str:
    """Say how far rays (H, 2, 3) are from others, WebXR's or (H, 2, 3); "": they are the same."""
    if torch.allclose(rays, others.expand_as(rays), rtol=0.0, atol=_SAME):
        return ""
    one, other = rays[:, 1], others.expand_as(rays)[:, 1]
    angles = torch.atan2(torch.linalg.cross(one, other).norm(dim=-1), (one * other).sum(-1))
    cm = 100.0 * float((rays[..., 0, :] - others[..., 0, :]).norm(dim=-1).max())
    degrees = f"{float(torch.rad2deg(angles).max()):.0f} degrees"
    return f"{degrees} and {cm:.0f} cm" if cm >= 1.0 else degrees


def aim_of(place: Tensor, rays: Tensor = AIM_RAYS) -> Tensor:
    """(..., H, 3) directions of the rays of devices at (..., H, 4, 4)."""
    direction: Tensor = (place[..., :3, :3] @ rays[..., 1, :, None])[..., 0]
    return direction


def _origins(place: Tensor, rays: Tensor) -> Tensor:
    """(..., H, 3) where the rays of devices at (..., H, 4, 4) begin."""
    return tips(place, rays[..., 0, :])


def off_ray(place: Tensor, target: Tensor, rays: Tensor = AIM_RAYS) -> tuple[Tensor, Tensor]:
    """(..., H) how far targets (..., H, 3) are from rays of devices at (..., H, 4, 4), and along.

    Both in m; what is behind a ray's origin has a negative distance along it.
    """
    way = target - _origins(place, rays)
    aim = aim_of(place, rays)
    along = (way * aim).sum(-1)
    return (way - along[..., None] * aim).norm(dim=-1), along


def turn_rays(goals: MotorGoals, which: Tensor, place: Tensor, rays: Tensor = AIM_RAYS) -> None:
    """Let hands turn their rays to ``goals.place`` as persons do.

    Args:
        goals: changed in place.
        which: (N, H) the hands that point.
        place: (N, H, 4, 4) where the devices are.
    """
    far = (goals.place - _origins(place, rays)).norm(dim=-1, keepdim=True).clamp(min=_LEAST_M)
    point = rays[..., 0, :] + far * rays[..., 1, :]
    goals.tip = torch.where(which[..., None], point, goals.tip)
    goals.rays = which.float()


class Pointing:
    """Turns the rays of hands to places.

    Args:
        poses: (P, H, 4, 4) places that the devices can be at.
    """

    def __init__(self, poses: Tensor, rays: Tensor = AIM_RAYS) -> None:
        self._rays = rays
        forward = aim_of(poses, rays)[..., 0] > _FORWARD
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
        begin, aim = _origins(place, self._rays), aim_of(place, self._rays)
        wanted = torch.nn.functional.normalize(goals.place - begin, dim=-1)
        wrong = wanted - aim
        near = wrong.norm(dim=-1, keepdim=True) < _NEAR
        added = _KEPT * correction + _GAIN * wrong * near
        correction.copy_(torch.where(which[..., None], added, torch.zeros(())))
        base = begin + _TO_REST * (self._rest - place[..., :3, 3])
        ahead = torch.nn.functional.normalize(goals.place - base, dim=-1)
        there = base + _POINT_M * (ahead + correction)
        far = (there - begin - _POINT_M * aim).norm(dim=-1)
        point = (self._rays[..., 0, :] + _POINT_M * self._rays[..., 1, :]).expand_as(there)
        goals.tip = torch.where(which[..., None], point, goals.tip)
        goals.place = torch.where(which[..., None], there, goals.place)
        goals.left_s = torch.where(which, (far / _MPS).clamp(_SOONEST_S, _LATEST_S), goals.left_s)
