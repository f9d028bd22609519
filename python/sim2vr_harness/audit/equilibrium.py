"""Postures that the model's own muscles hold: static equilibrium as near to a place as possible.

Unknown are the joints' angles and the muscles' activations. Activations are a bounded least squares
problem in each posture; angles follow by Levenberg-Marquardt steps, with the activations between
their bounds left free to follow (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.population import Subject
from sim2vr_harness.users.bodies.moments import moment_arms
from sim2vr_harness.users.kinematics.bounded import bounded_least_squares
from sim2vr_harness.users.kinematics.forward import Linkage, Point

FloatArray = NDArray[np.float64]

NEAR_M = 0.02
"""So near counts as there, when it is acted out, too."""
_DEVICE = "controller_right"
_STEP = 1e-5
_PLACE_M = 0.01
"""Distance that counts as much as one unit of unbalanced torque."""
_UNIT = 10.0
"""Weight of torques, in the metric of kinetic energy."""
_EASE = 0.02
"""Weight of activations beside unbalanced torques."""
_AT_LIMIT = 1e-4
"""rad from a joint's limit within which it rests there."""
_SWING_NM = 12.0
"""So much torque may be lacking on the way, which the arm's swing makes up for (by acting it out,
290 pairs)."""
_LEFT_NM = 0.1
"""So much torque may stay unbalanced."""
_ARM_DEG = {"elv_angle": 60.0, "shoulder_elv": 60.0, "shoulder_rot": -20.0, "elbow_flexion": 90.0}
_LEANS_DEG = [
    [flexion, bending, rotation]
    for flexion in (5.0, 35.0)
    for bending, rotation in ((0.0, 0.0), (-20.0, -15.0), (20.0, 15.0))
]
"""Trunk and arm in postures from which the search goes on."""
_POINTS = 6
"""Of a path."""
_ITERATIONS = 20
_TRIES = 4
"""Steps at most, and dampings tried for each."""
_GAIN, _SMALL = 1e-3, 1e-2
"""The search ends when it gains less than this part of the cost, or of the second."""
_DAMPING, _LEAST, _MOST = 1e-2, 1e-7, 1e5
"""At first, and within these."""
_BOUND = 1e-9
"""Activations so near their bounds are at them."""


@dataclass(frozen=True)
class Balance:
    """What muscles do for a posture.

    Attributes:
        angles: (J,) of the independent joints.
        gap_m: Of the hand from the place.
        left_nm: Largest torque that stays unbalanced.
        way_nm: Largest torque that muscles lack on the way there; infinite: not near, or
            unbalanced.
        activations: (M,) of the muscles.
    """

    angles: FloatArray
    gap_m: float
    left_nm: float
    way_nm: float
    activations: FloatArray

    @property
    def balanced(self) -> bool:
        """Whether the posture is in equilibrium."""
        return self.left_nm <= _LEFT_NM

    def holds(self, close_m: float) -> bool:
        """Whether muscles bring the hand so near and hold it there."""
        return self.balanced and self.gap_m <= close_m and self.way_nm <= _SWING_NM

    def rank(self, close_m: float) -> tuple[bool, bool, float]:
        """Order of postures, the best first."""
        near = self.gap_m <= close_m
        return not (near and self.balanced), not near, self.way_nm if near else self.gap_m


class Balancer:
    """Finds postures of the right arm and trunk in static equilibrium.

    Args:
        subject: Whose muscles and trunk motors act.
        strength: Factor on both.
        load_kg: Mass in the hand, beside the controller's.
    """

    def __init__(self, subject: Subject, strength: float = 1.0, load_kg: float = 0.0) -> None:
        body = subject.body
        model = body.physics_model
        self._body, self._model, self._data = body, model, mujoco.MjData(model)
        self._strength, self._weight = strength, -load_kg * model.opt.gravity
        self._site = int(model.site(_DEVICE).id)
        self._muscles = np.array([model.actuator(name).id for name in body.muscles], dtype=int)
        chain = Linkage(body, Point(_DEVICE)).joints
        joints = body.independent_joints
        self._rest = np.array([body.reset_rule.posture.get(joint, 0.0) for joint in joints])
        # (S, J) postures with the elbow bent and the trunk leaning to several sides.
        leaning_body = self._body
        starts = np.repeat(self._rest[None], len(_LEANS_DEG), axis=0)
        for leaning_joint, degrees in _ARM_DEG.items():
            starts[:, leaning_body.independent_joints.index(leaning_joint)] = np.radians(degrees)
        for column, leaning_joint in enumerate(
            ("trunk_flexion", "trunk_bending", "trunk_rotation")
        ):
            starts[:, leaning_body.independent_joints.index(leaning_joint)] = np.radians(
                _LEANS_DEG
            )[:, column]
        self._starts = starts
        self.columns = np.array([joints.index(joint) for joint in chain])
        """(K,) of the joints that move the hand, among the independent ones."""
        self.limits = np.asarray(body.joint_ranges)[self.columns]
        """(K, 2) of these joints, rad."""
        self.motor_low, self.motor_high = np.zeros((2, len(chain)))
        for i, joint in enumerate(chain):
            if joint.startswith("trunk_"):
                span = strength * model.actuator(f"{joint}_motor").forcerange
                self.motor_low[i], self.motor_high[i] = span
        self.motors = int((self.motor_high > 0.0).sum())
        """How many of them motors move, within torques (K,) ``motor_low`` to ``motor_high``."""

    def holds(self, angles: FloatArray) -> bool:
        """Whether muscles bring the arm to a posture (J,) and hold it."""
        still = _State(self, np.array(angles), np.zeros(3)).left_nm <= _LEFT_NM
        return still and self._on_the_way(angles) <= _SWING_NM

    def search(self, place: FloatArray, postures: FloatArray, close_m: float) -> list[Balance]:
        """Return postures that the search found, the best first.

        It ends with the first that muscles bring near enough and hold.

        Args:
            place: (3,) MuJoCo's world, in the body's own frame, m.
            postures: (C, J) to begin with; leaning postures follow.
            close_m: How near is enough.
        """
        found: list[Balance] = []
        for start in (*postures, *self._starts):
            found.append(self.nearest(place, start, close_m))
            if found[-1].holds(close_m):
                break
        return sorted(found, key=lambda each: each.rank(close_m))

    def nearest(self, place: FloatArray, angles: FloatArray, close_m: float) -> Balance:
        """Return the equilibrium nearest to a place that is found from a posture (J,).

        Args:
            place: (3,) MuJoCo's world, in the body's own frame, m.
            angles: (J,) to begin with.
            close_m: How near is enough.
        """
        angles = np.array(angles, dtype=np.float64)
        angles[self.columns] = np.clip(angles[self.columns], *self.limits.T)
        state, damping = _State(self, angles, place), _DAMPING
        for _ in range(_ITERATIONS):
            if state.left_nm <= _LEFT_NM and state.gap_m <= 0.5 * close_m:
                break
            tried, damping = self._improved(state, place, damping)
            if tried is None:
                break
            gain, state = state.cost - tried.cost, tried
            if gain < _GAIN * max(tried.cost, _SMALL):
                break
        way = np.inf
        if state.left_nm <= _LEFT_NM and state.gap_m <= close_m:
            way = self._on_the_way(state.angles)
        return Balance(state.angles, state.gap_m, state.left_nm, way, state.activations)

    def _improved(
        self, state: _State, place: FloatArray, damping: float
    ) -> tuple[_State | None, float]:
        """Return the posture after a step, and the damping of the next; None: no step is better."""
        slope = state.slope()
        for _ in range(_TRIES):
            moved = state.angles[self.columns] + self._step(state, slope, damping)
            changed = state.angles.copy()
            changed[self.columns] = np.clip(moved, *self.limits.T)
            tried = _State(self, changed, place)
            if tried.cost < state.cost:
                return tried, max(0.2 * damping, _LEAST)
            damping = min(8.0 * damping, _MOST)
        return None, damping

    def _on_the_way(self, angles: FloatArray) -> float:
        """Largest torque that muscles lack on the straight way from rest to a posture."""
        parts = np.linspace(0.0, 1.0, _POINTS + 1)[1:, None]
        way = self._rest + parts * (angles - self._rest)
        return max(_State(self, each, np.zeros(3)).left_nm for each in way)

    def _step(self, state: _State, slope: FloatArray, damping: float) -> FloatArray:
        """Levenberg-Marquardt step, (K,); joints at limits do not go on."""
        q, (low, high) = state.angles[self.columns], self.limits.T
        free = np.ones(len(q), dtype=bool)
        step = np.zeros(len(q))
        for _ in range(3):
            part = slope[:, free]
            normal = part.T @ part + damping * np.eye(part.shape[1])
            step[:] = 0.0
            step[free] = -np.linalg.solve(normal, part.T @ state.error)
            below = (q + step < low) & (q <= low + _AT_LIMIT)
            out = below | ((q + step > high) & (q >= high - _AT_LIMIT))
            if not (out & free).any():
                break
            free &= ~out
        return step

    def mechanics(self, angles: FloatArray) -> _Mechanics:
        """Return what postures (P, J) ask for, and what muscles can do in them."""
        model, data = self._model, self._data
        count, k = len(angles), len(self.columns)
        slopes, coupled = self._slopes(angles), self._body.coupled_qpos(angles)
        hands, needed = np.zeros((count, 3)), np.zeros((count, k))
        effects = np.zeros((count, len(self._muscles), k))
        mass, push = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
        data.qvel[:] = 0.0
        for i in range(count):
            data.qpos[:] = coupled[i]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            slack, full = self._forces(0.0), self._forces(1.0)
            arms = moment_arms(self._model, self._data)[self._muscles] @ slopes[i]
            hands[i] = data.site_xpos[self._site]
            mujoco.mj_jacSite(model, data, push, None, self._site)
            torques = data.qfrc_bias - data.qfrc_passive + self._weight @ push
            needed[i] = torques @ slopes[i] - slack @ arms
            effects[i] = self._strength * (full - slack)[:, None] * arms
        mujoco.mj_fullM(model, data, mass)
        return _Mechanics(hands, needed, effects, slopes[-1].T @ mass @ slopes[-1])

    def _slopes(self, angles: FloatArray) -> FloatArray:
        """(P, nv, K) how all joints follow those that move the hand."""
        k = len(self.columns)
        shifts = np.zeros((k, angles.shape[1]))
        shifts[np.arange(k), self.columns] = _STEP
        coupled = self._body.coupled_qpos
        rise = coupled(angles[:, None] + shifts) - coupled(angles[:, None] - shifts)
        return np.swapaxes(rise, 1, 2) / (2.0 * _STEP)

    def _forces(self, activation: float) -> FloatArray:
        """(M,) of muscles that are all active alike."""
        self._data.act[:] = activation
        mujoco.mj_fwdActuation(self._model, self._data)
        return np.array(self._data.actuator_force)[self._muscles]


@dataclass(frozen=True)
class _Mechanics:
    """P postures of K joints and M muscles.

    Attributes:
        hands: (P, 3) where the hand is.
        needed: (P, K) torques against gravity and what is passive.
        effects: (P, M, K) torques of fully active muscles.
        inertia: (K, K) of the last posture.
    """

    hands: FloatArray
    needed: FloatArray
    effects: FloatArray
    inertia: FloatArray


class _State:
    """A posture with the activations that balance it best.

    Args:
        balancer: Whose muscles act.
        angles: (J,) of the independent joints.
        place: (3,) where the hand shall be.
    """

    def __init__(self, balancer: Balancer, angles: FloatArray, place: FloatArray) -> None:
        self.angles, self._by = angles, balancer
        found = balancer.mechanics(angles[None])
        others, needed = self._others(), found.needed[0] - balancer.motor_low
        muscles, pulling = len(found.effects[0]), np.concatenate([found.effects[0], others])
        scale = _UNIT * np.linalg.inv(np.linalg.cholesky(found.inertia))
        ease = _UNIT * _EASE * np.eye(muscles, len(pulling))
        high = np.ones(len(pulling))
        high[muscles + balancer.motors :] = np.inf
        part = bounded_least_squares(
            np.concatenate([scale @ pulling.T, ease]),
            np.concatenate([scale @ needed, np.zeros(muscles)]),
            high,
        )
        self.activations = part[:muscles]
        left, gap = needed - pulling.T @ part, found.hands[0] - place
        self.left_nm, self.gap_m = float(np.abs(left).max()), float(np.linalg.norm(gap))
        self.error = np.concatenate([scale @ left, gap / _PLACE_M])
        self.cost = float(self.error @ self.error)
        self._scale, free = scale, (part > _BOUND) & (part < high - _BOUND)
        self._following = scale @ pulling[free].T

    def _others(self) -> FloatArray:
        """(S, K) torques of the trunk's motors, from the lowest up, and of joints at limits."""
        by = self._by
        motors = np.diag(by.motor_high - by.motor_low)
        low, high = by.limits.T
        q = self.angles[by.columns]
        stops = (q <= low + _AT_LIMIT).astype(float) - (q >= high - _AT_LIMIT)
        return np.concatenate([motors[motors.any(axis=1)], np.diag(stops)[stops != 0.0]])

    def slope(self) -> FloatArray:
        """(K + 3, K) how unbalanced torques and the gap change with the angles."""
        by = self._by
        k = len(by.columns)
        around = np.repeat(self.angles[None], k + 1, axis=0)
        around[1 + np.arange(k), by.columns] += _STEP
        found = by.mechanics(around)
        left = found.needed - np.einsum("pmk,m->pk", found.effects, self.activations)
        rise = self._scale @ ((left[1:] - left[0]) / _STEP).T
        basis, sizes, _ = np.linalg.svd(self._following, full_matrices=False)
        basis = basis[:, sizes > 1e-6 * sizes.max(initial=1e-3)]
        rise -= basis @ (basis.T @ rise)
        return np.concatenate([rise, ((found.hands[1:] - found.hands[0]) / _STEP).T / _PLACE_M])
