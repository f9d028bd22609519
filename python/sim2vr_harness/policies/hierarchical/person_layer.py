"""A human motor policy in the place of a plain one: simulated persons below the same options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.human_motor import HumanHands, HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.motor_goals import MotorGoals
from sim2vr_harness.policies.hierarchical.ray_turning import far_off
from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.transitions import Motion

_ELSEWHERE_M = 0.06
"""A goal that far from the last one is a new one."""


def human_goals(goals: MotorGoals) -> HumanGoals:
    """Return goals without their durations; those without a velocity are to stop at."""
    stops = (goals.velocity.abs().sum(-1) == 0.0).float()
    return HumanGoals(**goals.tensors(), stops=stops)


class PersonLayer:
    """What a plain motor policy does for N simulated users, done by persons.

    It remembers what they feel and do: :meth:`decide` is called once in every user step.

    Args:
        policy: of the body.
        n: number of users N.
        persons: returns who they are, (N, P).
        seed: of what they misjudge.
    """

    def __init__(
        self,
        policy: HumanMotorPolicy,
        n: int,
        persons: Callable[[], NDArray[np.float64]],
        seed: int,
    ) -> None:
        self.policy, self.body, self.hands = policy, policy.body, policy.hands
        self.step_s, self.drives, self.width = policy.step_s, policy.drives, policy.width
        self._persons, self._n = persons, n
        generator = torch.Generator().manual_seed(seed)
        self._moved = HumanHands(policy, n, policy.perception(n, generator))
        self._now: Motion | None = None
        self._goal: Tensor | None = None

    @property
    def vigour(self) -> float:
        """What the persons' weights of effort are divided by."""
        return self._moved.vigour

    @vigour.setter
    def vigour(self, value: float) -> None:
        self._moved.vigour = value

    def state_dict(self) -> dict[str, Any]:
        """Return what the persons remember, for :meth:`load_state_dict`."""
        own = {} if self._goal is None else {"goal": self._goal.clone()}
        return {"hands": self._moved.state_dict(), "vigour": self.vigour, **own}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        self._moved.load_state_dict(state["hands"])
        self.vigour = state["vigour"]
        self._goal = state.get("goal")

    def motion(self, users: UserBatch) -> tuple[Tensor, Tensor, Tensor]:
        """Angles, speeds (N, J) and drives (N, A) of the users as they are now."""
        now = self._now = self._moved.motion(users, self._persons())
        self._moved.forget(np.flatnonzero(users.time < 0.5 * self.step_s))
        return now.angles, now.speeds, now.drives

    def places(self, angles: Tensor, speeds: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H, 4, 4) each: where devices are, and a moment later.

        Of the users or, for another number of rows, of the first of them.
        """
        persons = torch.from_numpy(self._persons()).float()
        if len(angles) != len(persons):
            persons = persons[:1].expand(len(angles), -1)
        return self.policy.places(Motion(angles, speeds, angles[:, :0], persons))

    def act(self, users: UserBatch, goals: MotorGoals) -> NDArray[np.float32]:
        """(N, A) what the bodies do now, in [-1, 1]."""
        with torch.no_grad():
            motion = self.motion(users)
            return self.decide(motion, self.places(*motion[:2]), goals)

    def decide(
        self,
        motion: tuple[Tensor, Tensor, Tensor],
        placed: tuple[Tensor, Tensor],
        goals: MotorGoals,
    ) -> NDArray[np.float32]:
        """(N, A) the same, for what :meth:`motion` and :meth:`places` have said already."""
        assert self._now is not None
        place, wanted = goals.place, human_goals(goals)
        if self._goal is not None:
            moved = (place - self._goal).norm(dim=-1).amax(1) > _ELSEWHERE_M
            far = far_off(wanted, placed[0])
            ids = torch.nonzero(moved).flatten()
            self._moved.aim_anew(ids, far[ids])
        self._goal = place.clone()
        return self._moved.act(self._now, wanted)[0]
