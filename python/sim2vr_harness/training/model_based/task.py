"""The interface of a task to the model-based training."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.state import State
from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.body_dynamics import BodyModel
from sim2vr_harness.world_models.learning_device import Part
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import TransitionStore


class Task(State, ABC):
    """A game model's rounds, or goals of hands.

    N simulated users in MuJoCo take the user steps that the body model is fitted to. B imagined
    users are what the policy learns from. Observations are (B, size), actions (B, A).
    """

    policy: nn.Module
    """What learns."""
    actor: Sequence[nn.Parameter]
    """The policy's weights that gradients move."""
    body: BodyModel
    users: ImaginedUsers
    parts: Sequence[Part]
    """What imagined user steps change, beside the users."""
    starts: int
    """Starts of all imagined users before the first update; 0: they continue from the rest pose,
    and the policy has its statistics of observations already."""
    recent_per_early: int
    """Start states of the last cycles for each of the first cycle, whose states are everywhere."""
    warm_up: int = 0
    """User steps after a start until an observation's past is the user's own."""
    batch: UserBatch
    """The simulated users."""
    rng: np.random.Generator
    """Of what simulated users do, noise on the actions included."""
    random_size: tuple[float, float]
    """Smallest and largest standard deviation of random actions; drawn per user."""
    success_rates: tuple[float, ...] = ()
    """Of the simulated users in the last collection, by condition; NaN: not known."""

    # --- simulated users ---------------------------------------------------------------------

    @abstractmethod
    def begin_collecting(self, *, randomly: bool) -> None:
        """Start episodes, or continue those that were; those of random actions are short."""

    def stagger(self) -> None:
        """Spread the episodes' ends over time."""

    def motion(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return angles (rad), speeds (rad/s), (N, J) each, and drives (N, A)."""
        users = self.batch
        joints, dofs = users.body.qpos_independent, users.body.qvel_independent
        return users.qpos[:, joints], users.qvel[:, dofs], self.body.drives.of(users)

    @abstractmethod
    def policy_actions(self) -> NDArray[Any]:
        """Return the policy's (N, A) mean actions."""

    @abstractmethod
    def simulate(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[Any], NDArray[Any]]:
        """Advance by one user step.

        Returns:
            (N,) whether the user step can be learned from; (N,) whether the episode is over; (N, P)
            persons and (N, F) privileged numbers after it.
        """

    @abstractmethod
    def restart(self, ids: NDArray[np.int64]) -> None:
        """Start new episodes of simulated users (K,)."""

    def end_collecting(self) -> None:
        """Measure what was done since :meth:`begin_collecting`."""

    # --- a cycle -----------------------------------------------------------------------------

    def begin_cycle(self, cycle: int) -> None:
        """Set how difficult this cycle is, the first being 0."""

    def calibrate(self, steps: TransitionStore) -> None:
        """Fit what the task has to know of the tools to the user steps of the first cycle."""

    def begin_updates(self, pool: TransitionStore) -> None:
        """Take note of the states that imagined users start from in this cycle."""

    @abstractmethod
    def report(
        self, cycle: int, updates: int, success_rates: tuple[float, ...], place_error_m: float
    ) -> Any:
        """Return what the cycle that has just ended was like, and adapt the next one to it.

        Args:
            cycle: its number, from 1.
            updates: of the policy so far.
            success_rates: of its simulated users, by condition.
            place_error_m: of the body model, mean over devices, in one user step.
        """

    # --- imagined users ----------------------------------------------------------------------

    def place(self, steps: TransitionStore) -> Tensor:
        """(K, D, 4, 4) where the devices were after user steps."""
        with torch.no_grad():
            place: Tensor = self.body.places(steps.after.angles, steps.after.persons)
        return place

    @abstractmethod
    def start(self, ids: Tensor, pool: TransitionStore, rows: Tensor) -> None:
        """Let imagined users ``ids`` (K,) continue from rows (K,) of the pool, or better ones.

        Rows are on the CPU, where random numbers are cheap one by one.
        """

    @abstractmethod
    def observe(self) -> Tensor:
        """Return what the policy observes."""

    @abstractmethod
    def present(self) -> Tensor:
        """Return the same without delays, for the critic."""

    @abstractmethod
    def normalise(self, observations: Tensor) -> None:
        """Set the policy's statistics of observations by (K, size) of them."""

    @abstractmethod
    def action_mean(self, observation: Tensor) -> Tensor:
        """Return the policy's mean actions."""

    @abstractmethod
    def step(self, actions: Tensor, done: float) -> Tensor:
        """Return the (B,) rewards of the user step that the imagined users have just taken.

        Args:
            actions: that they took.
            done: proportion of the training that is over; rewards may be relaxed at first.
        """

    @abstractmethod
    def cut(self) -> None:
        """Detach the present from what led to it."""
