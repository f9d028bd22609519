"""The arms of a body: posture, and the torque that gravity and motion put on the shoulder."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.body import Body

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """An arm that holds a controller; names of the model's bodies.

    Attributes:
        side: ``right`` or ``left``.
        upper_arm: whose origin is the centre of the shoulder.
        forearm: whose origin is the elbow.
        wrist: whose origin is the wrist.
    """

    side: str
    upper_arm: str
    forearm: str
    wrist: str

    @property
    def device(self) -> str:
        """What it holds."""
        return f"controller_{self.side}"


def arms_of(body: Body) -> tuple[Arm, ...]:
    """Return the arms of a body, right before left.

    An arm is a chain of bodies up from a controller, in which the upper arm is called
    ``humerus...``, the forearm ``ulna...`` and ``radius...``, as in OpenSim's models; a controller
    without them has none.
    """
    found = []
    for side in ("right", "left"):
        if f"controller_{side}" not in body.devices:
            continue
        site = f"controller_{side}"
        names, part = [], int(body.physics_model.site(site).bodyid[0])
        while part:
            names.append(body.physics_model.body(part).name)
            part = int(body.physics_model.body_parentid[part])
        chain = names
        upper = [name for name in chain if name.startswith("humerus")]
        fore = [name for name in chain if name.startswith("ulna")]
        bones = [i for i, name in enumerate(chain) if name.startswith(("ulna", "radius"))]
        if upper and fore and bones and bones[0] > 0:
            found.append(Arm(side, upper[0], fore[0], chain[bones[0] - 1]))
    return tuple(found)


@dataclass(frozen=True)
class ArmLoad:
    """What an arm does at a moment.

    Attributes:
        torque: magnitude of the moment at the shoulder, Nm.
        shoulder_deg: between upper arm and straight down.
        elbow_deg: between upper arm and forearm; 180: outstretched.
    """

    torque: float
    shoulder_deg: float
    elbow_deg: float


class ArmDynamics:
    """Inverse dynamics of arms: of each, everything from the humerus to the controller.

    The moment is the one between the segments, of weight and acceleration.
    Contacts that support the arm are not subtracted.

    Args:
        model: of the body.
        arms: A of them.
    """

    def __init__(self, model: mujoco.MjModel, *arms: Arm) -> None:
        self._model, self._arms = model, arms
        self._data = data = mujoco.MjData(model)
        self._motion = (data.qpos, data.qvel, data.qacc)
        self._told: list[FloatArray] = []
        for arm in arms:
            parts = [model.body(part).id for part in (arm.upper_arm, arm.forearm, arm.wrist)]
            # A wrench about the centre of mass of the whole tree: torque, then force. Live arrays.
            self._told += [data.cfrc_int[parts[0]], data.subtree_com[model.body_rootid[parts[0]]]]
            self._told += [data.xpos[part] for part in parts]

    def moments(self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> FloatArray:
        """Return a moment of motion as :func:`arm_loads` takes it, (A, 18).

        Args:
            qpos: (nq,) angles, rad.
            qvel: (nv,) rad/s.
            qacc: (nv,) rad/s^2.
        """
        model, data = self._model, self._data
        for live, given in zip(self._motion, (qpos, qvel, qacc), strict=True):
            live[:] = given
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        return np.concatenate(self._told).reshape(len(self._arms), 18)

    def load(
        self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray, *, held_kg: float = 0.0
    ) -> ArmLoad:
        """Return torque and posture of the first arm.

        ``held_kg`` more hang from the controller, at rest.
        """
        moment = self.moments(qpos, qvel, qacc)[0]
        shoulder, hand = moment[9:12], self._data.site(self._arms[0].device).xpos
        moment[:3] -= np.cross(hand - shoulder, held_kg * self._model.opt.gravity)
        return ArmLoad(*map(float, arm_loads(moment)))


def arm_loads(moments: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what arms do at moments, as the attributes of :class:`ArmLoad`, (...) each.

    Args:
        moments: (..., 18) torque, force, the point that they act about, shoulder, elbow and wrist.
    """
    torque, force, about, shoulder, elbow, wrist = np.moveaxis(
        np.reshape(moments, (*np.shape(moments)[:-1], 6, 3)), -2, 0
    )
    total = torque + np.cross(about - shoulder, force)
    upper = elbow - shoulder
    down = np.array([0.0, 0.0, -1.0])
    return (
        np.linalg.norm(total, axis=-1),
        _angle(upper, down),
        180.0 - _angle(upper, wrist - elbow),
    )


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    cosine = (a * b).sum(axis=-1) / np.maximum(lengths, 1e-12)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
