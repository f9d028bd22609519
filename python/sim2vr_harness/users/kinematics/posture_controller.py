"""Bring a hand to a place or its aim ray onto one, without learning.

Inverse kinematics finds a posture. Muscles then move the joints there as critically damped springs
would (computed torque), and the posture's remaining error is fed back.
"""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from sim2vr_harness.client.frames import AIM_DIRECTION, position_to_mujoco
from sim2vr_harness.users.actuation import Actuation
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.rules import Motor, moment_arms
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import bounded_least_squares

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ControlSettings:
    """Settings of the search for postures and of the movement towards them."""

    place_per_m: float = 20.0
    aim_per_rad: float = 30.0
    """Weights of the two errors in the search for a posture; the weights below are small beside
    them, so that they decide only what place and aim leave free."""
    comfort_per_m: float = 0.5
    limits: float = 0.3
    near_per_rad: float = 0.05
    comfort_m: tuple[float, float, float] = (0.25, 0.25, -0.3)
    """Position of a hand that points, relative to the headset: forward, to the hand's side, up."""
    starts: int = 3
    """Random starts of the search in addition to the current posture; the lowest cost wins."""
    frequency_rad_s: float = 9.0
    """Natural frequency of the springs."""
    furthest_rad: float = 0.5
    """Error at which the springs' force reaches its maximum."""
    servo_rad: float = 0.08
    """Largest change of a trunk or neck motor's target in a user step."""
    ease: float = 0.1
    """Weight of activations beside accelerations."""
    holding_ease: float = 0.02
    """Weight of activations beside torques (Nm) that hold a posture."""
    feedback: float = 0.1
    near_rad: float = 0.4
    slow_rad_s: float = 0.1
    most_rad: float = 0.5
    """Part of a joint's error that is added to its correction in every user step, of joints that
    are nearer than the second and slower than the third; corrections stay below the fourth."""


CONTROL = ControlSettings()


@dataclass(frozen=True)
class FoundPosture:
    """A posture, and how well it does.

    Attributes:
        angles: (J,) of the body's independent joints.
        gap_m: From the place; 0 without one.
        error_deg: Between the aim ray and the direction of what it is aimed at; 0 without that.
    """

    angles: FloatArray
    gap_m: float
    error_deg: float


class DeviceRay(NamedTuple):
    """A ray of a device, in the device's axes (x forward, y left, z up).

    Attributes:
        origin_m: (3,).
        direction: (3,) unit vector.
    """

    origin_m: FloatArray
    direction: FloatArray

    @property
    def key(self) -> bytes:
        """Key that is the same for equal rays."""
        return np.concatenate(self).tobytes()


AIM_RAY = DeviceRay(np.zeros(3), AIM_DIRECTION)
_SAME, _SAME_M = 0.01, 0.01
"""A ray of a page whose direction and origin differ less is WebXR's."""


def page_ray(found: tuple[FloatArray, FloatArray] | None) -> DeviceRay:
    """Return the ray with which a page points: its own, in the app's frame, if it has one."""
    if found is None:
        return AIM_RAY
    ray = DeviceRay(*map(position_to_mujoco, found))
    same = np.allclose(ray.direction, AIM_RAY.direction, atol=_SAME)
    return AIM_RAY if same and np.linalg.norm(ray.origin_m) < _SAME_M else ray


class PostureController:
    """Finds postures for a device and moves the body's muscles towards them.

    Args:
        body: with muscles, wearing the device.
        device: such as ``controller_right``.

    Raises:
        ValueError: the body has no muscles, or does not wear the device.
    """

    def __init__(self, body: Body, device: str = "controller_right") -> None:
        if device not in body.devices:
            raise ValueError(f"device: got {device!r}, expected one of {', '.join(body.devices)}")
        self._body, self._model = body, body.physics_model
        self._data = mujoco.MjData(self._model)
        self._actuation = Actuation(body)
        if len(self._actuation.muscles) == 0:
            raise ValueError(f"user: got {body.name!r}, expected a body with muscles")
        self._site = int(self._model.site(device).id)
        self._actions = len(body.action_names)
        self._tried = mujoco.MjData(self._model)
        chain = Linkage(body, Point(device)).joints
        self._columns = np.array([body.independent_joints.index(joint) for joint in chain])
        self._limits = np.asarray(body.joint_ranges)[self._columns]
        self._side = -1.0 if device.endswith("right") else 1.0
        joints = [self._model.joint(joint) for joint in body.independent_joints]
        self._qpos_of = np.array([int(joint.qposadr[0]) for joint in joints])
        self._qvel_of = np.array([int(joint.dofadr[0]) for joint in joints])
        self._servos = [_TrunkServo(body, name) for name in body.reset_rule.held]
        self.begin()

    def begin(self) -> None:
        """Forget the corrections, as an episode begins."""
        self._correction = np.zeros(len(self._qvel_of))
        for servo in self._servos:
            servo.begin()

    def angles(self, qpos: FloatArray) -> FloatArray:
        """(J,) angles of the independent joints in a posture (nq,)."""
        return np.asarray(qpos, dtype=np.float64)[self._qpos_of].copy()

    # --- the posture -----------------------------------------------------------------------------

    def find(
        self,
        start: FloatArray,
        *,
        place: FloatArray | None = None,
        aim_at: FloatArray | None = None,
        tip_m: ArrayLike = (0.0, 0.0, 0.0),
        ray: DeviceRay = AIM_RAY,
        nearby: bool = False,
    ) -> FoundPosture:
        """Return a posture that brings the device to a place, or its aim ray onto one.

        Args:
            start: (J,) present angles; joints that do not move the device stay there.
            place: (3,) for the device, MuJoCo's world, m.
            aim_at: (3,) for the ray to hit. The hand is held beside and below the headset.
            tip_m: (3,) what goes to ``place`` instead of the device, in the device's axes.
            ray: what is aimed with.
            nearby: whether to search from ``start`` only, after small changes of the place.
        """
        low, high = self._limits.T
        starts = [start[self._columns]]
        if not nearby:
            parts = np.random.default_rng(0).uniform(0.25, 0.75, (CONTROL.starts, len(low)))
            starts += list(low + parts * (high - low))
        found = []
        for one in starts:
            begin = np.clip(one, low + 1e-6, high - 1e-6)

            def wrong(x: FloatArray, begin: FloatArray = begin) -> FloatArray:
                angles = self._whole(start, x)
                tip, device, origin, along = self._reached(angles, tip_m, ray)
                errors = []
                if place is not None:
                    errors.append(CONTROL.place_per_m * (tip - place))
                if aim_at is not None:
                    errors.append(CONTROL.aim_per_rad * (along - _unit(aim_at - origin)))
                    head = self._tried.site("headset").xpos
                    held = head + np.array(CONTROL.comfort_m) * [1.0, self._side, 1.0]
                    errors.append(CONTROL.comfort_per_m * (device - held))
                middle, half = (low + high) / 2.0, (high - low) / 2.0
                rest = [
                    CONTROL.limits * ((x - middle) / half) ** 3,
                    CONTROL.near_per_rad * (x - begin),
                ]
                return np.concatenate([*errors, *rest])

            best = least_squares(wrong, begin, bounds=(low, high), max_nfev=40).x
            found.append(self._judged(self._whole(start, best), place, aim_at, tip_m, ray))
        least = min(one.gap_m * CONTROL.place_per_m + one.error_deg for one in found)
        able = [
            one for one in found if one.gap_m * CONTROL.place_per_m + one.error_deg < least + 0.1
        ]
        if len(able) == 1:
            return able[0]
        return min(able, key=self._effort)

    def _effort(self, posture: FoundPosture) -> float:
        held = self.holding(self._body.coupled_qpos(posture.angles))
        return float(np.square(held).sum())

    def _whole(self, start: FloatArray, x: FloatArray) -> FloatArray:
        angles = np.array(start, dtype=np.float64)
        angles[self._columns] = x
        return angles

    def _reached(
        self, angles: FloatArray, tip_m: ArrayLike, ray: DeviceRay
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the positions of tip and device, and origin and direction of the ray."""
        data = self._tried
        data.qpos[:] = self._body.coupled_qpos(angles)
        mujoco.mj_kinematics(self._model, data)
        turn = data.site_xmat[self._site].reshape(3, 3)
        device = data.site_xpos[self._site].copy()
        tip = device + turn @ np.asarray(tip_m, dtype=np.float64)
        return tip, device, device + turn @ ray.origin_m, turn @ ray.direction

    def _judged(
        self,
        angles: FloatArray,
        place: FloatArray | None,
        aim_at: FloatArray | None,
        tip_m: ArrayLike,
        ray: DeviceRay,
    ) -> FoundPosture:
        tip, _, origin, along = self._reached(angles, tip_m, ray)
        gap_m = 0.0 if place is None else float(np.linalg.norm(tip - place))
        error_deg = 0.0
        if aim_at is not None:
            error_deg = float(np.degrees(np.arccos(np.clip(along @ _unit(aim_at - origin), -1, 1))))
        return FoundPosture(angles, gap_m, error_deg)

    # --- the movement ----------------------------------------------------------------------------

    def towards(
        self, qpos: FloatArray, qvel: FloatArray, act: FloatArray, angles: FloatArray
    ) -> NDArray[np.float32]:
        """Return the body's action, (A,) in [-1, 1]; call it once per user step.

        Motors of trunk and neck move with the muscles; others stay.

        Args:
            qpos: (nq,) posture.
            qvel: (nv,) velocities.
            act: (M,) activations of the muscles.
            angles: (J,) to move to.
        """
        error = angles - self.angles(qpos)
        slow = np.abs(np.asarray(qvel)[self._qvel_of]) < CONTROL.slow_rad_s
        part = np.where(slow & (np.abs(error) < CONTROL.near_rad), CONTROL.feedback * error, 0.0)
        self._correction = np.clip(self._correction + part, -CONTROL.most_rad, CONTROL.most_rad)
        wanted = self._driving(qpos, qvel, angles + self._correction)
        action = np.zeros(self._actions, np.float32)
        muscles = self._actuation.muscles
        action[muscles] = np.clip(wanted - act, -1.0, 1.0)
        for servo in self._servos:
            action[servo.action] = servo.towards(qpos, angles + self._correction)
        return action

    def holding(self, qpos: FloatArray) -> FloatArray:
        """(M,) the least activations, by the sum of their squares, that hold a posture (nq,)."""
        free, pulls, slack = self._muscles(qpos, np.zeros(self._model.nv))
        return _least(pulls, free.T @ (self._holding_torques() - slack), CONTROL.holding_ease)

    def _driving(self, qpos: FloatArray, qvel: FloatArray, angles: FloatArray) -> FloatArray:
        """(M,) activations whose joint accelerations are the springs', as near as muscles can."""
        free, pulls, slack = self._muscles(qpos, qvel)
        model, data = self._model, self._data
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        error = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, error, 1.0, qpos, self._body.coupled_qpos(angles))
        error = np.clip(error, -CONTROL.furthest_rad, CONTROL.furthest_rad)
        wanted = CONTROL.frequency_rad_s**2 * error - 2.0 * CONTROL.frequency_rad_s * qvel
        inertia = free.T @ mass @ free
        torques = inertia @ (free.T @ wanted) + free.T @ (self._holding_torques() - slack)
        # In the metric of kinetic energy light joints, such as the wrist, count like heavy ones.
        scale = np.linalg.inv(np.linalg.cholesky(inertia))
        return _least(scale @ pulls, scale @ torques, CONTROL.ease)

    def _muscles(
        self, qpos: FloatArray, qvel: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Set the posture; return what muscles can do in it.

        Returns:
            (nv, F) directions in which joints can move; (F, M) forces along them of fully active
            muscles beyond those of muscles at rest; (nv,) torques of muscles at rest.
        """
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        columns = self._actuation.activations
        data.act[columns] = 1.0
        mujoco.mj_forward(model, data)
        ids = self._actuation.actuators[self._actuation.muscles]
        full = data.actuator_force[ids].copy()
        data.act[columns] = 0.0
        mujoco.mj_forward(model, data)
        slack = data.actuator_force[ids].copy()
        moments = moment_arms(self._model, self._data)[ids]
        if data.ne == 0:
            free: FloatArray = np.eye(model.nv)
        else:
            jacobian = np.zeros((data.nefc, model.nv))
            if mujoco.mj_isSparse(model):
                mujoco.mju_sparse2dense(
                    jacobian, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
                )
            else:
                jacobian[:] = data.efc_J.reshape(data.nefc, model.nv)
            _, sizes, rows = np.linalg.svd(jacobian[: data.ne])
            rank = int((sizes > 1e-8 * sizes[0]).sum())
            free = rows[rank:].T
        pulls = free.T @ (moments * (full - slack)[:, None]).T
        return free, pulls, moments.T @ slack

    def _holding_torques(self) -> FloatArray:
        """(nv,) of gravity and of what the joints' springs leave."""
        torques: FloatArray = self._data.qfrc_bias - self._data.qfrc_passive
        return torques


class _TrunkServo:
    """A motor that holds its joint as an episode begins (``reset.held``), and then moves it."""

    def __init__(self, body: Body, name: str) -> None:
        model = body.physics_model
        i = model.actuator(name).id
        joint = model.joint(int(model.actuator_trnid[i, 0]))
        self.action = body.action_names.index(name)
        self._joint, self._qpos = body.independent_joints.index(joint.name), int(joint.qposadr[0])
        self._low, high = model.actuator_ctrlrange[i].tolist()
        self._span = high - self._low
        self.begin()

    def begin(self) -> None:
        """Aim at where the joint is, as an episode begins."""
        self._aim: float | None = None

    def towards(self, qpos: FloatArray, angles: FloatArray) -> float:
        """Return the action that moves the motor's target towards that of angles (J,)."""
        if self._aim is None:
            self._aim = float(np.clip((qpos[self._qpos] - self._low) / self._span, 0.0, 1.0))
        wanted = float(np.clip((angles[self._joint] - self._low) / self._span, 0.0, 1.0))
        most = CONTROL.servo_rad / self._span
        shift = float(np.clip(wanted - self._aim, -most, most))
        # What the motor's rule does with an action (users/bodies/rules.py).
        action = shift / (1.0 - Motor.KEPT)
        self._aim += shift
        return action


def _least(pulls: FloatArray, torques: FloatArray, ease: float) -> FloatArray:
    """(M,) activations of muscles (F, M) nearest to torques (F,), as small as will do."""
    muscles = pulls.shape[1]
    return bounded_least_squares(
        np.concatenate([pulls, ease * np.eye(muscles)]),
        np.concatenate([torques, np.zeros(muscles)]),
    )


def _unit(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else vector
