"""What a state is worth: the critic behind a window of imagined user steps."""

from __future__ import annotations

import copy
from typing import Any

import torch
from torch import Tensor, nn

from sim2vr_harness.training.imagined.body import mlp
from sim2vr_harness.training.knowledge import OBSERVATION
from sim2vr_harness.training.teacher_config import ImaginedConfig
from sim2vr_harness.training.teacher_policy import TeacherPolicy

__all__ = ["Critic"]

_PASSES, _BATCH = 4, 2048
_FOLLOW = 0.05
"""How fast the slow critic follows the other one, per update."""


class _Value(nn.Module):
    """Value of an observation, of the relaxed reward."""

    def __init__(self, policy: TeacherPolicy, size: int, width: int) -> None:
        super().__init__()
        self._normalise = [policy.normaliser]  # not a part of this module
        self._net = mlp(size, width, width, 1)

    def forward(self, observation: Tensor) -> Tensor:
        value: Tensor = 10.0 * self._net(self._normalise[0]({OBSERVATION: observation}))[:, 0]
        return value


class Critic:
    """A critic that learns by TD(lambda), and a slow copy of it that windows end with.

    Args:
        config: of the imagined rollouts.
        policy: whose normalisation of observations is shared.
        size: of an observation.
    """

    def __init__(self, config: ImaginedConfig, policy: TeacherPolicy, size: int) -> None:
        self.config = config
        self._value = _Value(policy, size, config.critic_width)
        self._slow = copy.deepcopy(self._value).requires_grad_(False)
        self._optimizer = torch.optim.Adam(self._value.parameters(), lr=config.critic_learning_rate)

    def __call__(self, observation: Tensor) -> Tensor:
        """(B,) values of observations (B, size), by the slow copy."""
        value: Tensor = self._slow(observation)
        return value

    def learn(self, seen: Tensor, rewards: Tensor) -> None:
        """Fit to a window's returns.

        Args:
            seen: (T + 1, B, size) observations.
            rewards: (T, B).
        """
        config = self.config
        steps, n = rewards.shape
        with torch.no_grad():
            values = self._slow(seen.flatten(0, 1)).reshape(steps + 1, n)
            returns, following = torch.zeros_like(rewards), values[-1]
            for t in reversed(range(steps)):
                mixed = (1.0 - config.lam) * values[t + 1] + config.lam * following
                following = rewards[t] + config.gamma * mixed
                returns[t] = following
        known, worth = seen[:-1].flatten(0, 1), returns.flatten()
        for _ in range(_PASSES):
            rows = torch.randint(len(known), (min(_BATCH, len(known)),))
            loss = (self._value(known[rows]) - worth[rows]).square().mean()
            self._optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self._value.parameters(), 50.0)
            self._optimizer.step()
        with torch.no_grad():
            pairs = zip(self._slow.parameters(), self._value.parameters(), strict=True)
            for slow, fast in pairs:
                slow.lerp_(fast, _FOLLOW)

    def state(self) -> dict[str, Any]:
        """Everything that its future depends on."""
        return {
            "value": self._value.state_dict(),
            "slow": self._slow.state_dict(),
            "optimizer": self._optimizer.state_dict(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state`."""
        self._value.load_state_dict(state["value"])
        self._slow.load_state_dict(state["slow"])
        self._optimizer.load_state_dict(state["optimizer"])
