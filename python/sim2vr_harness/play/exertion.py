"""Exertion of every arm and fatigue of every muscle in a round.

NICER and Consumed Endurance come from the body's dynamics.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.play.fatigue import FATIGUE, PARTS, SIDES, split_side
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round
from sim2vr_harness.users import Body
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
_TIRING = "cumulative_fatigue_3ccr"
"""The effort model with motor units that tire."""
_LEAST_ARM_M = 1e-5
"""A smaller moment arm is rounding."""
_POSTURES = 8
"""Drawn from the joints' ranges, beside their middle: an arm may vanish in one posture."""
_STEP = 1e-4
"""Of a joint, for the difference of lengths; rad, slides m."""


class ExertionRecorder(Watcher):
    """Follows the arms of N users through their rounds; a body without an arm has no values of it.

    Torques are those of inverse dynamics at the end of a user step, with the mean acceleration of
    the step. The published strength is that of the participant's sex, times the own strength
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
        self._groups, self._users = None, users
        if isinstance(users, UserBatch) and "max_MF" in users.effort.state_dict():
            self._groups = fatigue_groups(users.body)

    def measured(self, index: int, result: Round) -> Round:
        """Add the measures of fatigue."""
        if self._users is None or self._groups is None:
            return result
        worst = self._users.effort.state_dict()["max_MF"][index]
        parts = self._groups.part_names
        return replace(result.with_values(self._groups.values(worst)), fatigue_parts=parts)


@dataclass(frozen=True)
class FatigueGroups:
    """Muscles of a body that fatigue, and the body parts that they move.

    Attributes:
        muscles: (L,) names of the muscles or motors, in the order of the effort model.
        parts: Body part -> (K,) indices of the muscles that cross one of its joints. A part with
            two sides has an entry for both together and one for each.
    """

    muscles: tuple[str, ...]
    parts: Mapping[str, NDArray[np.int64]]

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the measures of body parts."""
        return tuple(f"{FATIGUE}{name}" for name in self.parts)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the measures, those of body parts first."""
        return (*self.part_names, *(f"{FATIGUE}{name}" for name in self.muscles))

    def values(self, worst: NDArray[np.floating[Any]]) -> dict[str, float]:
        """Return each measure's value, of (L,) largest shares of fatigued motor units."""
        means = [float(worst[members].mean()) for members in self.parts.values()]
        return dict(zip(self.names, [*means, *worst.tolist()], strict=True))


def fatigue_groups(body: Body) -> FatigueGroups:
    """Return what tires of a body, grouped by :func:`muscles_by_part`."""
    muscles = (*body.muscles, *body.effort_inputs.loads)
    parts = muscles_by_part(body, muscles)
    return FatigueGroups(muscles, {part: parts[part] for part in parts if part not in muscles})


def muscles_by_part(body: Body, muscles: Sequence[str]) -> dict[str, NDArray[np.int64]]:
    """Group muscles and motors by the joints that each has a moment arm at.

    Args:
        body: Has them all.
        muscles: Names of L muscles or motors.

    Returns:
        Body part -> (K,) indices of what crosses one of its joints; a muscle may be in several.
        Where there are two sides, a part of both comes with ``PART_r`` and ``PART_l``.
    """
    parts: dict[str, set[int]] = {}
    crossed = _moment_arms(body, muscles) > _LEAST_ARM_M
    joints = [split_side(joint) for joint in body.independent_joints]
    both = {side for _, side in joints if side} == set(SIDES)
    for (stem, side), column in zip(joints, crossed.T, strict=True):
        part = PARTS.get(stem, stem)
        for name in (part, f"{part}{side}") if both and side else (part,):
            parts.setdefault(name, set()).update(np.flatnonzero(column).tolist())
    return {name: np.array(sorted(members)) for name, members in parts.items() if members}


def fatigue_names(env: ResolvedEnv) -> tuple[str, ...]:
    """Return the names of a user's measures of fatigue; none without a model of fatigue."""
    return fatigue_groups(env.body).names if env.config.user.effort.model == _TIRING else ()


def _moment_arms(body: Body, muscles: Sequence[str]) -> NDArray[np.float64]:
    """(L, J) the largest moment arms at independent joints, couplings included; m."""
    model = body.physics_model
    data = mujoco.MjData(model)
    rows = [model.actuator(name).id for name in muscles]
    low, high = body.joint_ranges.T

    def lengths(q: NDArray[np.float64]) -> NDArray[np.float64]:
        data.qpos[:] = body.coupled_qpos(q)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        mujoco.mj_transmission(model, data)
        return np.array(data.actuator_length[rows])

    shares = np.random.default_rng(1).random((_POSTURES, len(low)))
    largest = np.zeros((len(rows), len(low)))
    for q in (0.5 * (low + high), *(low + shares * (high - low))):
        for joint, step in enumerate(np.eye(len(low)) * _STEP):
            arms = np.abs(lengths(q + step) - lengths(q - step)) / (2.0 * _STEP)
            largest[:, joint] = np.maximum(largest[:, joint], arms)
    return largest
