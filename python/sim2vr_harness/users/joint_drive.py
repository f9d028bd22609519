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

_STEPS = 40
_WEIGHT = 0.3
_OVERSHOOT = 1.6


class JointDrive:
    """Turns wanted joint accelerations into muscle controls, for every user of a batch.

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
        self._lag = _Lag(model, batch.dt)

    @property
    def size(self) -> int:
        """Number of independent joints J."""
        return len(self._joints)

    def controls_for(
        self,
        joints_radps2: ArrayLike,
        device: str | None = None,
        device_mps2: ArrayLike | None = None,
        device_scale_mps2: float = 2.0,
    ) -> FloatArray:
        """Return the controls for wanted accelerations in the present state.

        Args:
            joints_radps2: (N, J), in the order of ``user.independent_joints``.
            device: a worn device whose acceleration is wanted as well, for example
                ``controller_right``; what it needs and the joints want are weighed by their units.
            device_mps2: (N, 3) that acceleration, MuJoCo world frame.
            device_scale_mps2: its unit.

        Returns:
            (N, M) controls in [0, 1]: with them, activations are what they should be in the mean
            over a step, as far as they can rise and fall so fast.
        """
        wanted = np.asarray(joints_radps2, dtype=np.float64)
        n = self._batch.n
        if wanted.shape != (n, self.size):
            raise ValueError(f"joints: got shape {wanted.shape}, expected ({n}, {self.size})")
        free = self._batch.user.coupled_motion(self._batch.qpos)  # (N, nv, J)
        effect, rest = self._accelerations(free)
        effects = [effect / self.scale_radps2[:, None]]
        targets = [(wanted - rest) / self.scale_radps2]
        if device is not None:
            levers = self._levers(device) / device_scale_mps2
            moved = np.asarray(device_mps2, dtype=np.float64) / device_scale_mps2
            effects.append(levers @ effect)
            targets.append(moved - np.einsum("nxj,nj->nx", levers, rest))
        act = self._batch.act
        falling, rising = self._lag.shares(act)
        means = _least_activations(
            np.concatenate(effects, axis=1),
            np.concatenate(targets, axis=1),
            self._effort,
            falling * act,
            rising * act + (1.0 - rising),
        )
        return self.controls_over_a_step(act, means)

    def controls_over_a_step(self, act: FloatArray, means: FloatArray) -> FloatArray:
        """(N, M) controls with which activations ``act`` become ``means`` on average over a step.

        A control beyond [0, 1] is cut: activations rise and fall as fast as they can.
        """
        falling, rising = self._lag.shares(act)
        share = np.where(means < act, falling, rising)
        cut: FloatArray = np.clip((means - share * act) / (1.0 - share), 0.0, 1.0)
        return cut

    def device_velocities(self, device: str, joints_radps: ArrayLike) -> FloatArray:
        """(N, 3) velocity of a device, m/s, MuJoCo world frame, for joint velocities (N, J)."""
        velocities: FloatArray = np.einsum(
            "nxj,nj->nx", self._levers(device), np.asarray(joints_radps, dtype=np.float64)
        )
        return velocities

    def _levers(self, device: str) -> FloatArray:
        """(N, 3, J) motion of a device per motion of the independent joints, m."""
        batch = self._batch
        point, _ = batch.device_poses(device)
        # Every joint of the model carries the hand.
        levers = np.cross(self._axis, point[:, None, :] - self._anchor)  # (N, nv, 3)
        return levers.transpose(0, 2, 1) @ batch.user.coupled_motion(batch.qpos)

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


def _least_activations(
    effect: FloatArray,
    target: FloatArray,
    effort: float,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Minimise effort |a|^2 + |effect a - target|^2 over low <= a <= high, N problems at once.

    By the alternating direction method of multipliers, which never strays far: after so few steps
    the sum is within some hundredths of the least (Newton's method on the active set finds it to
    the last digit, or misses it by far).

    Args:
        effect: (N, K, M).
        target: (N, K).
        effort: above 0.
        low: (N, M), the least that is possible.
        high: (N, M), the most.
    """
    back = effect.transpose(0, 2, 1)
    muscles = effect.shape[2]
    square = back @ effect
    weight = (_WEIGHT * np.trace(square, axis1=1, axis2=2) / muscles + 1e-9)[:, None]
    inverse = np.linalg.inv(square + (effort + weight)[..., None] * np.eye(muscles))
    free = inverse @ (back @ target[..., None])
    pulled = inverse * weight[..., None]
    bounded = low.copy()
    excess = np.zeros_like(bounded)
    for _ in range(_STEPS):
        a = (free + pulled @ (bounded - excess)[..., None])[..., 0]
        excess = excess + _OVERSHOOT * a + (1.0 - _OVERSHOOT) * bounded
        bounded = np.clip(excess, low, high)
        excess = excess - bounded
    return bounded


class _Lag:
    """How much of a muscle's activation stays while its control is another one.

    MuJoCo's activation follows the control with a time constant that grows with the activation
    when it rises, and shrinks with it when it falls.
    """

    def __init__(self, model: mujoco.MjModel, step_s: float) -> None:
        self._rise_s, self._fall_s = model.actuator_dynprm[:, :2].T.copy()
        self._step_s = step_s

    def shares(self, act: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, M) share of the present activation in the mean over a step, falling and rising."""
        falling_s = self._fall_s / (0.5 + 1.5 * act)
        rising_s = self._rise_s * (0.5 + 1.5 * act)
        return self._share(falling_s), self._share(rising_s)

    def _share(self, time_constant_s: FloatArray) -> FloatArray:
        ratio = time_constant_s / self._step_s
        share: FloatArray = ratio * -np.expm1(-1.0 / ratio)
        return share


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
