"""A trained user who plays: the saved policy, acting for one body at a time."""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.envs.config import body_of
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy, Intention
from sim2vr_harness.policies.protocol import Act
from sim2vr_harness.policies.store import TrainedUser
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic

__all__ = ["PolicyRunner", "new_policy"]


def new_policy(
    user: TrainedUser, observation_space: spaces.Dict, action_space: spaces.Box | None = None
) -> VisualActorCritic | HierarchicalPolicy:
    """A network as the user's, with weights that mean nothing yet; on the CPU."""
    # The weights drawn here are replaced at once; a training's random numbers are not touched.
    with torch.random.fork_rng(devices=[]):
        if user.config.decides:
            return HierarchicalPolicy(user.config)
        if action_space is None:
            size = body_of(user.config.env.user).action_size
            action_space = spaces.Box(-1.0, 1.0, (size,), np.float32)
        return VisualActorCritic(
            observation_space, action_space, lambda _: 0.0, config=user.config.policy
        )


class PolicyRunner:
    """The policy of a trained user, on the CPU.

    Each body is asked for by itself: what a round's user does must not depend, not even in the
    last bit, on how many rounds are played side by side.

    Args:
        user: Who plays.
        observation_space: Of the simulation.
        action_space: Of the simulation; None takes the user's own.

    Raises:
        InputError: The weights cannot be read, or its network has other shapes.
    """

    def __init__(
        self,
        user: TrainedUser,
        observation_space: spaces.Dict,
        action_space: spaces.Box | None = None,
    ) -> None:
        self._policy = new_policy(user, observation_space, action_space)
        self.step = user.load(self._policy)
        self._policy.train(False)
        self._std = np.exp(self._policy.log_std.detach().numpy())

    def for_a_round(self) -> Act:
        """What the user does in one round, of which it may remember something."""
        return partial(self.act, intention=self.begin())

    def begin(self) -> Intention | None:
        """What a user intends whose round begins; None of one who remembers nothing."""
        return self._policy.begin() if isinstance(self._policy, HierarchicalPolicy) else None

    def act(
        self,
        observation: dict[str, NDArray],
        rng: np.random.Generator | None,
        *,
        intention: Intention | None = None,
    ) -> NDArray[np.float32]:
        """Return the action of one user, (A,) in [-1, 1].

        Args:
            observation: key -> (...), of one user.
            rng: Draws the deviation from the mean; None takes the mean (deterministic).
            intention: Of :meth:`begin`, of this user's round; changed here. None of who remembers
                nothing.
        """
        if isinstance(self._policy, HierarchicalPolicy):
            assert intention is not None
            return self._policy.act(observation, intention)
        batch = {key: torch.from_numpy(value[None]) for key, value in observation.items()}
        with torch.no_grad():
            action = self._policy.action_mean(batch).numpy()[0]
        if rng is not None:
            action = action + self._std * rng.standard_normal(action.shape, dtype=np.float32)
        clipped: NDArray[np.float32] = np.clip(action, -1.0, 1.0).astype(np.float32)
        return clipped
