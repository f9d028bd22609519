"""Blades that meet boxes: contacts, what cuts are worth, and the strokes that lead to them."""

from dataclasses import dataclass

import torch
from torch import Tensor

from sim2vr_harness.games.beats.rules import (
    ANGLE_LIMIT_DEG,
    ANGLE_POINTS,
    BASE_POINTS,
    BLADE_M,
    CUT_PLANE_M,
    FULL_CUT_MPS,
    MIN_CUT_MPS,
    SPEED_POINTS,
)
from sim2vr_harness.games.beats.sabers import Blades, distances
from sim2vr_harness.games.beats.settings import Relaxation

CONTACT_MARGIN_M, _SPEED_MARGIN_MPS, _ANGLE_MARGIN_DEG = 0.01, 0.1, 5.0
_STROKE_MPS, _DRAWN_M = 3.0, 0.4


@dataclass(frozen=True)
class Contact:
    """Where blades and boxes are closest, or meet first, in a frame: (B, 2 blades, K boxes).

    Attributes:
        apart: distance of the surfaces, m.
        speed: of the blade across itself, m/s.
        angle: between the blade's motion and the demanded direction, degrees; 0 for any.
        forward: speed along the demanded direction, m/s.
    """

    apart: Tensor
    speed: Tensor
    angle: Tensor
    forward: Tensor

    def cuts(self) -> Tensor:
        """Which blades cut which boxes, by the true rules."""
        return (self.apart <= 0.0) & (self.speed >= MIN_CUT_MPS)

    def chance(self, soft: Relaxation) -> Tensor:
        """How likely each blade cuts each box, relaxed."""
        touch = torch.sigmoid((CONTACT_MARGIN_M - self.apart) / soft.contact_m - 1.0)
        speed = (self.speed - MIN_CUT_MPS - _SPEED_MARGIN_MPS) / soft.speed_mps
        return touch * torch.sigmoid(speed)

    def worth(self, soft: Relaxation) -> Tensor:
        """What a cut by the right blade is worth, relaxed."""
        off = ANGLE_LIMIT_DEG - _ANGLE_MARGIN_DEG - self.angle
        good = torch.sigmoid(off / soft.angle_deg)
        return good * points(self.speed, self.angle) - (1.0 - good) * soft.error


def points(speed: Tensor, angle: Tensor) -> Tensor:
    """What a correct slice is worth, not rounded."""
    swift = ((speed - MIN_CUT_MPS) / (FULL_CUT_MPS - MIN_CUT_MPS)).clamp(0.0, 1.0)
    straight = (1.0 - angle / ANGLE_LIMIT_DEG).clamp(min=0.0)
    return BASE_POINTS + SPEED_POINTS * swift + ANGLE_POINTS * straight


def turns(cut: Tensor) -> Tensor:
    """(B, K, 2) cosine and sine of how boxes are turned, by their demanded directions."""
    free = cut.abs().sum(-1, keepdim=True) == 0.0
    return torch.where(free, torch.tensor([1.0, 0.0]), cut)


def aside(blades: Blades, across: Tensor, cut: Tensor, half: Tensor) -> Tensor:
    """(B, 2, K) how far blades are from where boxes will be in the cut plane, m; 0 inside."""
    plane = torch.full_like(across[..., :1], CUT_PLANE_M)
    middles = torch.cat([across, plane], -1)[:, :, None]
    now = Blades(blades.root[:, :, None], blades.axis[:, :, None])
    apart, _ = distances(now, middles, turns(cut), half)
    return apart[..., 0].clamp(min=0.0)


def off_stroke(blades: Blades, across: Tensor, cut: Tensor, until_s: Tensor) -> Tensor:
    """(B, 2) how far each blade is from the stroke that would cut its next box, m.

    The stroke goes through the box's middle in the cut plane when the box is there, at even speed
    from where it is drawn back to; in the middle itself where any direction will do.

    Args:
        blades: (B, 2, 3).
        across: (B, 2, 2) x and y of the next box of each hand.
        cut: (B, 2, 2) demanded directions.
        until_s: (B, 2) until they arrive.
    """
    drawn = (_STROKE_MPS * until_s).clamp(-_DRAWN_M, _DRAWN_M)
    plane = torch.full_like(across[..., :1], CUT_PLANE_M)
    goal = torch.cat([across - drawn[..., None] * cut, plane], -1)
    from_root = goal - blades.root
    along = (from_root * blades.axis).sum(-1, keepdim=True).clamp(0.0, BLADE_M)
    return (from_root - along * blades.axis).square().sum(-1).add(1e-6).sqrt()


def first_or_closest(apart: Tensor) -> Tensor:
    """(..., 1) the first moment of contact, or where there is none the closest."""
    moments = apart.shape[-1]
    order = torch.arange(moments, 0, -1)
    touches = (apart <= 0.0) * order
    first, closest = touches.argmax(-1, keepdim=True), apart.argmin(-1, keepdim=True)
    return torch.where(touches.amax(-1, keepdim=True) > 0, first, closest)
