"""Simulated persons that no training has had, who move from one goal to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
from sim2vr_harness.training.motor_control.people_training import Bodies

FloatArray = NDArray[np.float64]
Part = TypeVar("Part")

SAMPLE_S = 0.01
"""Interval at which paths are sampled."""


def one_by_one(
    parts: Sequence[Callable[[], Part]], on_progress: Callable[[float], None]
) -> list[Part]:
    """Measure parts, and report the proportion that is done after each."""
    found = []
    for part in parts:
        found.append(part())
        on_progress(len(found) / len(parts))
    return found


class PersonCourse:
    """The same persons for all goals, each ``repeats`` times.

    Args:
        policy: what moves them.
        user: configuration with people.
        persons: number of persons.
        repeats: users of each.
        threads: of the physics; 0: all.
        seed: of persons, places and noise.
    """

    stream: int
    """Of the random numbers: its own for every kind of course."""

    def __init__(
        self,
        policy: HumanMotorPolicy,
        user: UserConfig,
        persons: int,
        repeats: int,
        threads: int,
        seed: int,
    ) -> None:
        self._policy, self._n, self._seed = policy, persons * repeats, seed
        self._rng = np.random.default_rng([seed, self.stream])
        bodies = self._bodies = Bodies(user, self._n, policy.step_s, threads)
        self._persons = [
            bodies.people.sample(seed + 7919, k) for k in range(persons) for _ in range(repeats)
        ]
        self._hand = 0  # the right one of two
        self._samples = round(policy.step_s / SAMPLE_S)

    def _who(self) -> NDArray[np.float64]:
        """(N, P) the persons in numbers."""
        bodies: Any = self._bodies
        return self._policy.persons.of(bodies)

    def _reset(self, postures: Sequence[FloatArray] | None, seeds: NDArray[np.int64]) -> None:
        """Let everyone be at rest in a posture; None: in that of the body."""
        rngs = [np.random.default_rng(int(seed)) for seed in seeds]
        self._bodies.users.reset(np.arange(self._n), rngs, postures, self._persons)

    def _poses(self, sample: int = -1) -> tuple[FloatArray, FloatArray]:
        """(N, 3) where hands are and (N, 4) how they are turned, at a sample of the last step."""
        return self._bodies.users.device_poses(self._policy.hands[self._hand], sample)

    def _of_hand(self, values: FloatArray) -> torch.Tensor:
        """(N, H, 3) of all hands, which are 0 beside the one that is measured (N, 3)."""
        every = torch.zeros(self._n, len(self._policy.hands), 3)
        every[:, self._hand] = torch.from_numpy(values).float()
        return every
