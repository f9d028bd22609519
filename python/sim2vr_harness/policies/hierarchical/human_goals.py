"""Goals of a human motor policy: a place, its width, and what counts as done; no duration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.motor_goals import MotorGoals

RECOGNITION_S = 0.1
"""From what is seen to a decision by it, beside the visual delay (docs/concepts/people.md)."""
SAME_M = 0.06
"""A target that has moved less is followed without a new decision."""
_FIXATION_S = 0.2
"""Correlation time of what is misjudged: about a fixation."""


@dataclass
class HumanGoals(MotorGoals):
    """Goals of B users' H hands.

    Attributes:
        stops: (B, H) 1 for hands that come to rest in the target, 0 for those that select or pass.
    """

    stops: Tensor

    @staticmethod
    def none(users: int, hands: int) -> HumanGoals:
        """Return goals of hands that rest."""
        plain = MotorGoals.none(users, hands)
        return HumanGoals(**plain.tensors(), stops=torch.ones(users, hands))

    @staticmethod
    def of(goals: MotorGoals) -> HumanGoals:
        """Return goals without their durations; those without a velocity are to stop at."""
        stops = (goals.velocity.abs().sum(-1) == 0.0).float()
        return HumanGoals(**goals.tensors(), stops=stops)


class GoalPerception:
    """Where users believe that goals are: misjudged in proportion to the distance last seen.

    Args:
        n: number of users.
        hands: H of each.
        step_s: duration of a user step.
        weber: standard deviation of the error along each axis, of the distance from the hand.
        least_m: standard deviation of the error of a goal at the hand.
        late_steps: user steps by which the distance is seen late.
        generators: of each user's errors; None: torch's global one.
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
        generators: Sequence[torch.Generator] | None = None,
    ) -> None:
        self._weber, self._least_m, self.generators = weber, least_m, generators
        self._keep = float(torch.exp(torch.tensor(-step_s / _FIXATION_S)))
        self._error = torch.zeros(n, hands, 3)
        """In standard deviations."""
        self._seen_m = torch.zeros(late_steps + 1, n, hands)

    def _drawn(self, users: Sequence[int]) -> Tensor:
        shape = self._error.shape[1:]
        if self.generators is None:
            return torch.randn(len(users), *shape)
        return torch.stack([torch.randn(shape, generator=self.generators[i]) for i in users])

    def forget(self, ids: Tensor, far: Tensor) -> None:
        """Let goals of users (K,) be new ones, at distances (K, H) from their hands."""
        self._error = self._error.clone()
        self._error[ids] = self._drawn(ids.tolist())
        self._seen_m = self._seen_m.clone()
        self._seen_m[:, ids] = far

    def look(self, far: Tensor) -> None:
        """Take in a user step, at whose end the goals are (B, H) from the hands."""
        fresh = (1.0 - self._keep**2) ** 0.5
        self._error = self._keep * self._error + fresh * self._drawn(range(len(self._error)))
        self._seen_m = torch.cat([self._seen_m[1:], far[None]])

    def error(self) -> Tensor:
        """(B, H, 3) how far from their places goals seem to be, m."""
        return (self._least_m + self._weber * self._seen_m[0])[..., None] * self._error

    def state_dict(self) -> dict[str, Any]:
        """Everything that its future depends on, but for torch's global generator."""
        own = {"error": self._error.clone(), "seen_m": self._seen_m.clone()}
        return own | {"drawn": [each.get_state() for each in self.generators or ()]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        self._error, self._seen_m = state["error"].clone(), state["seen_m"].clone()
        for each, drawn in zip(self.generators or (), state["drawn"], strict=True):
            each.set_state(drawn)
