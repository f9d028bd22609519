"""The interface of everything that acts in an environment."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError

Observation = dict[str, NDArray[Any]]
"""Key of the observation space -> array, (...) of one user or (N, ...) of N users."""


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
    """Acts for N simulated users, each on its own observation.

    A policy holds the state of no episode: what it remembers of them is its memory, which belongs
    to the caller. The action of a user does not depend on how many others are simulated.
    """

    def begin(self, n: int) -> Any:
        """Return the memory of N users whose episodes begin; None for policies without memory."""

    def restart(self, memory: Any, users: Sequence[int]) -> None:
        """Reset the memory of these users, by their rows, for new episodes."""

    def act(
        self,
        observations: Observation,
        memory: Any,
        rngs: Sequence[np.random.Generator | None],
    ) -> NDArray[np.float32]:
        """Return the actions, (N, A) in [-1, 1].

        Args:
            observations: key -> (N, ...).
            memory: of the users' episodes, from :meth:`begin`; may be changed here.
            rngs: of each user, draws a sample of its action; None takes the mean (deterministic).
        """

    def state_dict(self) -> Mapping[str, Any]:
        """Return the weights by name; empty for policies without weights."""


Act = Callable[[Observation, np.random.Generator | None], NDArray[np.float32]]
"""One user's observation and random numbers (None: deterministic) -> action, (A,)."""


@dataclass(frozen=True)
class FunctionPolicy:
    """A function of one user's observation as a policy, without memory and weights."""

    function: Act

    def begin(self, n: int) -> None:
        """Return None: there is nothing to remember."""

    def restart(self, memory: Any, users: Sequence[int]) -> None:
        """Do nothing."""

    def act(
        self, observations: Observation, memory: Any, rngs: Sequence[np.random.Generator | None]
    ) -> NDArray[np.float32]:
        """Return what the function returns for each user, (N, A)."""
        each = [
            self.function({key: value[i] for key, value in observations.items()}, rng)
            for i, rng in enumerate(rngs)
        ]
        return np.stack(each).astype(np.float32)

    def state_dict(self) -> Mapping[str, Any]:
        """Return no weights."""
        return {}
