"""The motor layer of a body: goals of its hands in, actions of its muscles or motors out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.users import Body, UserBatch, held
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.body_dynamics import mlp

GOAL_SIZE = 22
"""Numbers that a hand's goal has in an observation."""
_FAR_M, _FAST_MPS, _LATE_S = 0.3, 1.5, 0.5
"""Units of what is observed."""
WIDTH_M = 0.04
"""Width of targets whose own width is not known."""
WIDTHS_M = (0.01, 0.12)
"""Widths that human motor policies learn with: narrower or wider targets count as these."""
MOMENT_S = 0.005
"""Interval of the finite difference that gives velocities from positions, s."""


@dataclass
class MotorGoals:
    """Goals of B users' H hands.

    Attributes:
        tip: (B, H, 3) the point that is meant, in the device's frame (x forward, y left, z up), m.
        place: (B, H, 3) where it shall be.
        velocity: (B, H, 3) with which velocity, m/s.
        left_s: (B, H) in how long; what is over is requested at once.
        axis: (B, H, 3) where the device's x axis shall point then, a unit vector; 0: anywhere.
        active: (B, H) 1, or 0 for a hand that has nothing to do.
        width: (B, H) diameter of the target, m; plain layers do not know it.
        rays: (B, H) 1 for a hand of a person that turns its aim ray to the place. Its tip is the
            point of the ray that is as far away as the place.
        due_s: (B, H) in how long a hand of a person shall be there, s; NaN: when it likes.
    """

    tip: Tensor
    place: Tensor
    velocity: Tensor
    left_s: Tensor
    axis: Tensor
    active: Tensor
    width: Tensor
    rays: Tensor
    due_s: Tensor

    @staticmethod
    def none(users: int, hands: int) -> MotorGoals:
        """Hands that have nothing to do."""

        def zeros() -> Tensor:
            return torch.zeros(users, hands, 3)

        def plain() -> Tensor:
            return torch.zeros(users, hands)

        width = torch.full((users, hands), WIDTH_M)
        free = torch.full((users, hands), torch.nan)
        goals = (zeros(), zeros(), zeros(), plain(), zeros(), plain(), width, plain(), free)
        return MotorGoals(*goals)

    def tensors(self) -> dict[str, Tensor]:
        """Everything, by name."""
        return dict(vars(self))

    def put(self, users: Tensor, hand: Tensor, new: MotorGoals) -> None:
        """Replace the goals of K hands by K goals, (K, 1, ...)."""
        for name, values in new.tensors().items():
            changed = getattr(self, name).clone()
            changed[users, hand] = values[:, 0]
            setattr(self, name, changed)


def tips(place: Tensor, tip: Tensor) -> Tensor:
    """Return (B, H, 3) positions of points (B, H, 3) of devices at (B, H, 4, 4), m."""
    at: Tensor = place[..., :3, 3] + (place[..., :3, :3] @ tip[..., None])[..., 0]
    return at


def describe(goals: MotorGoals, place: Tensor, soon: Tensor) -> Tensor:
    """Return (B, H, GOAL_SIZE) the motor policy's observation of its goals.

    Args:
        place: (B, H, 4, 4) poses of the hands' devices.
        soon: their poses ``MOMENT_S`` later at constant velocity.
    """
    now = tips(place, goals.tip)
    velocity = (tips(soon, goals.tip) - now) / MOMENT_S
    left = goals.left_s.clamp(min=0.0)[..., None]
    way = goals.place - now
    forward = place[..., :3, 0]
    pointed = (goals.axis.abs().sum(-1, keepdim=True) > 0.0).float()
    turned = (place[..., :3, :3] @ goals.tip[..., None])[..., 0]
    parts = [
        way / _FAR_M,
        way / (left + 0.1) / _FAST_MPS,
        velocity / _FAST_MPS,
        goals.velocity / _FAST_MPS,
        turned / _FAR_M,
        left / _LATE_S,
        0.1 / (left + 0.1),
        (goals.axis - forward) * pointed,
        pointed,
        torch.ones_like(pointed),
    ]
    described = torch.cat(parts, -1) * goals.active[..., None]
    return described.clamp(-8.0, 8.0)


_CLIP = 8.0


class MotorPolicy(nn.Module):
    """A policy that brings hands to their goals.

    Args:
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
        """Return (B, size) observations; ``goals`` (B, H * GOAL_SIZE) as from :func:`describe`."""
        unit = 2.0 * (angles - self._low) / self._span - 1.0
        return torch.cat([unit, speeds, self.drives.observe(drives), goals], 1)

    def normalised(self, observation: Tensor) -> Tensor:
        """Return (B, size) observations, standardised by the usual mean and SD."""
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
        """Return (B, A) the actions of this user step, in [-1, 1]."""
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
        """Return the body, hands, step and width, which must match when weights are loaded."""
        return {
            "actions": list(self.body.action_names),
            "joints": list(self.body.independent_joints),
            "hands": list(self.hands),
            "step_s": self.step_s,
            "width": self.width,
        }

    def weights(self) -> Mapping[str, Tensor]:
        """Return the learned weights, without the kinematic chains, which follow from the body."""
        own = self.state_dict()
        return {name: own[name] for name in own if not name.startswith("chains.")}

    def take(self, weights: Mapping[str, Tensor]) -> None:
        """Load the :meth:`weights` of a policy for the same body, step and width."""
        self.load_state_dict({**self.state_dict(), **weights})


INSIDE = 0.94
"""Proportion of the joints' ranges from which postures are sampled."""
_COUNT = 20_000


def reachable_poses(layer: MotorPolicy, seed: int) -> Tensor:
    """(P, H, 4, 4) places of the hands' devices in postures drawn at random, world frame."""
    rng = np.random.default_rng([seed, 58])
    low, high = layer.body.joint_ranges.T
    spread = rng.uniform(-1.0, 1.0, (_COUNT, len(low)))
    angles = torch.from_numpy(0.5 * (low + high) + 0.5 * INSIDE * (high - low) * spread).float()
    with torch.no_grad():
        return layer.places(angles, torch.zeros_like(angles))[0]
