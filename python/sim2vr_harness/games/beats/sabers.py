"""Poses of the sabers, distances to boxes and speeds; differentiable."""

from dataclasses import dataclass

import torch
from torch import Tensor

from sim2vr_harness.games.app_axes import head_of, to_app
from sim2vr_harness.games.beats.rules import BLADE_FROM_M, BLADE_M

HANDS = ("left", "right")
"""In the order of the boxes' hands."""
_ALONG_M = (-0.15, 0.0, 0.15)
"""Points of a blade by which its distance from a box is found, about the one nearest to the box's
middle: within 2 cm of the exact distance."""


@dataclass(frozen=True)
class Blades:
    """Both sabers' blades, the app's axes (x right, y up, z forward), from the round's origin.

    Attributes:
        root: (B, 2, 3) lower ends, m.
        axis: (B, 2, 3) unit vectors to the tips.
    """

    root: Tensor
    axis: Tensor

    @property
    def tip(self) -> Tensor:
        """(B, 2, 3) m."""
        return self.root + BLADE_M * self.axis


def looked_away(place: Tensor) -> Tensor:
    """(B,) how far heads look away from where boxes come from: 1 at 45 degrees, by the square.

    Rolled heads count half.
    """
    ahead, up = place[:, -1, 0, 0], place[:, -1, 2, 2]
    # 2 (1 - cos) is the angle's square, nearly; it has no corner at 0.
    squares: Tensor = 2.0 * (1.0 - ahead) + (1.0 - up)
    return squares / (0.25 * torch.pi) ** 2


class Sabers:
    """The blades by the controllers' places: they are fixed to them."""

    def __init__(self) -> None:
        # Along the grip's forward axis, unless the true game says something else.
        root = torch.tensor([BLADE_FROM_M, 0.0, 0.0])
        axis = torch.tensor([1.0, 0.0, 0.0])
        self.fixed = torch.stack([root, axis]).repeat(2, 1, 1)
        """(2, 2, 3) of each hand, in the controller's frame (MuJoCo's axes): root and axis."""

    def calibrate(self, place: Tensor, root: Tensor, axis: Tensor) -> None:
        """Find how the blades are fixed.

        Args:
            place: (K, D, 4, 4) of both controllers and the headset.
            root: (K, 2, 3) lower ends from the head.
            axis: (K, 2, 3).
        """
        hands = place[:, :2]
        rotation = hands[..., :3, :3]
        head = head_of(place)[:, None]
        given = torch.stack([root + head, axis], 2)  # (K, 2, 2, 3)
        back = torch.stack([given[..., 2], -given[..., 0], given[..., 1]], -1)
        back = torch.stack([back[:, :, 0] - hands[..., :3, 3], back[:, :, 1]], 2)
        local = torch.einsum("khji,khpj->khpi", rotation, back)
        self.fixed = local.median(0).values
        self.fixed[:, 1] /= self.fixed[:, 1].norm(dim=1, keepdim=True)

    def __call__(self, place: Tensor, origin: Tensor) -> Blades:
        """(B, D, 4, 4) places and (B, 3) the rounds' origins."""
        hands = place[:, :2]
        turned = torch.einsum("bhij,hpj->bhpi", hands[..., :3, :3], self.fixed)
        root = to_app(turned[:, :, 0] + hands[..., :3, 3]) - origin[:, None]
        return Blades(root, to_app(turned[:, :, 1]))


def swing(before: Blades, after: Blades, shares: Tensor) -> Blades:
    """The blades at moments of a frame: hands move straight and turn at constant rate, nearly.

    Args:
        before: at the frame before.
        after: at this one.
        shares: (S,) of the frame's duration.

    Returns:
        roots and axes (B, 2, S, 3).
    """
    part = shares[:, None]
    root = before.root[:, :, None] + part * (after.root - before.root)[:, :, None]
    axis = before.axis[:, :, None] + part * (after.axis - before.axis)[:, :, None]
    return Blades(root, axis / axis.norm(dim=-1, keepdim=True).clamp(min=0.1))


def nearest(blades: Blades, middles: Tensor) -> tuple[Tensor, Tensor]:
    """How far along a blade the point nearest to a middle is.

    Args:
        blades: (B, 2, S, 3).
        middles: (B, K, S, 3) m.

    Returns:
        (B, 2, K, S) in m from the root, and the middles from the root (B, 2, K, S, 3).
    """
    from_root = middles[:, None] - blades.root[:, :, None]
    along = (from_root * blades.axis[:, :, None]).sum(-1)
    return along.clamp(0.0, BLADE_M), from_root


def distances(
    blades: Blades, middles: Tensor, turns: Tensor, half_m: Tensor
) -> tuple[Tensor, Tensor]:
    """How far the blades' middle lines are from cubes, m; below 0 inside.

    Args:
        blades: (B, 2, S, 3).
        middles: (B, K, S, 3) of the cubes.
        turns: (B, K, 2) cosine and sine of their turn about z.
        half_m: (B, K) half of an edge.

    Returns:
        (B, 2, K, S) distances, and how far along the blade the point nearest to the middle is.
    """
    along, from_root = nearest(blades, middles)
    shifts = torch.tensor(_ALONG_M)
    points = (along[..., None] + shifts).clamp(0.0, BLADE_M)  # (B, 2, K, S, P)
    axis = blades.axis[:, :, None, :, None]
    apart = points[..., None] * axis - from_root[..., None, :]
    cos, sin = turns[:, None, :, None, None, 0], turns[:, None, :, None, None, 1]
    x = cos * apart[..., 0] + sin * apart[..., 1]
    y = cos * apart[..., 1] - sin * apart[..., 0]
    beyond = torch.stack([x, y, apart[..., 2]], -1).abs() - half_m[:, None, :, None, None, None]
    outside = beyond.clamp(min=0.0).square().sum(-1).add(1e-8).sqrt()
    deep = beyond.amax(-1).clamp(max=0.0)
    return (outside + deep).amin(-1), along


def velocities(before: Blades, after: Blades, along: Tensor, axis: Tensor, step_s: float) -> Tensor:
    """(B, 2, K, 3) velocity of blades' points less what is along the blade, m/s.

    Args:
        before: (B, 2, 3).
        after: (B, 2, 3).
        along: (B, 2, K) how far the points are from the roots, m.
        axis: (B, 2, K, 3) of the blade at that moment.
        step_s: duration of the frame.
    """
    moved = (after.root - before.root)[:, :, None]
    turned = (after.axis - before.axis)[:, :, None]
    velocity = (moved + along[..., None] * turned) / step_s
    return velocity - (velocity * axis).sum(-1, keepdim=True) * axis
