"""Muscle activations that accelerate the joints as wanted: a body for those who think in joints.

A learner that has to find strokes with 32 muscles explores 32 numbers, most of which fight each
other. Here it wants accelerations of the 7 independent joints, and the least activations that
bring them about are computed from the model: moment arms, force-length and force-velocity curves,
inertia, gravity and passive forces of the present posture. Nothing is added to the physics: what
comes out are activations as any policy can choose them.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.users.batch import UserBatch

__all__ = ["JointDrive"]

FloatArray = NDArray[np.float64]

_NEWTON_STEPS = 8
_SINGULAR_MPS2 = 2.0
"""Where the scaled joints move the device by less than this, it is not forced to follow."""


class JointDrive:
    """Turns wanted joint accelerations into activations, for every user of a batch.

    Minimises ``effort * |a|^2 + |acceleration(a) - wanted|^2`` over activations a in [0, 1], both
    accelerations in units of ``scale``. What the muscles cannot do stays undone.

    Args:
        batch: the users; from now on it also computes velocity-dependent quantities at the end of
            every step.
        scale_radps2: (J,) unit of acceleration of every independent joint, rad/s^2.
        effort: how much the activations' squares count.
    """

    def __init__(self, batch: UserBatch, scale_radps2: ArrayLike, *, effort: float = 0.02) -> None:
        self._batch = batch
        model = batch.user.physics_model
        self._joints = batch.user.qvel_independent
        self.scale_radps2 = np.asarray(scale_radps2, dtype=np.float64)
        if self.scale_radps2.shape != self._joints.shape:
            raise ValueError(
                f"scale_radps2: got shape {self.scale_radps2.shape}, expected "
                f"({len(self._joints)},), one per independent joint"
            )
        self._effort = effort
        self._moment = batch.live("actuator_moment")
        self._inertia = batch.live("M")
        self._bias, self._passive = batch.live("qfrc_bias"), batch.live("qfrc_passive")
        self._length = batch.live("actuator_length")
        self._axis, self._anchor = batch.live("xaxis"), batch.live("xanchor")
        batch.compute_velocities()  # fills what was bound above
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._moment_rows = np.repeat(np.arange(model.nu), data.moment_rownnz)
        self._moment_columns = data.moment_colind.copy()
        self._triangle = np.tril_indices(model.nv)
        self._curves = _Curves(model)

    @property
    def size(self) -> int:
        """Number of independent joints J."""
        return len(self._joints)

    def activations(self, wanted_radps2: ArrayLike) -> FloatArray:
        """Return the activations for wanted accelerations in the present state.

        Args:
            wanted_radps2: (N, J), in the order of ``user.independent_joints``.

        Returns:
            (N, M) in [0, 1].
        """
        wanted = np.asarray(wanted_radps2, dtype=np.float64)
        n = self._batch.n
        if wanted.shape != (n, self.size):
            raise ValueError(f"wanted: got shape {wanted.shape}, expected ({n}, {self.size})")
        free = self._batch.user.coupled_motion(self._batch.qpos)  # (N, nv, J)
        effect, rest = self._accelerations(free)
        target = (wanted - rest) / self.scale_radps2
        return _least_activations(effect / self.scale_radps2[:, None], target, self._effort)

    def joint_accelerations(
        self, device: str, wanted_mps2: ArrayLike, joints_radps2: ArrayLike
    ) -> FloatArray:
        """Return joint accelerations that move a device as wanted.

        Of all that do, those nearest to `joints_radps2` in units of ``scale``.

        Args:
            device: worn by the user, for example ``controller_right``.
            wanted_mps2: (N, 3) acceleration of the device, m/s^2, MuJoCo world frame.
            joints_radps2: (N, J) what the joints do where the device does not care.

        Returns:
            (N, J) rad/s^2.
        """
        batch = self._batch
        joints = np.asarray(joints_radps2, dtype=np.float64) / self.scale_radps2
        point, _ = batch.device_poses(device)
        # Every joint of the model carries the hand: velocity of the point per joint velocity.
        levers = np.cross(self._axis, point[:, None, :] - self._anchor)  # (N, nv, 3)
        free = batch.user.coupled_motion(batch.qpos)
        moves = (levers.transpose(0, 2, 1) @ free) * self.scale_radps2  # (N, 3, J)
        missing = np.asarray(wanted_mps2) - np.einsum("nxj,nj->nx", moves, joints)
        across = moves @ moves.transpose(0, 2, 1) + _SINGULAR_MPS2**2 * np.eye(3)
        pushed = np.linalg.solve(across, missing[..., None])
        joints = joints + np.einsum("nxj,nx->nj", moves, pushed[..., 0])
        accelerations: FloatArray = joints * self.scale_radps2
        return accelerations

    def _accelerations(self, free: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, J, M) acceleration per activation, and (N, J) without any."""
        batch = self._batch
        model = batch.user.physics_model
        dense = np.zeros((batch.n, model.nu, model.nv))
        dense[:, self._moment_rows, self._moment_columns] = self._moment
        gain, bias = self._curves(self._length, np.einsum("nmv,nv->nm", dense, batch.qvel))
        arms = dense @ free  # (N, M, J) change of length per joint angle
        inertia = np.zeros((batch.n, model.nv, model.nv))
        inertia[:, self._triangle[0], self._triangle[1]] = self._inertia
        inertia += np.tril(inertia, -1).transpose(0, 2, 1)
        of_joints = free.transpose(0, 2, 1) @ inertia @ free
        torques = arms.transpose(0, 2, 1) * gain[:, None, :]
        loads = np.einsum("nvj,nv->nj", free, self._passive - self._bias)
        loads += np.einsum("nmj,nm->nj", arms, bias)
        both = np.linalg.solve(of_joints, np.concatenate([torques, loads[..., None]], axis=2))
        return both[..., :-1], both[..., -1]


def _least_activations(effect: FloatArray, target: FloatArray, effort: float) -> FloatArray:
    """Minimise effort |a|^2 + |effect a - target|^2 over 0 <= a <= 1, for each of N problems.

    With y = (target - effect a) / effort the minimum is at a = clip(effect' y, 0, 1), which leaves
    J equations in y: Newton's method on them, whose active set settles within a few steps.

    Args:
        effect: (N, J, M).
        target: (N, J).
        effort: above 0.
    """
    n, joints, _ = effect.shape
    identity = effort * np.eye(joints)
    back = effect.transpose(0, 2, 1)
    y = np.linalg.solve(0.5 * effect @ back + identity, target[..., None])[..., 0]
    best = np.full(n, np.inf)
    chosen = y.copy()
    for _ in range(_NEWTON_STEPS):
        raw = np.einsum("nmj,nj->nm", back, y)
        a = np.clip(raw, 0.0, 1.0)
        residual = np.einsum("njm,nm->nj", effect, a) + effort * y - target
        size = np.abs(residual).max(axis=1)
        better = size < best
        best[better], chosen[better] = size[better], y[better]
        moving = ((raw > 0.0) & (raw < 1.0)).astype(np.float64)
        slope = (effect * moving[:, None, :]) @ back + identity
        y = y - np.linalg.solve(slope, residual[..., None])[..., 0]
    return np.clip(np.einsum("nmj,nj->nm", back, chosen), 0.0, 1.0)


class _Curves:
    """MuJoCo's muscle: force = gain(length, velocity) * activation + bias(length); N, <= 0."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._active = model.actuator_gainprm[:, :9].T.copy()
        self._passive = model.actuator_biasprm[:, :9].T.copy()
        self._range = model.actuator_lengthrange.T.copy()

    def __call__(self, length: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, M) gain and bias at lengths in m and lengthening velocities in m/s."""
        return self._gain(length, velocity), self._bias(length)

    def _scaled(self, parameters: FloatArray, length: FloatArray) -> tuple[FloatArray, FloatArray]:
        low, high = parameters[0], parameters[1]
        unit = (self._range[1] - self._range[0]) / (high - low)
        return low + (length - self._range[0]) / unit, unit

    def _gain(self, length: FloatArray, velocity: FloatArray) -> FloatArray:
        scaled, unit = self._scaled(self._active, length)
        _, _, force, _, low, high, fastest, _, most = self._active
        v = velocity / (unit * fastest)
        below, above = 0.5 * (low + 1.0), 0.5 * (1.0 + high)
        by_length = np.select(
            [
                (scaled < low) | (scaled > high),
                scaled <= below,
                scaled <= 1.0,
                scaled <= above,
            ],
            [
                np.zeros_like(scaled),
                0.5 * ((scaled - low) / (below - low)) ** 2,
                1.0 - 0.5 * ((1.0 - scaled) / (1.0 - below)) ** 2,
                1.0 - 0.5 * ((scaled - 1.0) / (above - 1.0)) ** 2,
            ],
            0.5 * ((high - scaled) / (high - above)) ** 2,
        )
        rise = most - 1.0
        by_velocity = np.select(
            [v <= -1.0, v <= 0.0, v <= rise],
            [np.zeros_like(v), (v + 1.0) ** 2, most - (rise - v) ** 2 / rise],
            np.broadcast_to(most, v.shape),
        )
        return -force * by_length * by_velocity

    def _bias(self, length: FloatArray) -> FloatArray:
        scaled, _ = self._scaled(self._passive, length)
        _, _, force, _, _, high, _, most, _ = self._passive
        above = 0.5 * (1.0 + high)
        x = (scaled - 1.0) / (above - 1.0)
        curve = np.where(scaled <= above, 0.5 * x * x, 0.5 + (scaled - above) / (above - 1.0))
        return -force * most * np.where(scaled <= 1.0, 0.0, curve)
