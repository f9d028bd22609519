"""Exertion of every arm in a round: NICER and Consumed Endurance, from the body's dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.evaluation.metrics import ARM_MEASURES
from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.exertion import (
    ArmDynamics,
    ConsumedEnduranceMeter,
    NicerMeter,
    Strength,
    arm_loads,
    arms_of,
)

FloatArray = NDArray[np.float64]

_TOGETHER = 256
"""User steps whose dynamics are worked out in one go at most."""


class ExertionRecorder:
    """Follows the arms of N users through their rounds.

    Torques are those of inverse dynamics at the end of a user step, with the mean acceleration of
    the step. The published strength is that of the person's sex, times the person's strength
    relative to the median of that sex.

    Args:
        simulation: whose rounds have begun. Stand-ins without a
            :class:`~sim2vr_harness.users.batch.UserBatch` have no arms.
    """

    def __init__(self, simulation: Any) -> None:
        users = getattr(simulation, "users", None)
        self._users = users if isinstance(users, UserBatch) else None
        if self._users is None:
            return
        users, n = self._users, self._users.n
        people = users.who.people
        if people is None:
            own = [Strength(factor=simulation.config.user.person.strength)] * n
        else:
            own = [people.shoulder(person) for person in users.persons]
        strength = Strength(
            np.array([each.man for each in own]), np.array([each.factor for each in own])
        )
        self._arms = arms_of(users.body)
        models = [users.who.body(i).physics_model for i in range(n)]
        # One for all users of a model: its memory stays in the caches.
        dynamics = {id(model): ArmDynamics(model, *self._arms) for model in models}
        self._dynamics = [dynamics[id(model)] for model in models]
        self._nicer = [NicerMeter(n, strength) for _ in self._arms]
        self._consumed = [ConsumedEnduranceMeter(n, strength) for _ in self._arms]
        self._steps: list[tuple[list[int], FloatArray, FloatArray, FloatArray]] = []
        self._velocity, self._dt = users.qvel, users.dt

    def step(self, playing: NDArray[np.bool_]) -> None:
        """Add the step that the users have taken.

        Args:
            playing: (N,) whose round goes on; what becomes of the others does not matter.
        """
        if self._users is None or not self._arms:
            return
        qpos, qvel = self._users.qpos, self._users.qvel
        qacc = (qvel - self._velocity) / self._dt
        self._velocity = qvel
        self._steps.append((np.flatnonzero(playing).tolist(), qpos, qvel, qacc))
        if len(self._steps) == _TOGETHER:
            self._update()

    def _update(self) -> None:
        """Add the steps since the last call, together: code and model stay in the caches."""
        if not self._steps:
            return
        moments = np.zeros((len(self._steps), len(self._velocity), len(self._arms), 18))
        for own, (ids, *motion) in zip(moments, self._steps, strict=True):
            for i in ids:
                own[i] = self._dynamics[i].moments(*(each[i] for each in motion))
        self._steps.clear()
        loads = np.stack(arm_loads(moments))
        for arm, (nicer, consumed) in enumerate(zip(self._nicer, self._consumed, strict=True)):
            torque, shoulder, elbow = loads[..., arm]
            nicer.update(torque, shoulder, elbow, self._dt)
            consumed.update(torque, self._dt)

    def values(self, i: int) -> dict[str, float | None]:
        """Return the ``ARM_MEASURES`` of user i's round so far."""
        found: dict[str, float | None] = {measure.name: None for measure in ARM_MEASURES}
        if self._users is not None:
            self._update()
            for arm, nicer, consumed in zip(self._arms, self._nicer, self._consumed, strict=True):
                found[f"exertion.nicer_{arm.side}"] = float(nicer.value[i])
                found[f"exertion.consumed_endurance_{arm.side}"] = float(consumed.value[i])
        return found
