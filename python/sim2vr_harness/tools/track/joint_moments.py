"""Moments that muscles and motors exert about joints, from their forces and moment arms."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.moments import moment_arms

FloatArray = NDArray[np.float64]


def named_joints(model: Any) -> list[tuple[str, int]]:
    """Return names and degrees of freedom of the hinge joints."""
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE.value)
    return [(model.joint(int(i)).name, int(model.jnt_dofadr[i])) for i in hinges]


def joint_moments(model: Any, qpos: FloatArray, forces: FloatArray) -> FloatArray:
    """Return (N, J) moments about the joints of :func:`named_joints`, Nm.

    Args:
        model: the body.
        qpos: (N, nq) postures.
        forces: (N, nu) of the actuators in their order, pulling: < 0.
    """
    data = mujoco.MjData(model)
    columns = [dof for _, dof in named_joints(model)]
    found = np.empty((len(qpos), len(columns)))
    for k, (posture, force) in enumerate(zip(qpos, forces, strict=True)):
        data.qpos[:] = posture
        mujoco.mj_fwdPosition(model, data)
        found[k] = (force @ moment_arms(model, data))[columns]
    return found
