"""Persons turn the rays of their hands: angles in the place of lengths.

A ray is a point of the policy in space as hands are. Its way is the angle to the place times
``REFERENCE_M``, and so are its velocity, the target's width and what is misjudged. Where along the
ray the place is does not count.
"""

from dataclasses import replace

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.motor_goals import tips

REFERENCE_M = 0.4
"""Length by which angles of rays are lengths of reaches."""
_TAKEN = 0.6
"""Share of a wanted change of a ray's velocity that is taken up in a user step: what a light wrist
does is predicted badly, and all of it would shake the ray."""


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
        self._plane = (
            torch.eye(3) - goals.rays[..., None, None] * ray[..., None] * ray[..., None, :]
        )
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

    def taken(self, wanted: Tensor, velocity: Tensor) -> Tensor:
        """(B, H, 3) wanted velocities, to which those of rays come little by little."""
        return torch.where(self._turns, velocity + _TAKEN * (wanted - velocity), wanted)

    def across(self, error: Tensor) -> Tensor:
        """(B, H, 3) what is misjudged, without what is along rays."""
        return (self._plane @ error[..., None])[..., 0]


def far_off(goals: HumanGoals, place: Tensor) -> Tensor:
    """(B, H) how far devices at (B, H, 4, 4) are from goals, for the policy in space."""
    hand, tip = place[..., :3, 3], tips(place, goals.tip)
    way = Turning(goals, hand, tip).seen(goals.place - tip, tip, goals)[0]
    return way.norm(dim=-1)
