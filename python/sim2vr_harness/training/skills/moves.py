"""What a hand can be told to do with a place: come and stay, or go through it, this way or that."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from sim2vr_harness.training.skills.goals import MOMENT_S, Goals, tips
from sim2vr_harness.training.skills.layer import MotorLayer

__all__ = ["MOVES", "Choice", "Mover"]

_DIAGONAL = 0.5**0.5
_SIDEWAYS = {
    "up": (0.0, 1.0),
    "up right": (-_DIAGONAL, _DIAGONAL),
    "right": (-1.0, 0.0),
    "down right": (-_DIAGONAL, -_DIAGONAL),
    "down": (0.0, -1.0),
    "down left": (_DIAGONAL, -_DIAGONAL),
    "left": (1.0, 0.0),
    "up left": (_DIAGONAL, _DIAGONAL),
}
"""Direction to the left and up."""
MOVES = ("touch", "push", *_SIDEWAYS)
"""Names of the moves: come and stay, go through away from the head, go through sideways."""

_TOUCH_MPS, _STRIKE_MPS, _PUSH_MPS, _SWING_MPS = 0.9, 1.2, 2.5, 2.0
_DEEPER_M = 0.015
_RUN_UP_M, _FURTHER = 0.4, 1.25
"""Over which a hand gains its speed, and how much farther back it goes to begin."""
_SLOWEST = 0.55
"""Share of the speed it should have by then, below which it begins again."""
_REACHED_M = 0.06
_DEPTH_WEIGHT = 0.2
"""How much less depth counts than height and side, where a place is out of reach."""


class Choice:
    """What N users' H hands do: a move and a place each.

    Attributes:
        move: (N, H) number of a move, -1: rest.
        place: (N, H, 3) MuJoCo's world frame, m.
    """

    def __init__(self, n: int, hands: int) -> None:
        self.move = torch.full((n, hands), -1, dtype=torch.long)
        self.place = torch.zeros(n, hands, 3)


class Mover:
    """Turns moves into goals of a motor layer, in every user step anew.

    Args:
        layer: of the body.
        tip: (H, 3) the point of each device that things are done with, its frame, m.
        poses: (P, H, 4, 4) places that the devices can be at.
    """

    def __init__(self, layer: MotorLayer, tip: Tensor, poses: Tensor) -> None:
        self.layer, self.tip = layer, tip
        scale = np.array([_DEPTH_WEIGHT, 1.0, 1.0])
        self._scale = scale
        reach = tips(poses, tip.expand(len(poses), *tip.shape))
        self._reach: list[NDArray[np.float64]] = [
            reach[:, k].numpy().astype(np.float64) for k in range(len(tip))
        ]
        self._near = [cKDTree(points) for points in self._reach]
        self._beside = [cKDTree(points * scale) for points in self._reach]

    def within_reach(self, hand: int, places: Tensor) -> Tensor:
        """(K, 3) these places (K, 3), or where the hand waits for what is beyond its reach."""
        wanted = places.numpy().astype(np.float64)
        away, _ = self._near[hand].query(wanted)
        _, instead = self._beside[hand].query(wanted * self._scale)
        reached = np.where((away < _REACHED_M)[:, None], wanted, self._reach[hand][instead])
        return torch.from_numpy(reached).float()

    def distance(self, hand: int, places: Tensor) -> Tensor:
        """(K,) how far places (K, 3) are from what the hand has been seen to reach, m."""
        away, _ = self._near[hand].query(places.numpy().astype(np.float64))
        return torch.from_numpy(away).float()

    def tips(self, place: Tensor) -> Tensor:
        """(N, H, 3) where the tips of devices at (N, H, 4, 4) are."""
        return tips(place, self.tip.expand(len(place), *self.tip.shape))

    def goals(self, choice: Choice, head: Tensor, place: Tensor, soon: Tensor) -> Goals:
        """Return the goals of this user step.

        Args:
            choice: what the hands do.
            head: (N, 3) where the headsets are.
            place: (N, H, 4, 4) where the devices are.
            soon: the same ``MOMENT_S`` later.
        """
        n, hands = choice.move.shape
        goals = Goals.none(n, hands)
        goals.tip = self.tip.expand(n, hands, 3).clone()
        now = self.tips(place)
        velocity = (self.tips(soon) - now) / MOMENT_S
        away = choice.place - head[:, None]
        away = away / away.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        directions = torch.zeros(n, hands, 3)
        for number, name in enumerate(MOVES):
            chosen = choice.move == number
            if name == "push":
                directions[chosen] = _PUSH_MPS * away[chosen]
            elif name in _SIDEWAYS:
                left, up = _SIDEWAYS[name]
                directions[chosen] = _SWING_MPS * torch.tensor([0.0, left, up])
        touches = (choice.move == 0)[..., None]
        goals.place = choice.place + _DEEPER_M * away * touches
        goals.velocity = directions
        self._run_up(goals, now, velocity)
        way = goals.place - now
        far = way.norm(dim=-1)
        closing = (velocity * way).sum(-1) / far.clamp(min=1e-3)
        slow = torch.where(touches[..., 0], torch.tensor(_TOUCH_MPS), torch.tensor(_STRIKE_MPS))
        goals.left_s = (far / torch.maximum(closing, slow)).clamp(0.05, 1.2)
        goals.active = (choice.move >= 0).float()
        return goals

    @staticmethod
    def _run_up(goals: Goals, now: Tensor, velocity: Tensor) -> None:
        """Send hands back that are about to go through their place too slowly.

        Args:
            goals: changed in place.
            now: (N, H, 3) where the tips are.
            velocity: (N, H, 3) theirs.
        """
        speed = goals.velocity.norm(dim=-1, keepdim=True)
        direction = goals.velocity / speed.clamp(min=1e-6)
        before = ((goals.place - now) * direction).sum(-1, keepdim=True)
        due = _SLOWEST * speed * (1.0 - before / _RUN_UP_M).clamp(max=1.0)
        late = (velocity * direction).sum(-1, keepdim=True) < due
        back = late & (speed > 0.0)
        begin = goals.place - _FURTHER * _RUN_UP_M * direction
        goals.place = torch.where(back, begin, goals.place)
        goals.velocity = torch.where(back, torch.zeros(()), goals.velocity)
