"""Pointing's numbers, as the true game has them (docs/reference/games/pointing.md).

``tests/python/games/test_pointing_rules.py`` plays the running app against them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

HIT_REWARD = 10.0
TAP_START_M = 0.05
"""Where a tap may begin: so far in front of a target."""
TIME_TOLERANCE_S = 1e-3
"""A target may go away by so much before its time is over."""


def distance_reward(distance: Tensor) -> Tensor:
    """The game's term of the tip's distance from the target, m, per user step."""
    return 0.1 * (torch.exp(-10.0 * distance) - 1.0)


@dataclass(frozen=True)
class PointingTask:
    """What the options of a round say of its blocks.

    Attributes:
        targets: on the circle.
        blocks: (distance, width) of each, m.
        timeout_s: after which a target goes away.
        rearm_m: how far the tip must come out of the plane between selections.
        error_cost: of a selection beside the target.
        distance_weight: of :func:`distance_reward`, 0 or 1.
    """

    targets: int = 9
    blocks: tuple[tuple[float, float], ...] = ()
    timeout_s: float = 3.0
    rearm_m: float = 0.0
    error_cost: float = 5.0
    distance_weight: float = 1.0

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> PointingTask:
        """The task of a round's options; those that are missing have the game's defaults."""
        distances = options.get("distances_m", (0.10, 0.18, 0.32))
        widths = options.get("widths_m", (0.02, 0.03, 0.045))
        return cls(
            targets=int(options.get("targets", cls.targets)),
            blocks=tuple((float(d), float(w)) for d in distances for w in widths),
            timeout_s=float(options.get("timeout_seconds", cls.timeout_s)),
            rearm_m=float(options.get("rearm_m", cls.rearm_m)),
            error_cost=float(options.get("error_cost", cls.error_cost)),
            distance_weight=0.0 if options.get("sparse", False) else 1.0,
        )

    def center(self, block: int, target: int) -> tuple[float, float, float]:
        """Of a target from the circle's centre, m, the app's axes."""
        radius = 0.5 * self.blocks[block][0] / math.cos(math.pi / (2 * self.targets))
        angle = 2.0 * math.pi * target / self.targets
        return radius * math.sin(angle), radius * math.cos(angle), 0.0

    def target_of(self, trial: int) -> int:
        """The number of the target of a trial, 0 to ``targets``: always the one opposite."""
        return trial * ((self.targets + 1) // 2) % self.targets

    def centers(self) -> Tensor:
        """(blocks, trials, 3) of the targets in the order of their trials."""
        return torch.tensor(
            [
                [self.center(block, self.target_of(trial)) for trial in range(self.targets + 1)]
                for block in range(len(self.blocks))
            ]
        )

    def widths(self) -> Tensor:
        """(blocks,) m."""
        return torch.tensor([width for _, width in self.blocks])
