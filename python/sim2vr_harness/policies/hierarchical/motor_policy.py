"""The motor layer of a body: goals of its hands in, actions of its muscles or motors out."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.policies.hierarchical.motor_goals import (
    GOAL_SIZE,
    MOMENT_S,
    MotorGoals,
    describe,
)
from sim2vr_harness.users import Body, UserBatch, held
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.body_dynamics import mlp

_CLIP = 8.0


class MotorPolicy(nn.Module):
    """A policy that brings hands to their goals.

    Args:
        body: whose.
        step_s: duration of a user step.
        width: of the two hidden layers.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, body: Body, step_s: float, *, width: int = 256) -> None:
        super().__init__()
        self.body, self.step_s, self.hands = body, step_s, held(body.devices)
        self.width = width
        self.drives = ActuatorState(body)
        self.chains = Chains(body, self.hands)
        low, high = torch.tensor(body.joint_ranges.T.copy(), dtype=torch.float32)
        self._low, self._span = low, high - low
        joints = len(body.independent_joints)
        known = len(self.drives.names)
        self.size = 2 * joints + known + GOAL_SIZE * len(self.hands)
        """Numbers of an observation."""
        self.register_buffer("mean", torch.zeros(self.size))
        self.register_buffer("std", torch.ones(self.size))
        self.net = mlp(self.size, width, width, self.drives.count)
        with torch.no_grad():
            last = self.net[-1]
            assert isinstance(last, nn.Linear)
            last.weight.mul_(0.1)
            last.bias.zero_()

    def __repr__(self) -> str:
        """Return the body, the hands and the sizes of observation and action."""
        sizes = f"{self.size} numbers observed, {self.drives.count} actions"
        return f"MotorPolicy({self.body.name}, {' and '.join(self.hands)}: {sizes})"

    def places(self, angles: Tensor, speeds: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H, 4, 4) each: where the hands' devices are, and ``MOMENT_S`` later."""
        both: Tensor = self.chains(torch.cat([angles, angles + MOMENT_S * speeds]))
        now, soon = both.chunk(2)
        return now, soon

    def observe(self, angles: Tensor, speeds: Tensor, drives: Tensor, goals: Tensor) -> Tensor:
        """(B, size) what it acts on; ``goals`` (B, H * GOAL_SIZE) as :func:`describe` has them."""
        unit = 2.0 * (angles - self._low) / self._span - 1.0
        return torch.cat([unit, speeds, self.drives.observe(drives), goals], 1)

    def normalised(self, observation: Tensor) -> Tensor:
        """(B, size) observations in units of what is usual."""
        return ((observation - self.mean) / self.std).clamp(-_CLIP, _CLIP)

    def forward(self, observation: Tensor) -> Tensor:
        """(B, A) actions, not clipped, of observations (B, size)."""
        action: Tensor = 0.5 * self.net(self.normalised(observation))
        return action

    def motion(self, users: UserBatch) -> tuple[Tensor, Tensor, Tensor]:
        """Angles, speeds (B, J) and drives (B, A) of simulated bodies as they are now."""
        body = self.body
        parts = (
            users.qpos[:, body.qpos_independent],
            users.qvel[:, body.qvel_independent],
            self.drives.of(users),
        )
        angles, speeds, drives = (torch.from_numpy(np.asarray(p)).float() for p in parts)
        return angles, speeds, drives

    def act(self, users: UserBatch, goals: MotorGoals) -> NDArray[np.float32]:
        """(B, A) what the bodies shall do now, in [-1, 1]."""
        with torch.inference_mode():
            motion = self.motion(users)
            return self.decide(motion, self.places(*motion[:2]), goals)

    def decide(
        self,
        motion: tuple[Tensor, Tensor, Tensor],
        placed: tuple[Tensor, Tensor],
        goals: MotorGoals,
    ) -> NDArray[np.float32]:
        """(B, A) the same, for what :meth:`motion` and :meth:`places` have said already."""
        with torch.inference_mode():
            told = describe(goals, *placed).flatten(1)
            actions = self(self.observe(*motion, told)).clamp(-1.0, 1.0)
        result: NDArray[np.float32] = actions.numpy()
        return result

    def header(self) -> dict[str, Any]:
        """What it is made for; a layer is loaded for the same only."""
        return {
            "actions": list(self.body.action_names),
            "joints": list(self.body.independent_joints),
            "hands": list(self.hands),
            "step_s": self.step_s,
            "width": self.width,
        }

    def weights(self) -> Mapping[str, Tensor]:
        """What is learned; where the hands are follows from the body."""
        own = self.state_dict()
        return {name: own[name] for name in own if not name.startswith("chains.")}

    def take(self, weights: Mapping[str, Tensor]) -> None:
        """Take over :meth:`weights` of a layer of the same body, step and width."""
        self.load_state_dict({**self.state_dict(), **weights})
