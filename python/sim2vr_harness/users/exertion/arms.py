"""The arms of a body: posture, and the torque that gravity and motion put on the shoulder."""

from __future__ import annotations

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
        chain = _chain(body.physics_model, f"controller_{side}")
        upper = [name for name in chain if name.startswith("humerus")]
        fore = [name for name in chain if name.startswith("ulna")]
        bones = [i for i, name in enumerate(chain) if name.startswith(("ulna", "radius"))]
        if upper and fore and bones and bones[0] > 0:
            found.append(Arm(side, upper[0], fore[0], chain[bones[0] - 1]))
    return tuple(found)


def _chain(model: mujoco.MjModel, site: str) -> list[str]:
    names, part = [], int(model.site(site).bodyid[0])
    while part:
        names.append(model.body(part).name)
        part = int(model.body_parentid[part])
    return names


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
    """Inverse dynamics of an arm: everything from the humerus to the controller.

    The moment is the one between the segments: of weight and acceleration, whoever holds them.
    Contacts that support the arm are not subtracted.

    Args:
        model: of the body.
        arm: the arm.
    """

    def __init__(self, model: mujoco.MjModel, arm: Arm) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        parts = (arm.upper_arm, arm.forearm, arm.wrist)
        self._shoulder, self._elbow, self._wrist = (model.body(part).id for part in parts)
        self._root = int(model.body_rootid[self._shoulder])
        self._hand = model.site(arm.device).id

    def load(
        self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray, *, held_kg: float = 0.0
    ) -> ArmLoad:
        """Return torque and posture.

        Args:
            qpos: (nq,) angles, rad.
            qvel: (nv,) rad/s.
            qacc: (nv,) rad/s^2.
            held_kg: further mass that hangs from the controller, at rest.
        """
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        # A wrench about the centre of mass of the whole tree: torque, then force.
        wrench = data.cfrc_int[self._shoulder]
        shoulder, elbow, wrist = (
            data.xpos[part] for part in (self._shoulder, self._elbow, self._wrist)
        )
        moment = wrench[:3] + np.cross(data.subtree_com[self._root] - shoulder, wrench[3:])
        weight = -held_kg * model.opt.gravity
        moment = moment + np.cross(data.site_xpos[self._hand] - shoulder, weight)
        upper, fore = elbow - shoulder, wrist - elbow
        return ArmLoad(
            float(np.linalg.norm(moment)),
            _angle(upper, np.array([0.0, 0.0, -1.0])),
            180.0 - _angle(upper, fore),
        )


def _angle(a: FloatArray, b: FloatArray) -> float:
    cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
