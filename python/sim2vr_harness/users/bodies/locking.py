"""Joints that do not move: folded into the poses of their bodies and taken away."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.meshes import Pose, compose, inverse

FloatArray = NDArray[np.float64]

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_JOINT_EQUALITY = mujoco.mjtEq.mjEQ_JOINT


def lock_joints(spec: mujoco.MjSpec, angles: Mapping[str, float]) -> None:
    """Fixes joints at angles (rad; slides m), in place; joints that follow them are fixed too.

    Args:
        spec: the body; actuators that move a locked joint must be gone.
        angles: joint -> angle, as qpos has it.

    Raises:
        ValueError: a joint is neither a hinge nor a slide.
    """
    if not angles:
        return
    model = spec.compile()
    locked = _with_followers(model, angles)
    for body in range(1, model.nbody):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = range(first, first + count)
        pose: Pose = (np.array(model.body_pos[body]), np.array(model.body_quat[body]))
        for place, joint in enumerate(joints):
            name = model.joint(joint).name
            if name not in locked:
                continue
            if model.jnt_type[joint] not in (_HINGE, _SLIDE):
                raise ValueError(f"locked_joints.{name}: got neither a hinge nor a slide")
            moved = _motion(model, joint, locked[name])
            pose = compose(pose, moved)
            # T_1 T_locked = T_locked (T_locked^-1 T_1 T_locked): earlier joints turn against it.
            for earlier in joints[:place]:
                _turn_back(model, earlier, moved)
        model.body_pos[body], model.body_quat[body] = pose
    spec.copy_back(model)
    for equality in list(spec.equalities):
        if equality.type == _JOINT_EQUALITY and equality.name1 in locked:
            spec.delete(equality)
    for name in locked:
        spec.delete(spec.joint(name))


def _with_followers(model: mujoco.MjModel, angles: Mapping[str, float]) -> dict[str, float]:
    """The locked joints and those that couplings tie to them."""
    locked = dict(angles)
    grew = True
    while grew:
        grew = False
        for i in range(model.neq):
            if model.eq_type[i] != _JOINT_EQUALITY or model.eq_obj2id[i] < 0:
                continue
            dependent, driver = (
                model.joint(int(j)) for j in (model.eq_obj1id[i], model.eq_obj2id[i])
            )
            if driver.name in locked and dependent.name not in locked:
                angle = locked[driver.name] - float(model.qpos0[driver.qposadr[0]])
                turned = np.polynomial.polynomial.polyval(angle, model.eq_data[i, :5])
                locked[dependent.name] = float(turned + model.qpos0[dependent.qposadr[0]])
                grew = True
    return locked


def _motion(model: mujoco.MjModel, joint: int, angle: float) -> Pose:
    """The rigid motion of a body when its joint is at `angle`."""
    moved = angle - float(model.qpos0[model.jnt_qposadr[joint]])
    axis, anchor = np.array(model.jnt_axis[joint]), np.array(model.jnt_pos[joint])
    if model.jnt_type[joint] == _SLIDE:
        return axis * moved, np.array([1.0, 0.0, 0.0, 0.0])
    turned, away = np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(turned, axis, moved)
    mujoco.mju_rotVecQuat(away, anchor, turned)
    return anchor - away, turned


def _turn_back(model: mujoco.MjModel, joint: int, moved: Pose) -> None:
    back = inverse(moved)
    axis, anchor = np.zeros(3), np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array(model.jnt_axis[joint]), back[1])
    mujoco.mju_trnVecPose(anchor, *back, np.array(model.jnt_pos[joint]))
    model.jnt_axis[joint], model.jnt_pos[joint] = axis, anchor
