"""User steps of the true game, which the body model is fitted to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.policies.state_actor_critic import TeacherPolicy
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.training.teacher.env import TeacherSimulation
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.transitions import TransitionStore

__all__ = ["Collector"]

_WILD_SECONDS = 1.0
"""Length of an episode of random actions: long enough to leave its start."""
_WILD_KEEP = (0.0, 0.6, 0.9)
"""Of the noise from one user step to the next, when users move at random; by user."""
_WILD_LEAST, _WILD_MOST = 0.05, 0.8
_RETURN = 0.3
"""Actuators drift back to where they rest, by this share a user step."""


class Collector:
    """Lets users of the true game act, and notes what happens.

    Args:
        config: of the imagined rollouts.
        policy: who acts.
        simulation: the users; their rounds go on from one call to the next.
        persons: how they stand in tensors.
        seed: of everything drawn here.
    """

    def __init__(
        self,
        config: ImaginedConfig,
        policy: TeacherPolicy,
        simulation: TeacherSimulation,
        persons: ImaginedPersons,
        *,
        seed: int,
    ) -> None:
        self.config, self.policy, self.simulation = config, policy, simulation
        self.rng = np.random.default_rng([seed, 91])
        self.started = False
        self._seed = seed
        self._drives = ActuatorState(simulation.simulation.body)
        self._persons = persons

    def play(
        self, steps: int, *, wildly: bool, on_progress: Callable[[float], None]
    ) -> tuple[TransitionStore, tuple[float, ...]]:
        """Take user steps with everybody.

        Args:
            steps: how many.
            wildly: move about at random, in short episodes, instead of acting by the policy.
            on_progress: called with the share of the steps that is taken.

        Returns:
            The user steps, those that ended an episode left out; and the rate of successes of every
            condition, NaN where nothing came up or users moved at random.
        """
        sim = self.simulation
        self._begin(wildly)
        counts = _Counts(sim)
        users = sim.simulation.users
        wild = np.zeros((sim.n, self._drives.count))
        rest = self._drives.rest(self._drives.of(users))
        keep = self.rng.choice(_WILD_KEEP, (sim.n, 1))
        size = self.rng.uniform(_WILD_LEAST, _WILD_MOST, (sim.n, 1))
        columns = [sim.senses.names.index(name) for name in sim.game.fields]
        rows: list[tuple[NDArray[Any], ...]] = []
        for step in range(steps):
            on_progress(step / steps)
            before = self._motion()
            if wildly:
                wild = keep * wild + np.sqrt(1.0 - keep**2) * self.rng.standard_normal(wild.shape)
                actions = size * wild + _RETURN * (rest - before[-1])
            else:
                mean = self.policy.act(sim.observation(), None)
                noise = self.rng.standard_normal(mean.shape)
                actions = mean + self.config.action_noise * noise
            result = sim.step(actions)
            control = self._drives.controls(users)  # motor noise included
            ended = result.over
            fields = sim.senses.values()[:, columns]
            kept = ~ended & ~users.diverged
            who = self._persons.of(sim.simulation)
            rows.append(tuple(a[kept] for a in (*before, control, *self._motion(), who, fields)))
            over = [int(i) for i in np.flatnonzero(ended)]
            counts.add(over)
            if over:  # with new logs, which begin with 0
                sim.reset(over)
                rest[over] = self._drives.rest(self._drives.of(users))[over]
        counts.add(range(sim.n))
        if wildly:
            sim.explore(None)
        parts = [
            torch.tensor(np.concatenate(column), dtype=torch.float32)
            for column in zip(*rows, strict=True)
        ]
        return TransitionStore.of(parts), counts.rates(known=not wildly)

    def _begin(self, wildly: bool) -> None:
        sim = self.simulation
        if not self.started:
            seeds = np.random.SeedSequence([self._seed, 93]).generate_state(sim.n, np.uint32)
            sim.reset(seeds=[int(seed) for seed in seeds])
            self.started = True
        if wildly:
            sim.explore(_WILD_SECONDS)

    def _motion(self) -> tuple[NDArray[Any], ...]:
        users = self.simulation.simulation.users
        joints, dofs = users.body.qpos_independent, users.body.qvel_independent
        return users.qpos[:, joints], users.qvel[:, dofs], self._drives.of(users)


class _Counts:
    """Successes and failures by condition, from now on."""

    def __init__(self, simulation: TeacherSimulation) -> None:
        self._sim = simulation
        self._sums = np.zeros((2, len(simulation.conditions)))
        self._add(range(simulation.n), -1.0)  # what was before does not count

    def add(self, users: Any) -> None:
        """Take in the rounds of these users, as far as they are."""
        self._add(users, 1.0)

    def _add(self, users: Any, sign: float) -> None:
        logs = self._sim.simulation.logs
        for user in users:
            outcomes = self._sim.game.outcomes(logs[user]).sum(axis=1)
            self._sums[:, self._sim.condition_of(user)] += sign * outcomes

    def rates(self, *, known: bool) -> tuple[float, ...]:
        """Share of successes, by condition."""
        shown = self._sums.sum(0)
        rates = np.where(shown > 0.0, self._sums[0] / np.maximum(shown, 1.0), np.nan)
        return tuple(map(float, rates if known else np.full_like(rates, np.nan)))
