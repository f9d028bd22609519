"""Policies by kind: networks of this package, and classes of a Python file (``FILE.py:CLASS``)."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import nn

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.python_classes import words_of
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy
from sim2vr_harness.policies.protocol import (
    Observation,
    Policy,
    require_observation,
    shapes_in_words,
)
from sim2vr_harness.policies.store import TrainedUser
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic


class GaussianPolicy:
    """A network whose actions are normally distributed, acting on the CPU.

    Args:
        network: a :class:`VisualActorCritic` with trained weights.
    """

    def __init__(self, network: VisualActorCritic) -> None:
        self._network = network
        self._std = np.exp(network.log_std.detach().numpy())
        space = network.observation_space
        assert isinstance(space, spaces.Dict)
        self._wanted = {key: box.shape or () for key, box in space.spaces.items()}

    def __repr__(self) -> str:
        """Return the kind of network, what it observes and the size of its action."""
        network = type(self._network).__name__
        return (
            f"GaussianPolicy({network}: {shapes_in_words(self._wanted)}; {self._std.size} actions)"
        )

    def begin(self, n: int) -> None:
        """Return None: the network sees all that it acts on."""

    def restart(self, memory: Any, users: Sequence[int]) -> None:
        """Do nothing."""

    def act(
        self, observations: Observation, memory: Any, rngs: Sequence[np.random.Generator | None]
    ) -> NDArray[np.float32]:
        """Return the actions, (N, A) in [-1, 1].

        The network takes one user at a time: the last bits of matrix products depend on the number
        of rows.
        """
        first = {key: value[0] for key, value in observations.items()}
        require_observation(self._wanted, first)
        actions = np.empty((len(rngs), self._std.size), np.float32)
        for i, rng in enumerate(rngs):
            row = {key: torch.from_numpy(value[i : i + 1]) for key, value in observations.items()}
            with torch.no_grad():
                actions[i] = self._network.action_mean(row).numpy()[0]
            if rng is not None:
                actions[i] += self._std * rng.standard_normal(self._std.shape, dtype=np.float32)
        clipped: NDArray[np.float32] = np.clip(actions, -1.0, 1.0)
        return clipped

    def state_dict(self) -> dict[str, Any]:
        """Return the network's weights."""
        return self._network.state_dict()


def new_network(
    user: TrainedUser, observation_space: spaces.Dict, action_space: spaces.Box | None = None
) -> nn.Module:
    """Return a network of a trained user's kind with random weights, on the CPU.

    Args:
        action_space: of the simulation; None takes the user's own.
    """
    config = user.config
    # The weights drawn here are replaced at once; a training's random numbers are not touched.
    with torch.random.fork_rng(devices=[]):
        if config.policy_kind == "hierarchical":
            return PersonPolicy(config) if config.skills.people else HierarchicalPolicy(config)
        actions = action_space or user.env.action_space
        return VisualActorCritic(observation_space, actions, lambda _: 0.0, config=config.policy)


def load_policy(
    user: TrainedUser, observation_space: spaces.Dict, action_space: spaces.Box | None = None
) -> tuple[Policy, int]:
    """Return the policy of a trained user, on the CPU, and the user steps of its training.

    Args:
        action_space: of the simulation; None takes the user's own.

    Raises:
        InputError: The weights cannot be read, the network has other shapes, or the class of a
            Python file cannot be made.
    """
    if user.code is not None:
        policy = _of_code(user, observation_space, action_space or user.env.action_space)
        return policy, int(getattr(policy, "steps", 0))
    network = new_network(user, observation_space, action_space)
    steps = user.load(network)
    network.train(False)
    acts = GaussianPolicy(network) if isinstance(network, VisualActorCritic) else network
    return cast(Policy, acts), steps


def _of_code(user: TrainedUser, observation_space: spaces.Dict, action_space: spaces.Box) -> Policy:
    assert user.code is not None
    expected = f"a policy made by {user.code.__name__}(observation_space, action_space)"
    try:
        policy = user.code(observation_space, action_space)
    except Exception as error:
        got = f"{str(user.source)!r}, which cannot be made ({words_of(error)})"
        raise InputError("RUN", got, expected) from error
    if not isinstance(policy, Policy):
        needed = ("begin", "restart", "act", "state_dict")
        missing = [name for name in needed if not hasattr(policy, name)]
        raise InputError(
            "RUN", f"{str(user.source)!r} without {', '.join(missing)}", ", ".join(needed)
        )
    return policy
