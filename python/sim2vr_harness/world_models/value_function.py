"""Value function: the critic behind a window of imagined user steps."""

import copy
from collections.abc import Callable

import torch
from torch import Tensor, nn

from sim2vr_harness.base.state import State
from sim2vr_harness.world_models.body_dynamics import mlp

_PASSES, _BATCH = 4, 2048
_FOLLOW = 0.05
"""Update rate of the slow (target) critic towards the other one, per update."""
_SCALE = 10.0
"""Factor from the networks' outputs to values."""


class ValueFunction(State):
    """A critic that learns by TD(lambda), and a slow copy of it that windows end with.

    Args:
        size: of an observation.
        width: of the nets' two layers.
        normalise: (B, size) observations to (B, size) of about unit size. Both critics use it,
            as it is when they are asked.
        learning_rate: of Adam.
        gamma: discount of a user step.
        lam: lambda of TD(lambda).
    """

    _state = ("_value", "_slow", "_optimizer")

    def __init__(
        self,
        size: int,
        width: int,
        normalise: Callable[[Tensor], Tensor],
        *,
        learning_rate: float,
        gamma: float,
        lam: float,
    ) -> None:
        self._normalise, self._gamma, self._lam = normalise, gamma, lam
        self._value = mlp(size, width, width, 1)
        self._slow = copy.deepcopy(self._value).requires_grad_(False)
        self._optimizer = torch.optim.Adam(self._value.parameters(), lr=learning_rate)

    def __call__(self, observation: Tensor) -> Tensor:
        """(B,) values of observations (B, size), by the slow copy."""
        return self._worth(self._slow, observation)

    def _worth(self, net: nn.Module, observation: Tensor) -> Tensor:
        value: Tensor = _SCALE * net(self._normalise(observation))[:, 0]
        return value

    def learn(self, seen: Tensor, rewards: Tensor) -> None:
        """Fit to a window's returns.

        Args:
            seen: (T + 1, B, size) observations.
            rewards: (T, B).
        """
        steps, n = rewards.shape
        with torch.no_grad():
            values = self(seen.flatten(0, 1)).reshape(steps + 1, n)
            returns, following = torch.zeros_like(rewards), values[-1]
            for t in reversed(range(steps)):
                mixed = (1.0 - self._lam) * values[t + 1] + self._lam * following
                following = rewards[t] + self._gamma * mixed
                returns[t] = following
        known, worth = seen[:-1].flatten(0, 1), returns.flatten()
        for _ in range(_PASSES):
            rows = torch.randint(len(known), (min(_BATCH, len(known)),))
            loss = (self._worth(self._value, known[rows]) - worth[rows]).square().mean()
            self._optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self._value.parameters(), 50.0)
            self._optimizer.step()
        with torch.no_grad():
            pairs = zip(self._slow.parameters(), self._value.parameters(), strict=True)
            for slow, fast in pairs:
                slow.lerp_(fast, _FOLLOW)
