"""Jacobians of a body's dynamics by finite differences, one body for each perturbation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.actuator_state import ActuatorState

FloatArray = NDArray[np.float64]

_ANGLE, _SPEED, _DRIVE = 1e-3, 1e-2, 0.03
"""Perturbations in rad (of a slide m), rad/s, and shares of the controls' ranges."""
_SAME = 0.1, 1.0
"""Who is less than this beside the angles, rad (of a slide m), and the speeds, rad/s, at which a
response was measured responds the same, but for the activations: muscles pull in proportion."""
_SLIGHT = 1e-5
"""Change of an angle, an activation or a control, where what follows is known in formulas."""


@dataclass(frozen=True)
class DynamicsState:
    """Where bodies are; N of them, or none of the leading axes for one.

    Attributes:
        qpos: (..., nq).
        qvel: (..., nv).
        act: (..., M) activations of the muscles.
        motor: (..., S) smoothed targets of motors.
    """

    qpos: FloatArray
    qvel: FloatArray
    act: FloatArray
    motor: FloatArray

    def times(self, n: int) -> DynamicsState:
        """The same for n bodies."""
        parts = (self.qpos, self.qvel, self.act, self.motor)
        return DynamicsState(*(np.repeat(part[None], n, 0) for part in parts))

    def row(self, i: int) -> DynamicsState:
        """That of body i."""
        return DynamicsState(self.qpos[i], self.qvel[i], self.act[i], self.motor[i])

    def put(self, bodies: UserBatch) -> None:
        """Put N bodies there."""
        bodies.set_motion(self.qpos, self.qvel, self.act, self.motor)

    @staticmethod
    def of(bodies: UserBatch) -> DynamicsState:
        """Where N bodies are now."""
        return DynamicsState(bodies.qpos, bodies.qvel, bodies.act, bodies.motor)


def motion_of(moment: DynamicsState, bodies: UserBatch) -> FloatArray:
    """(..., 2 J + M) angles and speeds of the independent joints, and activations."""
    body = bodies.body
    angles = moment.qpos[..., body.qpos_independent]
    speeds = moment.qvel[..., body.qvel_independent]
    return np.concatenate([angles, speeds, moment.act], -1)


@dataclass(frozen=True)
class Response:
    """A step about where it went: X numbers of motion, A controls, E errors of hands.

    Attributes:
        by_motion: (X, X) of the motion after it by that before.
        by_control: (X, A).
        error_by_motion: (E, X) of the errors after it, m.
        error_by_control: (E, A).
    """

    by_motion: FloatArray
    by_control: FloatArray
    error_by_motion: FloatArray
    error_by_control: FloatArray


@dataclass(frozen=True)
class _Measured:
    """What perturbations of a step came to.

    Attributes:
        point: (2 J,) angles and speeds there.
        moved: (2 J + A, X) change of the motion after it by each joint, speed and drive, where a
            muscle's is its activation and its control at once.
        errors: (2 J + A, E).
    """

    point: FloatArray
    moved: FloatArray
    errors: FloatArray


class Perturbations:
    """Finite differences of whole user steps.

    What an activation does, and what a muscle's control does, differ only by when in the step the
    muscle pulls, which its own dynamics say. So one body serves both: its activation and its
    control are perturbed together, and the difference is shared out.

    Args:
        many: makes N bodies such as the one that follows.
        misses: (bodies, step) -> (N, E) errors of the hands after that step, m, along each axis.
    """

    def __init__(
        self,
        many: Callable[[int], UserBatch],
        misses: Callable[[UserBatch, int], FloatArray],
    ) -> None:
        one = many(1)
        body = one.body
        self._drives = ActuatorState(body)
        self._joints = len(body.independent_joints)
        self._bodies = many(1 + 2 * self._joints + self._drives.count)
        self._misses = misses
        self._muscles = _Muscles(one, self._drives)
        self._same = np.repeat(_SAME, self._joints)
        self._known: dict[int, _Measured] = {}

    def response(
        self, moment: DynamicsState, shares: FloatArray, step: int, nearness: float = 1.0
    ) -> Response:
        """What a step from somewhere with (A,) controls, shares of their ranges, responds.

        Of a step that was measured before it is what was found then, if little has changed since,
        shared out anew between activations and controls.

        Args:
            moment: of one body.
            shares: (A,) controls.
            nearness: share of the usual distances up to which what was found counts.
        """
        point = motion_of(moment, self._bodies)[: 2 * self._joints]
        known = self._known.get(step)
        if known is None or (np.abs(point - known.point) > nearness * self._same).any():
            self._known[step] = known = _Measured(point, *self._measured(moment, shares, step))
        j, muscles = self._joints, self._drives.muscles
        size, count = 2 * j + len(muscles), self._drives.count
        by_motion, by_control = np.zeros((size, size)), np.zeros((size, count))
        by_motion[: 2 * j, : 2 * j] = known.moved[: 2 * j, : 2 * j].T
        by_control[: 2 * j] = known.moved[2 * j :, : 2 * j].T
        error_by_motion = np.zeros((known.errors.shape[1], size))
        error_by_motion[:, : 2 * j] = known.errors[: 2 * j].T
        error_by_control = known.errors[2 * j :].T.copy()
        if len(muscles):
            early, late, kept, taken = self._muscles.parts(moment.act, shares[muscles])
            for rows, part in ((slice(0, j), late), (slice(j, 2 * j), early)):
                both = by_control[rows][:, muscles]
                by_motion[rows, 2 * j :] = part * both
                by_control[rows, muscles] = (1.0 - part) * both
            both = error_by_control[:, muscles]
            error_by_motion[:, 2 * j :] = late * both
            error_by_control[:, muscles] = (1.0 - late) * both
            by_motion[2 * j :, 2 * j :] = np.diag(kept)
            by_control[np.arange(2 * j, size), muscles] = taken
        return Response(by_motion, by_control, error_by_motion, error_by_control)

    def forget_before(self, step: int) -> None:
        """Drop what was measured of earlier steps, which are done."""
        self._known = {known: found for known, found in self._known.items() if known >= step}

    def _measured(
        self, moment: DynamicsState, shares: FloatArray, step: int
    ) -> tuple[FloatArray, FloatArray]:
        bodies, j, muscles = self._bodies, self._joints, self._drives.muscles
        at, controls = moment.times(bodies.n), np.repeat(shares[None], bodies.n, 0)
        # (J, nv) how all joints move when one of the independent ones does.
        body = self._bodies.body
        angles = moment.qpos[body.qpos_independent]
        rows = np.concatenate([angles[None], angles + _SLIGHT * np.eye(self._joints)])
        full = body.coupled_qpos(rows)
        together = np.asarray((full[1:] - full[0]) / _SLIGHT)
        at.qpos[1 : 1 + j] += _ANGLE * together
        at.qvel[1 + j : 1 + 2 * j] += _SPEED * together
        drives = shares.copy()
        drives[muscles] = 0.5 * (shares[muscles] + moment.act)
        perturbations = np.where(drives > 0.5, -_DRIVE, _DRIVE)
        first = 1 + 2 * j
        controls[first:] += np.diag(perturbations)
        at.act[first + muscles, np.arange(len(muscles))] += perturbations[muscles]
        at.put(bodies)
        bodies.step(self._drives.actions(self._drives.of(bodies), controls))
        after, missed = motion_of(DynamicsState.of(bodies), bodies), self._misses(bodies, step)
        sizes = np.concatenate([np.full(j, _ANGLE), np.full(j, _SPEED), perturbations])[:, None]
        moved, errors = (after[1:] - after[0]) / sizes, (missed[1:] - missed[0]) / sizes
        broken = bodies.diverged[1:] | bodies.diverged[0]
        moved[broken], errors[broken] = 0.0, 0.0
        return moved, errors


class _Muscles:
    """MuJoCo's activation dynamics over a step (its documentation, "Muscle actuators")."""

    def __init__(self, one: UserBatch, drives: ActuatorState) -> None:
        model = one.body.physics_model
        names = one.body.action_names
        ids = np.array([model.actuator(names[i]).id for i in drives.muscles], dtype=np.int64)
        parameters = np.array(model.actuator_dynprm)[ids]
        self._rise, self._fall = parameters[:, 0], parameters[:, 1]
        self._substeps, self._substep_s = one.substeps, one.body.timestep

    def parts(
        self, act: FloatArray, control: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What of a muscle's pull in a step is owed to its activation before; the rest to control.

        Returns:
            (M,) each: the shares in what changes speeds (any time counts alike) and in what moves
            joints (early pulls count more), and the activation after by that before and by control.
        """
        now = np.stack([act, act + _SLIGHT, act])
        aim = np.stack([control, control, control + _SLIGHT])
        sums = np.zeros((2, *now.shape))
        for substep in range(self._substeps):
            weights = (1.0, self._substeps - substep - 0.5)
            sums += np.multiply.outer(weights, now)
            level = 0.5 + 1.5 * np.clip(now, 0.0, 1.0)
            time_s = np.where(aim > now, self._rise * level, self._fall / level)
            now = now + self._substep_s * (aim - now) / time_s
        own, others = sums[:, 1] - sums[:, 0], sums[:, 2] - sums[:, 0]
        early, late = own / (own + others)
        return early, late, (now[1] - now[0]) / _SLIGHT, (now[2] - now[0]) / _SLIGHT
