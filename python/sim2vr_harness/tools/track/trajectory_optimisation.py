"""Optimal control: which controls of all muscles bring hands nearest, and at the least effort.

A motor policy cuts fast strokes short, shifted goals do not change that, and it co-contracts
muscles. So stretches of what comes are planned ahead: the response of every step is measured
(:mod:`linearisation`). The controls that minimise squared errors and activations are found
backwards in time within their ranges, and tried in several sizes; the best is the next start. This
is control-limited differential dynamic programming
(Y. Tassa, N. Mansard, E. Todorov, ICRA 2014) without second derivatives of the dynamics. The plan's
feedback keeps the body to it. Like the correction of goals it needs to know what comes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import Body, UserBatch
from sim2vr_harness.world_models.actuator_state import ActuatorState

FloatArray = NDArray[np.float64]

AHEAD = 6
"""Steps before a recording begins in which the body may prepare for it: a stroke takes 0.3 s."""
_PLANNED, _DONE = 40, 15
"""Steps of a plan (horizon), and those of them that are executed before the next plan."""
_GOES = 16
"""Times at most that a stretch is planned."""
_ENOUGH = 0.02
"""Least improvement of a plan per iteration, as a share. After two smaller ones in a row, responses
that were measured a little beside the state are measured again; after another one, or later two in
a row, the plan is finished."""
_NEARER = 0.1
"""Factor on the distances up to which earlier measurements are used after that."""
_LOST_M = 0.1
"""Planned error along an axis, m, from which a second plan is computed from scratch: plans get
stuck in local minima."""
_FAR_M = 0.04
"""Error whose cost is 1.5 times its square; larger errors cost more, so that large errors matter
more than small ones."""
_EFFORT_M2 = 2e-3
"""Mean squared activation of 1 is worth this much squared error in every step."""
_STOP_M2 = 0.04
"""Cost in every step of a joint that is 1 rad (of a slide 1 m) within the margin of its limit: at
the limit, perturbations show no improvement."""
_MARGIN = 0.1
"""Margin of the stops, rad (of a slide m)."""
_CAUTION_M2 = 2.5e-3
"""Weight of a whole change of one control in a plan, at first: responses are of small ones."""
_LEAST_M2, _MOST_M2 = 2.5e-6, 2.5e-1
_CAUTIONS, _SIZES = (0.1, 1.0, 10.0, 100.0), (1.0, 0.4)
"""Shares of the caution, and of each plan's changes, that are tried."""
_DESCENT = 0.1
"""Least share of the promised decrease that a step within the box must keep (Armijo)."""


@dataclass
class _Plan:
    """A plan of K steps from a state.

    Attributes:
        moments: K + 1 states.
        motions: (K + 1, X) of them.
        shares: (K, A) controls.
        missed: (K, E) errors after each step, m.
        cost: m^2.
        feedback: (K, A, X) gains: change of controls by the deviation from the planned motion.
    """

    moments: list[DynamicsState]
    motions: FloatArray
    shares: FloatArray
    missed: FloatArray
    cost: float
    feedback: FloatArray


class _Costs:
    """Costs of a step besides the squared errors after it: effort, and joints at their limits."""

    def __init__(self, body: Body) -> None:
        low, high = body.joint_ranges.T
        margin = np.minimum(_MARGIN, 0.25 * (high - low))
        self._low, self._high = low + margin, high - margin
        self._joints = len(low)

    def of(self, motions: FloatArray) -> FloatArray:
        """(...,) of motions (..., X) after steps, m^2."""
        acts = motions[..., 2 * self._joints :]
        effort = (acts**2).mean(-1) if acts.shape[-1] else 0.0
        return np.asarray(_EFFORT_M2 * effort + _STOP_M2 * (self._beyond(motions) ** 2).sum(-1))

    def bend(self, motion: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(X,) each: slope at a motion, and the diagonal of the curve there."""
        j, muscles = self._joints, len(motion) - 2 * self._joints
        slope, curve = np.zeros(len(motion)), np.zeros(len(motion))
        if muscles:
            slope[2 * j :] = 2.0 * _EFFORT_M2 / muscles * motion[2 * j :]
            curve[2 * j :] = 2.0 * _EFFORT_M2 / muscles
        beyond = self._beyond(motion)
        slope[:j] = 2.0 * _STOP_M2 * beyond
        curve[:j] = 2.0 * _STOP_M2 * (beyond != 0.0)
        return slope, curve

    def _beyond(self, motions: FloatArray) -> FloatArray:
        """(..., J) how far angles are within the margins of their stops, rad; below: negative."""
        angles = motions[..., : self._joints]
        beyond = np.maximum(angles - self._high, 0.0) + np.minimum(angles - self._low, 0.0)
        return np.asarray(beyond)


class Refinement:
    """Trajectory optimisation of controls that bring hands nearer to their reference.

    Args:
        many: makes N copies of the tracking body.
        act: (bodies, step) -> (N, A) actions of the motor layer for the goals of that step; plans
            start from them.
        misses: (bodies, step) -> (N, E) errors of the hands after that step, m, along each axis.
        steps: of the whole recording.
    """

    def __init__(
        self,
        many: Callable[[int], UserBatch],
        act: Callable[[UserBatch, int], FloatArray],
        misses: Callable[[UserBatch, int], FloatArray],
        steps: int,
    ) -> None:
        self._act, self._misses, self._steps = act, misses, steps
        self._perturbations = Perturbations(many, misses)
        self._one, self._tried = many(1), many(len(_CAUTIONS) * len(_SIZES))
        self._drives, self._costs = ActuatorState(self._one.body), _Costs(self._one.body)
        self._plan: _Plan | None = None
        self._first = 0
        self._caution = _CAUTION_M2

    def action(self, users: UserBatch, step: int) -> FloatArray:
        """(1, A) actions of the one body that follows, in a step."""
        if self._plan is None or step >= self._first + _DONE:
            self._plan = self._best(DynamicsState.of(users).row(0), step)
            self._first = step
        k, plan = step - self._first, self._plan
        beside = motion_of(DynamicsState.of(users), users) - plan.motions[k]
        shares = plan.shares[k] + beside @ plan.feedback[k].T
        return self._drives.actions(self._drives.of(users), shares)

    def _best(self, start: DynamicsState, step: int) -> _Plan:
        """Return the plan from a step on: from the rest of the last one, or a new one if poor."""
        old = self._plan
        self._perturbations.forget_before(step)
        plan = self._planned(self._begun(start, step, old), step)
        if old is None or np.abs(plan.missed[:_DONE]).max() < _LOST_M:
            return plan
        self._caution = _CAUTION_M2
        afresh = self._planned(self._begun(start, step, None), step)
        return min(plan, afresh, key=lambda one: one.cost)

    def _planned(self, plan: _Plan, step: int) -> _Plan:
        """Return a plan after iterations until it hardly improves."""
        gained, nearness = True, 1.0
        for _ in range(_GOES):
            responses = [
                self._perturbations.response(plan.moments[k], plan.shares[k], step + k, nearness)
                for k in range(len(plan.shares))
            ]
            cautions = self._caution * np.array(_CAUTIONS)
            changes = [_changes(plan, responses, self._costs, one) for one in cautions]
            found, better = self._better(plan, changes, step)
            before, gained_before = plan.cost, gained
            if found.cost < plan.cost:
                plan = found
            else:
                better = len(cautions) - 1
            self._caution = float(np.clip(cautions[better], _LEAST_M2, _MOST_M2))
            gained = before - plan.cost > _ENOUGH * before
            if not (gained or gained_before):
                if nearness < 1.0:
                    break
                nearness = _NEARER
        return plan

    def _begun(self, start: DynamicsState, step: int, old: _Plan | None) -> _Plan:
        """Return the rest of the previous plan, followed by the motor layer's actions."""
        bodies = self._one
        left = 0 if old is None else len(old.shares) - _DONE

        def shares(k: int) -> FloatArray:
            now = self._drives.of(bodies)
            if old is not None and k < left:
                beside = motion_of(DynamicsState.of(bodies), bodies) - old.motions[_DONE + k]
                return old.shares[_DONE + k] + beside @ old.feedback[_DONE + k].T
            return self._drives.shares(now, self._act(bodies, step + k))

        count = min(_PLANNED, self._steps - step)
        return self._rolled(bodies, start, step, count, shares)[0]

    def _better(
        self, plan: _Plan, changes: list[tuple[FloatArray, FloatArray]], step: int
    ) -> tuple[_Plan, int]:
        """Return the best of the plans after several changes, and the index of its change."""
        bodies = self._tried
        steps = np.repeat([change[0] for change in changes], len(_SIZES), 0)
        steps *= np.tile(_SIZES, len(changes))[:, None, None]
        feedback = np.repeat([change[1] for change in changes], len(_SIZES), 0)

        def shares(k: int) -> FloatArray:
            beside = motion_of(DynamicsState.of(bodies), bodies) - plan.motions[k]
            return plan.shares[k] + steps[:, k] + np.einsum("nax,nx->na", feedback[:, k], beside)

        plans = self._rolled(bodies, plan.moments[0], step, len(plan.shares), shares)
        best = int(np.argmin([one.cost for one in plans]))
        plans[best].feedback = feedback[best]
        return plans[best], best // len(_SIZES)

    def _rolled(
        self,
        bodies: UserBatch,
        start: DynamicsState,
        step: int,
        count: int,
        shares: Callable[[int], FloatArray],
    ) -> list[_Plan]:
        """Simulate N bodies from the same state, with (N, A) controls for every step."""
        start.times(bodies.n).put(bodies)
        moments, controls, missed = [DynamicsState.of(bodies)], [], []
        for k in range(count):
            bodies.step(self._drives.actions(self._drives.of(bodies), shares(k)))
            moments.append(DynamicsState.of(bodies))
            controls.append(self._drives.controls(bodies))
            missed.append(self._misses(bodies, step + k))
        errors, done = np.stack(missed, 1), np.stack(controls, 1)
        motions = np.stack([motion_of(moment, bodies) for moment in moments], 1)
        costs = (_apart(errors)[0].sum(-1) + self._costs.of(motions[:, 1:])).sum(-1)
        costs[bodies.diverged] = np.inf
        shape = (count, done.shape[2], motions.shape[2])
        return [
            _Plan(
                [moment.row(i) for moment in moments],
                motions[i],
                done[i],
                errors[i],
                float(costs[i]),
                np.zeros(shape),
            )
            for i in range(bodies.n)
        ]


def _changes(
    plan: _Plan, responses: list[Response], costs: _Costs, caution: float
) -> tuple[FloatArray, FloatArray]:
    """(K, A) changes of controls, (K, A, X) feedback, that make a plan's cost least."""
    steps, actuators = plan.shares.shape
    size = plan.motions.shape[1]
    changes, feedback = np.zeros((steps, actuators)), np.zeros((steps, actuators, size))
    slope, curve = np.zeros(size), np.zeros((size, size))
    for k in reversed(range(steps)):
        own, bent = costs.bend(plan.motions[k + 1])
        slope, curve = slope + own, curve + np.diag(bent)
        one = responses[k]
        _, missed, bend = _apart(plan.missed[k])
        by_motion = missed @ one.error_by_motion + slope @ one.by_motion
        by_control = missed @ one.error_by_control + slope @ one.by_control
        onward = curve @ one.by_motion
        twice = bend[:, None] * one.error_by_motion
        motion2 = one.error_by_motion.T @ twice + one.by_motion.T @ onward
        cross = one.error_by_control.T @ twice + one.by_control.T @ onward
        control2 = one.error_by_control.T @ (bend[:, None] * one.error_by_control)
        control2 += one.by_control.T @ curve @ one.by_control
        careful = control2 + caution * np.eye(actuators)
        change, free = least_within(careful, by_control, -plan.shares[k], 1.0 - plan.shares[k])
        gain = np.zeros((actuators, size))
        if free.any():
            gain[free] = -np.linalg.solve(careful[np.ix_(free, free)], cross[free])
        changes[k], feedback[k] = change, gain
        slope = by_motion + gain.T @ (control2 @ change + by_control) + cross.T @ change
        curve = motion2 + gain.T @ control2 @ gain + gain.T @ cross + cross.T @ gain
        curve = 0.5 * (curve + curve.T)
    return changes, feedback


def _apart(errors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the cost of errors along each axis, m^2, with its first and second derivatives."""
    far = (errors / _FAR_M) ** 2
    return errors**2 * (1.0 + 0.5 * far), 2.0 * errors * (1.0 + far), 2.0 + 6.0 * far


def least_within(
    curve: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return x from low to high that minimises slope x + x curve x / 2, by projected Newton steps.

    Args:
        curve: (A, A) positive definite.
        low: (A,) at most 0.
        high: (A,) at least 0.

    Returns:
        (A,) x, and (A,) whether each is free, or held by its end.
    """
    x = np.clip(np.zeros(len(slope)), low, high)
    free = np.ones(len(slope), dtype=bool)
    for _ in range(30):
        ascent = slope + curve @ x
        free = ~(((x <= low + 1e-9) & (ascent > 0.0)) | ((x >= high - 1e-9) & (ascent < 0.0)))
        if not free.any():
            break
        ahead = np.zeros(len(slope))
        ahead[free] = -np.linalg.solve(curve[np.ix_(free, free)], ascent[free])
        before, size = slope @ x + 0.5 * x @ curve @ x, 1.0
        while True:
            tried = np.clip(x + size * ahead, low, high)
            after = slope @ tried + 0.5 * tried @ curve @ tried
            if after <= before + _DESCENT * ascent @ (tried - x) or size < 1e-6:
                break
            size *= 0.6
        if size < 1e-6 or before - after < 1e-9 * abs(before):
            break
        x = tried
    return x, free


# --- linearisation --------------------------------------------------------------------------------

_ANGLE, _SPEED, _DRIVE = 1e-3, 1e-2, 0.03
"""Perturbations in rad (of a slide m), rad/s, and shares of the controls' ranges."""
_SAME = 0.1, 1.0
"""Largest differences in the angles, rad (of a slide m), and in the speeds, rad/s, for which a
measured response is reused, except for the activations: muscles pull in proportion."""
_SLIGHT = 1e-5
"""Perturbation of an angle, an activation or a control for derivatives of known formulas."""


@dataclass(frozen=True)
class DynamicsState:
    """State of N bodies; without the leading axes, of one body.

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
        """Return the state of n bodies in this state."""
        parts = (self.qpos, self.qvel, self.act, self.motor)
        return DynamicsState(*(np.repeat(part[None], n, 0) for part in parts))

    def row(self, i: int) -> DynamicsState:
        """That of body i."""
        return DynamicsState(self.qpos[i], self.qvel[i], self.act[i], self.motor[i])

    def put(self, bodies: UserBatch) -> None:
        """Set N bodies to this state."""
        bodies.set_motion(self.qpos, self.qvel, self.act, self.motor)

    @staticmethod
    def of(bodies: UserBatch) -> DynamicsState:
        """Return the present state of N bodies."""
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
    """Effects of finite-difference perturbations of a step.

    Attributes:
        point: (2 J,) angles and speeds of the unperturbed state.
        moved: (2 J + A, X) change of the motion after it by each joint, speed and drive, where a
            muscle's is its activation and its control at once.
        errors: (2 J + A, E).
    """

    point: FloatArray
    moved: FloatArray
    errors: FloatArray


class Perturbations:
    """Finite differences of whole user steps.

    The effects of an activation and of a muscle's control differ only in the time at which the
    muscle pulls within the step, which its own dynamics determine. Therefore one body serves both:
    its activation and its control are perturbed together, and the difference is divided.

    Args:
        many: makes N copies of the tracking body.
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
        """Return the response of a step from a state with (A,) controls, as shares of their ranges.

        If the step was measured before and little has changed since, the earlier measurement is
        used, divided anew between activations and controls.

        Args:
            moment: of one body.
            shares: (A,) controls.
            nearness: factor on the distances up to which an earlier measurement is used.
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
        """Delete measurements of earlier steps, which are done."""
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
        """Return the shares of a muscle's pull in a step that are due to its earlier activation.

        The rest is due to its control.

        Returns:
            (M,) each: the shares in the change of speeds (all times have the same weight) and in
            the movement of joints (early pulls weigh more), and the derivatives of the activation
            after the step by the one before and by the control.
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
