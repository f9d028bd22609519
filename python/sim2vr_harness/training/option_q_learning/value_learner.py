"""Learning of action values from remembered decisions: double Q-learning with n-step returns.

What hands decide adds up to what the user gets (Sunehag et al. 2018, value decomposition). The
network chooses what is best next, a slow copy says what that is worth (van Hasselt et al. 2016).
"""

import copy
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from sim2vr_harness.base.state import State
from sim2vr_harness.policies.hierarchical.action_selection import OptionScene, best_choices
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.training.option_q_learning.minibatch import N_STEP, draw_decisions
from sim2vr_harness.training.replay import ReplayStore

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
SCENE = ("pictures", "head", "turned", "tips", "velocities")
"""What a scene is made of, in the order of its fields."""
LEARNING_RATE = 1e-3
"""Adam's usual rate."""
PARTS = 2
"""Parts of a batch, whose gradients are computed in parallel."""
_GAMMA = 0.85
"""Discount factor per decision: rewards follow within about 7 decisions."""
_BATCH_SIZE = 64
"""Decisions per minibatch; all shipped users learned from as many."""
_KEPT_DECISIONS = 24_000
"""Size of the replay buffer."""
_TARGET_RATE = 0.01
"""Rate at which the target network follows."""
_TRUSTED_PERCENTILE = 99.0
_TIMED = 3


class ValueLearner(State):
    """Learns the values of options from what N users decided, and what came of it.

    Args:
        net: the network; changed.
        decisions: decisions of all users, in order.
        rng: draws minibatches.
        users: N.
    """

    _state = ("slow", "optimizer", "scale", "since")

    def __init__(
        self,
        net: ActionValueMap,
        decisions: ReplayStore,
        rng: np.random.Generator,
        users: int,
    ) -> None:
        self.net, self.decisions, self._rng = net, decisions, rng
        self._n = users
        self.slow = copy.deepcopy(net).requires_grad_(False)
        """The target network."""
        self.optimizer = torch.optim.Adam(net.parameters(), LEARNING_RATE, fused=True)
        self.since = 0
        """First decision that counts."""
        self.scale = 1.0
        """What rewards are divided by."""
        self.corrected = 0.0
        """Exponent of the importance weights: 0 at first, 1 at the end (Schaul et al. 2016)."""

    def settle_scale(self) -> None:
        """Let a good decision be worth about 1."""
        if self.scale != 1.0:
            return
        known = np.abs(self.decisions.read("game_reward", np.arange(self.decisions.count)))
        known = known[known > 0.0]
        self.scale = float(np.percentile(known, _TRUSTED_PERCENTILE)) if len(known) else 1.0

    def learn(self, updates: int, rate: float, each: Map) -> float:
        """Return the loss of the last of so many updates; NaN of none.

        Args:
            updates: how many.
            rate: at which it learns.
            each: maps over the parts of an update, in turn or in parallel.
        """
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        loss = float("nan")
        for _ in range(updates if self.decisions.count - self.since > N_STEP else 0):
            loss = self._update(each)
        return loss

    def _update(self, each: Map) -> float:
        """One step of learning, from a batch that is always parted alike."""
        memory = self.decisions
        have = min(memory.count - self.since, max(N_STEP + 1, _KEPT_DECISIONS // self._n))
        first = memory.count - have
        rewarded = memory.read("game_reward", np.arange(first, memory.count - 1)) > 0.0
        rows, users, odds = draw_decisions(rewarded, _BATCH_SIZE, self._rng)
        found = self._shares(first + rows, users, odds**self.corrected, each)
        self.optimizer.zero_grad()
        for parameter, *shares in zip(
            self.net.parameters(), *(grads for _, grads in found), strict=True
        ):
            parameter.grad = sum(shares[1:], shares[0]).contiguous()
        nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimizer.step()
        with torch.no_grad():
            for slow, fast in zip(self.slow.parameters(), self.net.parameters(), strict=True):
                slow.lerp_(fast, _TARGET_RATE)
        return sum(loss for loss, _ in found)

    def _shares(
        self,
        rows: NDArray[np.int64],
        users: NDArray[np.int64],
        weights: NDArray[np.float64],
        each: Map,
    ) -> list[tuple[float, tuple[Tensor, ...]]]:
        """What the parts of a batch add to the mean loss, and to its gradients."""
        parts = np.array_split(np.arange(len(rows)), min(PARTS, len(rows)))
        return list(each(lambda i: self._gradients(rows[i], users[i], weights[i]), parts))

    def _gradients(
        self, rows: NDArray[np.int64], users: NDArray[np.int64], weights: NDArray[np.float64]
    ) -> tuple[float, tuple[Tensor, ...]]:
        """What decisions add to the mean loss of a batch, and to its gradients.

        Args:
            rows: (K,) of the memory.
            users: (K,) whose.
            weights: (K,) of their losses.
        """
        memory = self.decisions
        total, weight, last, known = self.returns(rows, users)
        then = self._scene(last, users)
        with torch.no_grad():
            seen = then.inputs(self.net)
            best = best_choices(self.net.values(*seen), then.something, self.net.options)
            worth = self._worth(self.slow.values(*seen), best)
            wanted = torch.from_numpy(total) + torch.from_numpy(weight) * worth
        scene = self._scene(rows, users)
        chosen = torch.from_numpy(memory.read("chosen", rows, users))
        guessed = self._worth(self.net.values(*scene.inputs(self.net)), chosen)
        losses = functional.smooth_l1_loss(guessed, wanted, reduction="none")
        loss = (losses * torch.from_numpy(weights * known).float()).sum() / _BATCH_SIZE
        return float(loss.detach()), torch.autograd.grad(loss, tuple(self.net.parameters()))

    def returns(
        self, rows: NDArray[np.int64], users: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64], NDArray[np.bool_]]:
        """Add up what follows decisions (K,) of users (K,), until a value stands for the rest.

        A round that is cut off goes on in principle, and what was seen then is not kept: the value
        is that of the last decision before, and a decision in which a round was cut off teaches
        nothing.

        Returns:
            (K,) rewards, weights of the value, rows whose scenes have it, and whether that is
            known.
        """
        total, weight = np.zeros(len(rows), np.float32), np.ones(len(rows), np.float32)
        last, left = rows + N_STEP, np.ones(len(rows), bool)
        for k in range(N_STEP):
            at = (rows + k, users)
            cut = left & self.decisions.read("cut", *at)
            last[cut] = rows[cut] + k
            left &= ~cut
            reward = self.decisions.read("reward", *at) / self.scale
            total[left] += (weight * reward)[left]
            weight[left] *= _GAMMA
            over = left & self.decisions.read("over", *at)
            weight[over] = 0.0
            left &= ~over
        return total, weight, last, last > rows

    def _scene(self, rows: NDArray[np.int64], users: NDArray[np.int64]) -> OptionScene:
        """What was seen in decisions (K,) of users (K,)."""
        pictures, *others = (self.decisions.read(name, rows, users) for name in SCENE)
        seen = (pictures.transpose(0, 3, 1, 2), *others)
        return OptionScene(self.net.sight, *(torch.from_numpy(each) for each in seen))

    @staticmethod
    def _worth(values: Tensor, chosen: Tensor) -> Tensor:
        """(N,) what choices (N, H) of all hands are worth together."""
        return values.gather(-1, chosen[..., None])[..., 0].sum(1)
