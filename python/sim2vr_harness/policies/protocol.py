"""The interface of everything that acts in an environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError

Observation = dict[str, NDArray[Any]]
"""Key of the observation space -> array (...), of one user."""


Shapes = Mapping[str, tuple[int, ...]]
"""Key of the observation space -> shape of one user's array."""


def shapes_in_words(shapes: Shapes) -> str:
    """Return shapes as ``proprioception (56,), vision (2, 80, 120)``, sorted by key."""
    return ", ".join(f"{key} {shapes[key]}" for key in sorted(shapes)) or "nothing"


def require_observation(wanted: Shapes, observation: Mapping[str, NDArray[Any]]) -> None:
    """Check that one user's observation has the arrays that a policy takes; it may have more.

    Raises:
        InputError: One is missing or has another shape.
    """
    got = {key: np.shape(value) for key, value in observation.items()}
    if any(got.get(key) != shape for key, shape in wanted.items()):
        raise InputError("observation", shapes_in_words(got), shapes_in_words(wanted))


@runtime_checkable
class Policy(Protocol):
    """Acts for simulated users, each on its own observation.

    A policy holds the state of no episode: what it remembers of one is its memory, which belongs to
    the caller. So one policy acts for many users, and the action of a user does not depend on how
    many others are simulated.
    """

    def reset(self) -> Any:
        """Return the memory of a user whose episode begins; None for policies without memory."""

    def act(
        self, observation: Observation, memory: Any, rng: np.random.Generator | None
    ) -> NDArray[np.float32]:
        """Return the action of one user, (A,) in [-1, 1].

        Args:
            observation: of this user.
            memory: of this user's episode, from :meth:`reset`; may be changed here.
            rng: draws a sample of the action; None takes the mean (deterministic).
        """

    def state_dict(self) -> Mapping[str, Any]:
        """Return the weights by name; empty for policies without weights."""


Act = Callable[[Observation, np.random.Generator | None], NDArray[np.float32]]
"""One user's observation and random numbers (None: deterministic) -> action, (A,)."""


@dataclass(frozen=True)
class FunctionPolicy:
    """A function as a policy, without memory and weights.

    Attributes:
        function: returns a user's action.
    """

    function: Act

    def reset(self) -> None:
        """Return None: there is nothing to remember."""

    def act(
        self, observation: Observation, memory: Any, rng: np.random.Generator | None
    ) -> NDArray[np.float32]:
        """Return the action of one user, (A,) in [-1, 1]."""
        return self.function(observation, rng)

    def state_dict(self) -> Mapping[str, Any]:
        """Return no weights."""
        return {}


def episode_of(policy: Policy) -> Act:
    """Return a function that acts for one user in one episode, with a memory of its own."""
    memory = policy.reset()
    return lambda observation, rng: policy.act(observation, memory, rng)
