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
from scipy.optimize import lsq_linear

from sim2vr_harness.audit.population import Subject
from sim2vr_harness.users.kinematics.forward import Linkage, Point

__all__ = ["NEAR_M", "Balance", "Balancer"]

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
_DAMPING, _LEAST, _MOST = 1e-2, 1e-7, 1e5


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
        self._columns = np.array([body.independent_joints.index(joint) for joint in chain])
        self._low, self._high = np.asarray(body.joint_ranges)[self._columns].T
        motors = [(i, f"{joint}_motor") for i, joint in enumerate(chain) if joint[:5] == "trunk"]
        joints = body.independent_joints
        self._rest = np.array([body.reset_rule.posture.get(joint, 0.0) for joint in joints])
        self._starts = self._leaning()
        self._motored = np.array([i for i, _ in motors], dtype=int)
        ranges = np.array([model.actuator(name).forcerange for _, name in motors])
        self._motor_low, self._motor_high = strength * ranges.reshape(-1, 2).T

    def hand(self, angles: FloatArray) -> FloatArray:
        """(3,) where a posture (J,) has the hand, in the body's own frame, m."""
        self._data.qpos[:] = self._body.coupled_qpos(angles)
        mujoco.mj_kinematics(self._model, self._data)
        return np.array(self._data.site_xpos[self._site])

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

    def _leaning(self) -> FloatArray:
        """(S, J) postures with the elbow bent and the trunk leaning to several sides."""
        body = self._body
        starts = np.repeat(self._rest[None], len(_LEANS_DEG), axis=0)
        for joint, degrees in _ARM_DEG.items():
            starts[:, body.independent_joints.index(joint)] = np.radians(degrees)
        for column, joint in enumerate(("trunk_flexion", "trunk_bending", "trunk_rotation")):
            starts[:, body.independent_joints.index(joint)] = np.radians(_LEANS_DEG)[:, column]
        return starts

    def nearest(self, place: FloatArray, angles: FloatArray, close_m: float) -> Balance:
        """Return the equilibrium nearest to a place that is found from a posture (J,).

        Args:
            place: (3,) MuJoCo's world, in the body's own frame, m.
            angles: (J,) to begin with.
            close_m: How near is enough.
        """
        angles = np.array(angles, dtype=np.float64)
        angles[self._columns] = np.clip(angles[self._columns], self._low, self._high)
        state = _State(self, angles, place)
        damping = _DAMPING
        for _ in range(_ITERATIONS):
            if state.left_nm <= _LEFT_NM and state.gap_m <= 0.5 * close_m:
                break
            slope, error = state.slope(), state.error
            for _ in range(4):
                step = self._step(state, slope, error, damping)
                changed = angles.copy()
                moved = angles[self._columns] + step
                changed[self._columns] = np.clip(moved, self._low, self._high)
                tried = _State(self, changed, place)
                if tried.cost < state.cost:
                    break
                damping = min(8.0 * damping, _MOST)
            else:
                break
            gain = state.cost - tried.cost
            damping = max(0.2 * damping, _LEAST)
            angles, state = changed, tried
            if gain < 1e-3 * max(tried.cost, 1e-2):
                break
        way = np.inf
        if state.left_nm <= _LEFT_NM and state.gap_m <= close_m:
            way = self._on_the_way(angles)
        return Balance(angles, state.gap_m, state.left_nm, way, state.activations)

    def _on_the_way(self, angles: FloatArray) -> float:
        """Largest torque that muscles lack on the straight way from rest to a posture."""
        parts = np.linspace(0.0, 1.0, _POINTS + 1)[1:, None]
        way = self._rest + parts * (angles - self._rest)
        return max(_State(self, each, np.zeros(3)).left_nm for each in way)

    def _step(
        self, state: _State, slope: FloatArray, error: FloatArray, damping: float
    ) -> FloatArray:
        """Levenberg-Marquardt step, (K,); joints at limits do not go on."""
        q = state.angles[self._columns]
        free = np.ones(len(q), dtype=bool)
        step = np.zeros(len(q))
        for _ in range(3):
            part = slope[:, free]
            normal = part.T @ part + damping * np.eye(part.shape[1])
            step[:] = 0.0
            step[free] = -np.linalg.solve(normal, part.T @ error)
            out = ((q + step < self._low) & (q <= self._low + _AT_LIMIT)) | (
                (q + step > self._high) & (q >= self._high - _AT_LIMIT)
            )
            if not (out & free).any():
                break
            free &= ~out
        return step

    def mechanics(self, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where the hand is (P, 3), torques needed (P, K) and effects (P, M, K) of postures."""
        body, model, data, by = self._body, self._model, self._data, _STEP
        count, k = len(angles), len(self._columns)
        shifts = np.zeros((2 * k, angles.shape[1]))
        shifts[np.arange(k), self._columns] = by
        shifts[k + np.arange(k), self._columns] = -by
        coupled = body.coupled_qpos(angles)
        around = body.coupled_qpos(angles[:, None] + shifts)
        slopes = np.swapaxes(around[:, :k] - around[:, k:], 1, 2) / (2.0 * by)
        hands = np.zeros((count, 3))
        needed, effects = np.zeros((count, k)), np.zeros((count, len(self._muscles), k))
        moments, push = np.zeros((model.nu, model.nv)), np.zeros((3, model.nv))
        data.qvel[:] = 0.0
        for i in range(count):
            data.qpos[:] = coupled[i]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            data.act[:] = 0.0
            mujoco.mj_fwdActuation(model, data)
            slack = np.array(data.actuator_force)[self._muscles]
            data.act[:] = 1.0
            mujoco.mj_fwdActuation(model, data)
            full = np.array(data.actuator_force)[self._muscles]
            mujoco.mju_sparse2dense(
                moments,
                data.actuator_moment,
                data.moment_rownnz,
                data.moment_rowadr,
                data.moment_colind,
            )
            arms = moments[self._muscles] @ slopes[i]
            hands[i] = data.site_xpos[self._site]
            mujoco.mj_jacSite(model, data, push, None, self._site)
            torques = data.qfrc_bias - data.qfrc_passive + self._weight @ push
            needed[i] = torques @ slopes[i] - slack @ arms
            effects[i] = self._strength * (full - slack)[:, None] * arms
        return hands, needed, effects

    def inertia(self, angles: FloatArray) -> FloatArray:
        """(K, K) of the joints in the posture that was computed last, which is this one."""
        mass = np.zeros((self._model.nv, self._model.nv))
        mujoco.mj_fullM(self._model, self._data, mass)
        k, by = len(self._columns), _STEP
        shifts = np.zeros((k, len(angles)))
        shifts[np.arange(k), self._columns] = by
        slope = (
            self._body.coupled_qpos(angles + shifts) - self._body.coupled_qpos(angles - shifts)
        ).T / (2.0 * by)
        return np.asarray(slope.T @ mass @ slope)


class _State:
    """A posture with its best activations."""

    def __init__(self, balancer: Balancer, angles: FloatArray, place: FloatArray) -> None:
        self.angles, self._place, self._by = angles, place, balancer
        hands, needed, effects = balancer.mechanics(angles[None])
        self._scale = _UNIT * np.linalg.inv(np.linalg.cholesky(balancer.inertia(angles)))
        k, m = len(needed[0]), len(effects[0])
        motored = balancer._motored
        span = balancer._motor_high - balancer._motor_low
        motors = np.zeros((len(motored), k))
        motors[np.arange(len(motored)), motored] = span
        offset = np.zeros(k)
        offset[motored] = balancer._motor_low
        q = angles[balancer._columns]
        stops = np.diag(
            (q <= balancer._low + _AT_LIMIT).astype(float)
            - (q >= balancer._high - _AT_LIMIT).astype(float)
        )
        stops = stops[np.abs(stops).sum(axis=1) > 0.0]
        self._others = np.concatenate([motors, stops])
        pulls = self._scale @ np.concatenate([effects[0], self._others]).T
        ease = np.zeros((m, pulls.shape[1]))
        ease[:, :m] = _UNIT * _EASE * np.eye(m)
        target = self._scale @ (needed[0] - offset)
        high = np.ones(pulls.shape[1])
        high[m + len(motored) :] = np.inf
        found = lsq_linear(
            np.concatenate([pulls, ease]),
            np.concatenate([target, np.zeros(m)]),
            bounds=(np.zeros(len(high)), high),
            method="bvls",
        ).x
        self._found, self._m = found, m
        self.activations = found[:m]
        self._free = (found > 1e-9) & (found < high - 1e-9)
        self._pulls = pulls
        self._hand = hands[0]
        left = needed[0] - offset - np.concatenate([effects[0], self._others]).T @ found
        self.left_nm = float(np.abs(left).max())
        self.gap_m = float(np.linalg.norm(hands[0] - place))
        self.error = np.concatenate([self._scale @ left, (hands[0] - place) / _PLACE_M])
        self.cost = float(self.error @ self.error)

    def slope(self) -> FloatArray:
        """(K + 3, K) how unbalanced torques and the gap change with the angles."""
        by, k = _STEP, len(self._by._columns)
        changed = np.repeat(self.angles[None], k, axis=0)
        changed[np.arange(k), self._by._columns] += by
        hands, needed, effects = self._by.mechanics(
            np.concatenate([self.angles[None], changed])
        )
        left = needed - np.einsum("pmk,m->pk", effects, self.activations)
        rise = self._scale @ ((left[1:] - left[0]) / by).T
        basis, sizes, _ = np.linalg.svd(self._pulls[:, self._free], full_matrices=False)
        basis = basis[:, sizes > 1e-6 * max(float(sizes[0]) if len(sizes) else 1.0, 1e-9)]
        rise -= basis @ (basis.T @ rise)
        return np.concatenate([rise, ((hands[1:] - hands[0]) / by).T / _PLACE_M])
