"""Exertion of every arm in a round: NICER and Consumed Endurance, from the body's dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import Measure
from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.exertion import (
    ArmDynamics,
    ConsumedEnduranceMeter,
    NicerMeter,
    Strength,
    arms_of,
)

__all__ = ["ARM_MEASURES", "ExertionRecorder"]

_SIDES = ("right", "left")
_MODELS = {
    "nicer": ("NICER", "Time as a share of the arm's endurance, with recovery (Li et al. 2024)"),
    "consumed_endurance": (
        "Consumed Endurance",
        "Time as a share of the arm's endurance (Hincapie-Ramos et al. 2014)",
    ),
}

ARM_MEASURES = tuple(
    Measure(
        f"exertion.{name}_{side}",
        f"{label}, {side}",
        unit="%",
        better="lower",
        description=description,
    )
    for name, (label, description) in _MODELS.items()
    for side in _SIDES
)
"""At the end of a round; 100 is exhaustion. A body without that arm has none."""


class ExertionRecorder:
    """Follows the arms of N users through their rounds.

    Torques are those of inverse dynamics at the end of a user step, with the mean acceleration of
    the step. The published strength is multiplied by the person's strength.

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
        usual = 1.0 if users.who.people is not None else simulation.config.user.person.strength
        strength = Strength(factor=[usual * person.strength for person in users.persons])
        self._arms = arms_of(users.body)
        models = [users.who.body(i).physics_model for i in range(n)]
        self._dynamics = [[ArmDynamics(model, arm) for model in models] for arm in self._arms]
        self._nicer = [NicerMeter(n, strength) for _ in self._arms]
        self._consumed = [ConsumedEnduranceMeter(n, strength) for _ in self._arms]
        self._velocity = users.qvel

    def step(self, playing: NDArray[np.bool_]) -> None:
        """Add the step that the users have taken.

        Args:
            playing: (N,) whose round goes on; what becomes of the others does not matter.
        """
        if self._users is None:
            return
        users, dt = self._users, self._users.dt
        qpos, qvel = users.qpos, users.qvel
        qacc = (qvel - self._velocity) / dt
        self._velocity = qvel
        for dynamics, nicer, consumed in zip(
            self._dynamics, self._nicer, self._consumed, strict=True
        ):
            numbers = np.zeros((3, users.n))
            for i in np.flatnonzero(playing).tolist():
                load = dynamics[i].load(qpos[i], qvel[i], qacc[i])
                numbers[:, i] = load.torque, load.shoulder_deg, load.elbow_deg
            nicer.update(*numbers, dt)
            consumed.update(numbers[0], dt)

    def values(self, i: int) -> dict[str, float | None]:
        """Return the :data:`ARM_MEASURES` of user i's round so far."""
        found: dict[str, float | None] = {measure.name: None for measure in ARM_MEASURES}
        if self._users is not None:
            for arm, nicer, consumed in zip(self._arms, self._nicer, self._consumed, strict=True):
                found[f"exertion.nicer_{arm.side}"] = float(nicer.value[i])
                found[f"exertion.consumed_endurance_{arm.side}"] = float(consumed.value[i])
        return found
