"""What a round costs the body: exertion of every arm, fatigue of every muscle.

NICER and Consumed Endurance come from the body's dynamics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.play.fatigue import fatigue_groups
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round
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


class ExertionRecorder(Watcher):
    """Follows the arms of N users through their rounds; a body without an arm has no values of it.

    Torques are those of inverse dynamics at the end of a user step, with the mean acceleration of
    the step. The published strength is that of the person's sex, times the person's strength
    relative to the median of that sex.
    """

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Follow the arms anew; stand-ins without a :class:`UserBatch` have none."""
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
        self._playing = list(range(n))

    def stepped(self, reward: NDArray[Any], infos: Sequence[Mapping[str, Any]]) -> None:
        """Add the step of the users whose rounds go on."""
        if self._users is None or not self._arms:
            return
        qpos, qvel = self._users.qpos, self._users.qvel
        qacc = (qvel - self._velocity) / self._dt
        self._velocity = qvel
        self._steps.append((list(self._playing), qpos, qvel, qacc))
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

    def measured(self, index: int, result: Round) -> Round:
        """Add the :data:`ARM_MEASURES`."""
        if self._users is None:
            return result
        self._playing.remove(index)
        self._update()
        found: dict[str, float | None] = {}
        for arm, nicer, consumed in zip(self._arms, self._nicer, self._consumed, strict=True):
            found[f"exertion.nicer_{arm.side}"] = float(nicer.value[index])
            found[f"exertion.consumed_endurance_{arm.side}"] = float(consumed.value[index])
        return result.with_values(found)


class FatigueRecorder(Watcher):
    """Adds the largest fatigue of each muscle and body part, where a model of fatigue runs."""

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Group the muscles of the users."""
        users = getattr(simulation, "users", None)
        tires = isinstance(users, UserBatch) and "max_MF" in users.effort.state()
        self._users = users if tires else None
        self._groups = fatigue_groups(users.body) if tires else None

    def measured(self, index: int, result: Round) -> Round:
        """Add the measures of fatigue."""
        if self._users is None or self._groups is None:
            return result
        worst = self._users.effort.state()["max_MF"][index]
        parts = self._groups.part_names
        return replace(result.with_values(self._groups.values(worst)), fatigue_parts=parts)
