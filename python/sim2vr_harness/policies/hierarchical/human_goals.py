"""Goals of a human motor policy: a place, its width, and what counts as done; no duration."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.motor_goals import (
    GOAL_SIZE,
    MOMENT_S,
    MotorGoals,
    describe,
    tips,
)

__all__ = ["HUMAN_GOAL_SIZE", "GoalPerception", "HumanGoals", "describe_human"]

HUMAN_GOAL_SIZE = GOAL_SIZE + 4
"""Numbers that a hand's goal has in an observation."""
_WIDTH_M, _LEAST_M = 0.04, 0.002
_USUAL_MPS, _SHORTEST_S, _LONGEST_S = 0.9, 0.05, 1.2
"""Speed by which a plain motor policy's input of the time left is filled in."""
_FIXATION_S = 0.2
"""Correlation time of what is misjudged: about a fixation."""


@dataclass
class HumanGoals(MotorGoals):
    """Goals of B users' H hands.

    Attributes:
        width: (B, H) diameter of the target, m.
        stops: (B, H) 1 for hands that come to rest in the target, 0 for those that select or pass.
    """

    width: Tensor
    stops: Tensor

    @staticmethod
    def none(users: int, hands: int) -> HumanGoals:
        """Return goals of hands that rest."""
        plain = MotorGoals.none(users, hands)
        width = torch.full((users, hands), _WIDTH_M)
        return HumanGoals(**plain.tensors(), width=width, stops=torch.ones(users, hands))


def describe_human(goals: HumanGoals, place: Tensor, soon: Tensor) -> Tensor:
    """(B, H, HUMAN_GOAL_SIZE) what a human motor policy observes of its goals.

    Args:
        goals: of H hands.
        place: (B, H, 4, 4) where the user believes the hands' devices to be.
        soon: the same ``MOMENT_S`` later.
    """
    now = tips(place, goals.tip)
    velocity = (tips(soon, goals.tip) - now) / MOMENT_S
    way = goals.place - now
    far = way.square().sum(-1).add(1e-8).sqrt()
    closing = (velocity * way).sum(-1) / far.clamp(min=1e-3)
    left = (far / closing.clamp(min=_USUAL_MPS)).clamp(_SHORTEST_S, _LONGEST_S)
    timed = MotorGoals(goals.tip, goals.place, goals.velocity, left, goals.axis, goals.active)
    size = (goals.width / _WIDTH_M).log()
    inside = ((far + _LEAST_M) / (0.5 * goals.width + _LEAST_M)).log()
    speed = velocity.square().sum(-1).add(1e-6).sqrt()
    more = torch.stack([size, inside, goals.stops, speed], -1)
    more = more * goals.active[..., None]
    return torch.cat([describe(timed, place, soon), more.clamp(-8.0, 8.0)], -1)


class GoalPerception:
    """Where users believe that goals are: misjudged in proportion to the distance last seen.

    Args:
        n: number of users.
        hands: H of each.
        step_s: duration of a user step.
        weber: standard deviation of the error along each axis, of the distance from the hand.
        least_m: standard deviation of the error of a goal at the hand.
        late_steps: user steps by which the distance is seen late.
        generator: of the errors; None: torch's global one.
    """

    def __init__(
        self,
        n: int,
        hands: int,
        step_s: float,
        *,
        weber: float,
        least_m: float,
        late_steps: int,
        generator: torch.Generator | None = None,
    ) -> None:
        self._weber, self._least_m, self._generator = weber, least_m, generator
        self._keep = float(torch.exp(torch.tensor(-step_s / _FIXATION_S)))
        self._error = torch.zeros(n, hands, 3)
        """In standard deviations."""
        self._seen_m = torch.zeros(late_steps + 1, n, hands)

    def _drawn(self, count: int) -> Tensor:
        shape = (count, *self._error.shape[1:])
        return torch.randn(*shape, generator=self._generator)

    def forget(self, ids: Tensor, far: Tensor) -> None:
        """Let goals of users (K,) be new ones, at distances (K, H) from their hands."""
        self._error = self._error.clone()
        self._error[ids] = self._drawn(len(ids))
        self._seen_m = self._seen_m.clone()
        self._seen_m[:, ids] = far

    def look(self, far: Tensor) -> None:
        """Take in a user step, at whose end the goals are (B, H) from the hands."""
        fresh = (1.0 - self._keep**2) ** 0.5
        self._error = self._keep * self._error + fresh * self._drawn(len(self._error))
        self._seen_m = torch.cat([self._seen_m[1:], far[None]])

    def error(self) -> Tensor:
        """(B, H, 3) how far from their places goals seem to be, m."""
        return (self._least_m + self._weber * self._seen_m[0])[..., None] * self._error

    def state_dict(self) -> dict[str, Tensor]:
        """Everything that its future depends on, but for torch's global generator."""
        own = {"error": self._error.clone(), "seen_m": self._seen_m.clone()}
        return own | ({} if self._generator is None else {"drawn": self._generator.get_state()})

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Continue from :meth:`state_dict`."""
        self._error, self._seen_m = state["error"].clone(), state["seen_m"].clone()
        if self._generator is not None:
            self._generator.set_state(state["drawn"])
