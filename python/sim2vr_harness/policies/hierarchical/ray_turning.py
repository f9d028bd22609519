"""Persons turn the rays of their hands: angles in the place of lengths, and comfortable postures.

A ray is a point of the policy in space as hands are. Its way is the angle to the place times
``REFERENCE_M``, and so are its velocity, the target's width and what is misjudged. Where along the
ray the place is does not count.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.motor_goals import tips
from sim2vr_harness.policies.hierarchical.pointing import aim_of
from sim2vr_harness.world_models.body_dynamics import BodyModel

REFERENCE_M = 0.5
"""Length by which angles of rays are lengths of reaches."""
_POOL, _COMFORT, _INSIDE, _NEAR_RAD = 4096, 0.35, 0.9, 0.12
"""Postures; their standard deviation and most, of half the joints' ranges; how near the rays of
postures that count pass by a place."""


class Turning:
    """Rays that hands turn to their places, of B users' H hands; other hands stay as they are.

    Args:
        goals: of the hands.
        hand: (B, H, 3) where the devices are.
        tip: (B, H, 3) where the tips of the goals are.

    Attributes:
        rows: (B, H, 3, 3) from velocities of tips to those of the policy in space.
    """

    def __init__(self, goals: HumanGoals, hand: Tensor, tip: Tensor) -> None:
        self._turns = goals.rays[..., None] > 0.0
        ray, to = tip - hand, goals.place - hand
        far = ray.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        ray = ray / far
        self._plane = torch.eye(3) - goals.rays[..., None, None] * ray[..., None] * ray[..., None, :]
        scale = torch.where(self._turns, REFERENCE_M / far, torch.ones(()))
        self._scale, self.rows = scale, scale[..., None] * self._plane
        along = (to * ray).sum(-1, keepdim=True)
        beside = to - along * ray
        off = beside.norm(dim=-1, keepdim=True)
        self._way = REFERENCE_M * torch.atan2(off, along) * beside / off.clamp(min=1e-6)

    def seen(
        self, way: Tensor, velocity: Tensor, goals: HumanGoals
    ) -> tuple[Tensor, Tensor, HumanGoals]:
        """Return ways and velocities (B, H, 3), and goals, with those of rays in angles."""
        way = torch.where(self._turns, self._way, way)
        velocity = (self.rows @ velocity[..., None])[..., 0]
        return way, velocity, replace(goals, width=goals.width * self._scale[..., 0])

    def across(self, error: Tensor) -> Tensor:
        """(B, H, 3) what is misjudged, without what is along rays."""
        return (self._plane @ error[..., None])[..., 0]


def far_off(goals: HumanGoals, place: Tensor) -> Tensor:
    """(B, H) how far devices at (B, H, 4, 4) are from their goals, as the policy in space sees it."""
    hand, tip = place[..., :3, 3], tips(place, goals.tip)
    way = Turning(goals, hand, tip).seen(goals.place - tip, tip, goals)[0]
    return way.norm(dim=-1)


class AimingPostures:
    """Comfortable postures in which rays of hands point at places.

    Args:
        model: places the hands.
        person: (P,) who has them.
        low: (J,) least joint angles, rad.
        high: (J,) greatest joint angles, rad.
    """

    def __init__(self, model: BodyModel, person: Tensor, low: Tensor, high: Tensor) -> None:
        generator = torch.Generator().manual_seed(59)
        spread = _COMFORT * torch.randn(_POOL, len(low), generator=generator)
        spread = spread.clamp(-_INSIDE, _INSIDE)
        self._angles = 0.5 * (low + high) + 0.5 * spread * (high - low)
        with torch.no_grad():
            placed = model.places(self._angles, person.expand(_POOL, -1))
        self._hand, self._ray = placed[..., :3, 3], aim_of(placed)

    def towards(self, place: Tensor, rays: Tensor) -> Tensor:
        """(B, J) means of the postures that point at places (B, H, 3) with hands (B, H) that do."""
        to = torch.nn.functional.normalize(place[:, None] - self._hand, dim=-1)
        off = (1.0 - (to * self._ray).sum(-1)) * rays[:, None]
        likely = torch.softmax(-off.sum(-1) / _NEAR_RAD**2, 1)
        return likely @ self._angles
