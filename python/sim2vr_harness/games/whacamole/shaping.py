"""Reward shaping of imagined Whac-A-Mole: the worth of a hit, and terms between hits."""

from dataclasses import dataclass

import torch
from torch import Tensor

from sim2vr_harness.games.whacamole.rules import CELL_M, CELLS, FRAME_S, START_M
from sim2vr_harness.games.whacamole.settings import RUN_UP_M

_STROKES_S, _STROKE_MPS, _THROUGH_M, _STROKE_OFF_M = (0.6, 1.0), 1.5, 0.03, 0.3
"""When strokes go through a target's middle, after it appeared; how fast, and how far."""
_CENTRE_M = 0.02
"""Beside the middle of a target: people's end points spread by 1.5 cm along each way."""
_HARD_MPS = 3.0
"""A hit that cannot be harder."""
_CLEAR_M, _AWAY_M = START_M, 0.5 * CELL_M
"""How far in front of the plane a hammer is clear of it; how far beside a target away from it."""
_SEEN_FRAMES = 3
"""What has been there for 0.15 s can have been seen: people's hands begin to go there after .19."""


@dataclass(frozen=True)
class Targets:
    """Target areas of B users, and the ages of their targets.

    Attributes:
        age: (B, cells) frames; -1 without a target.
        area: (B, 3) middle of the area, m.
        axes: (B, 3, 3) axes right, up and behind, as rows.
        strike: (B, 3) direction whose speed hits are judged by.
        cells: (B, cells, 3) middles of the targets' volumes, m.
    """

    age: Tensor
    area: Tensor
    axes: Tensor
    strike: Tensor
    cells: Tensor

    def aside(self, point: Tensor) -> Tensor:
        """(B, cells) distance of points (B, 3) from the cells' middles, in their plane, m."""
        gap = self.cells - point[:, None]
        aside: Tensor = (gap @ self.axes[:, :2].transpose(1, 2)).square().sum(2).add(1e-8).sqrt()
        return aside

    def depth(self, marker: Tensor) -> Tensor:
        """(B,) m behind the targets' plane; negative before it."""
        return ((marker - self.area) * self.axes[:, 2]).sum(1)

    def strike_mps(self, velocity: Tensor) -> Tensor:
        """(B,) speed of velocities (B, 3) towards the targets; hits are judged by the root's."""
        return (velocity * self.strike).sum(1)


def central(targets: Targets, box: Tensor, share: float) -> Tensor:
    """(B, cells) the worth of a hit by where in the target it is, 1 in its middle.

    Args:
        targets: of the users.
        box: (B, 3) the middle of what hits.
        share: of the worth, that is for the middle.
    """
    if share == 0.0:
        return torch.ones(len(box), CELLS)
    off = targets.aside(box) / _CENTRE_M
    return 1.0 - share * (1.0 - torch.exp(-0.5 * off.square()))


def hardness(targets: Targets, velocity: Tensor, share: float) -> Tensor:
    """(B,) the worth of a hit by the velocity of what hits (B, 3), m/s."""
    if share == 0.0:
        return torch.ones(len(velocity))
    hard = (targets.strike_mps(velocity) / _HARD_MPS).clamp(0.0, 1.0)
    return 1.0 - share * (1.0 - hard)


def facing(targets: Targets, axes: Tensor, share: float) -> Tensor:
    """(B,) the worth of a hit by the hammer's axes (B, 3, 3); its face looks against its x."""
    if share == 0.0:
        return torch.ones(len(axes))
    faces = -(axes[:, 0] * targets.axes[:, 2]).sum(1)
    return 1.0 - 0.5 * share * (1.0 - faces)


def in_plane(targets: Targets, marker: Tensor) -> Tensor:
    """(B,) 1 in the plane, 2 well behind it, 0 well before it or at a target."""
    near = (1.0 + targets.depth(marker) / _CLEAR_M).clamp(0.0, 2.0)
    aside = torch.where(targets.age >= 0, targets.aside(marker), _AWAY_M)
    return near * (aside.amin(1) / _AWAY_M).clamp(max=1.0)


def going_blind(targets: Targets, marker: Tensor, velocity: Tensor) -> Tensor:
    """(B,) m/s towards the targets where there is none that can have been seen."""
    off = torch.where(targets.age >= _SEEN_FRAMES, targets.aside(marker) / _AWAY_M, 10.0)
    before_one = torch.exp(-0.5 * off.amin(1).square())
    return targets.strike_mps(velocity).clamp(min=0.0) * (1.0 - before_one)


def on_stroke(targets: Targets, marker: Tensor) -> Tensor:
    """(B,) 1 on the stroke that would hit the oldest target, less beside it, 0 without one.

    Strokes begin at rest in front of the cell, speed up evenly, and go through it; the second
    one is for users that have missed.
    """
    age, cell = targets.age.max(1)
    rows = torch.arange(len(age))
    first_s, second_s = (at_s - FRAME_S * age for at_s in _STROKES_S)
    until_s = torch.where(first_s > -1.5 * FRAME_S, first_s, second_s)[:, None]
    takes_s = 2.0 * RUN_UP_M / _STROKE_MPS
    before_m = RUN_UP_M * (1.0 - (1.0 - until_s.clamp(max=takes_s) / takes_s).square())
    before_m = before_m.clamp(min=-_THROUGH_M)
    goal = targets.cells[rows, cell] - before_m * targets.axes[:, 2]
    off = (marker - goal).square().sum(1).add(1e-8).sqrt()
    return (age >= 0) * (1.0 - off / _STROKE_OFF_M)
