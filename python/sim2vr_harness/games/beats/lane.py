"""Positions of a level's boxes, mines and walls, for a batch of rounds."""

from dataclasses import dataclass

import torch
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.games.beats.levels import NEVER_S, Levels
from sim2vr_harness.games.beats.rules import (
    CUT_PLANE_M,
    FAR_M,
    TOLD_BOXES,
    TOLD_MINES,
    TOLD_WALLS,
    WALL_BEHIND_M,
)

_BEFORE_S = (0.5, 1.0)
"""How long before a box arrives busy rounds begin."""


@dataclass(frozen=True)
class Coming:
    """The next K things of a kind, of B rounds, as they are in the game.

    Attributes:
        which: (B, K) their places in the level's lists.
        there: (B, K) whether there is one.
        until_s: (B, K) time until they arrive.
    """

    which: Tensor
    there: Tensor
    until_s: Tensor


class Lane(State):
    """B rounds' levels and how far they are.

    Args:
        n: number of rounds B.
        levels: to choose from.
        seed: of which level comes when.
    """

    def __init__(self, n: int, levels: Levels, seed: int) -> None:
        self.n, self.levels = n, levels
        self.generator = torch.Generator().manual_seed(seed)
        self.level = torch.zeros(n, dtype=torch.long)
        """(B,) which level."""
        self.time_s = torch.zeros(n)
        """(B,) the level's time."""
        self.box_gone = torch.zeros(n, levels.box_time.shape[1], dtype=torch.bool)
        self.mine_gone = torch.zeros(n, levels.mine_time.shape[1], dtype=torch.bool)
        self.wall_gone = torch.zeros(n, levels.wall_start.shape[1], dtype=torch.bool)
        """What was cut, touched or missed; of walls, what the head was in."""

    @property
    def speed(self) -> Tensor:
        """(B,) m/s."""
        return self.levels.speed[self.level]

    @property
    def condition(self) -> Tensor:
        """(B,)."""
        return self.levels.condition[self.level]

    def begin(self, ids: Tensor, *, busy: float | None = None) -> None:
        """Let rounds ``ids`` play levels drawn anew.

        Args:
            ids: (K,).
            busy: share of those that begin shortly before a box arrives, the others at any moment;
                None: all at the level's start.
        """
        count, generator = len(ids), self.generator
        level = torch.randint(len(self.levels.speed), (count,), generator=generator)
        self.level[ids] = level
        if busy is None:
            self.time_s[ids] = 0.0
        else:
            any_s = torch.rand(count, generator=generator) * self.levels.length[level]
            times = self.levels.box_time[level]
            real = (times < NEVER_S).float() + 1e-9
            box = torch.multinomial(real, 1, generator=generator)
            least, most = _BEFORE_S
            before_s = least + (most - least) * torch.rand(count, generator=generator)
            near_s = (times.gather(1, box)[:, 0] - before_s).clamp(min=0.0)
            hurried = torch.rand(count, generator=generator) < busy
            self.time_s[ids] = torch.where(hurried & (near_s < NEVER_S / 2), near_s, any_s)
        arrived = self.time_s[ids, None] + self._late(level)
        self.box_gone[ids] = self.levels.box_time[level] <= arrived
        self.mine_gone[ids] = self.levels.mine_time[level] <= arrived
        self.wall_gone[ids] = self.levels.wall_end[level] <= self.time_s[ids, None]

    def _late(self, level: Tensor) -> Tensor:
        """(K, 1) how long after its time a box passes the head plane, below 0, s."""
        return -CUT_PLANE_M / self.levels.speed[level, None]

    def advance(self, step_s: float) -> Tensor:
        """Let time pass; returns (B,) whether a level is over."""
        self.time_s = self.time_s + step_s
        return self.time_s >= self.levels.length[self.level] - 1e-3

    def passed(self) -> tuple[Tensor, Tensor]:
        """(B, N) boxes and (B, M) mines that have come to the head plane and are not gone."""
        late = self.time_s[:, None] + self._late(self.level)
        boxes = (self.levels.box_time[self.level] <= late) & ~self.box_gone
        return boxes, (self.levels.mine_time[self.level] <= late) & ~self.mine_gone

    def boxes(self, hand: int, head_z: Tensor) -> Coming:
        """The next boxes of a hand that have been seen; ``head_z`` (B,) m from the origin."""
        time = self.levels.box_time[self.level]
        mine = (self.levels.box_hand[self.level] == hand) & ~self.box_gone
        return self._next(time, mine & self._seen(time, CUT_PLANE_M, head_z), TOLD_BOXES)

    def mines(self, head_z: Tensor) -> Coming:
        """The next mines that have been seen."""
        time = self.levels.mine_time[self.level]
        seen = self._seen(time, CUT_PLANE_M, head_z)
        return self._next(time, ~self.mine_gone & seen, TOLD_MINES)

    def walls(self, head_z: Tensor) -> Coming:
        """The next walls that have been seen, whether the head was in them or not."""
        time, end = self.levels.wall_start[self.level], self.levels.wall_end[self.level]
        behind_s = WALL_BEHIND_M / self.speed[:, None]
        there = self._seen(time, 0.0, head_z) & (end + behind_s > self.time_s[:, None])
        return self._next(time, there, TOLD_WALLS)

    def _seen(self, time: Tensor, at_m: float, head_z: Tensor) -> Tensor:
        until = time - self.time_s[:, None]
        away = at_m + self.speed[:, None] * until - head_z[:, None]
        return (away <= FAR_M) & (until <= self.levels.approach[self.level, None])

    def _next(self, time: Tensor, there: Tensor, count: int) -> Coming:
        until = torch.where(there, time - self.time_s[:, None], torch.tensor(torch.inf))
        first = until.topk(count, dim=1, largest=False)
        present = first.values < torch.inf
        nothing = time.shape[1] - 1  # the last one never comes: no one else is written over
        which = torch.where(present, first.indices, nothing)
        return Coming(which, present, torch.where(present, first.values, 0.0))

    def of(self, values: Tensor, coming: Coming) -> Tensor:
        """(B, K, ...) the levels' ``values`` (P, N, ...) of what comes."""
        return values[self.level[:, None], coming.which]

    _state = ("level", "time_s", "box_gone", "mine_gone", "wall_gone", "generator")
