"""Interfaces between simulations and the code that steps them."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from gymnasium import spaces
from numpy.typing import NDArray


class SimulationLike(Protocol):
    """The part of :class:`sim2vr_harness.envs.simulation.Simulation` that learners use."""

    n: int
    observation_space: spaces.Dict

    @property
    def action_space(self) -> spaces.Box[Any]:
        """Box(-1, 1, (A,))."""

    def reset(
        self,
        ids: Sequence[int] | None = None,
        seeds: Sequence[int | None] | None = None,
        options: Any = None,
    ) -> list[dict[str, Any]]:
        """Start new episodes."""

    def observation(self) -> dict[str, NDArray]:
        """Return fresh arrays (N, ...)."""

    def step(self, actions: NDArray) -> Any:
        """Advance every user by one step; returns a ``StepBatch``."""

    def state_dict(self) -> dict[str, NDArray]:
        """Return the exact state."""

    def load_state_dict(self, state: Mapping[str, Any]) -> list[int]:
        """Continue from :meth:`state_dict`; return the users whose rounds start again."""

    def close(self) -> None:
        """Free everything."""
