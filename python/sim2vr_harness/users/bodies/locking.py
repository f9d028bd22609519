"""Joints that do not move: folded into the poses of their bodies and taken away."""

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.meshes import Pose, compose, inverse

FloatArray = NDArray[np.float64]

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_JOINT_EQUALITY = mujoco.mjtEq.mjEQ_JOINT


Lock = float | tuple[float, float, float, float]
"""Where a joint is locked: hinges at an angle (rad), slides at a place (m), as qpos has it; balls
at a rotation (w x y z); free joints and balls at 0, which is where the model has them."""


def lock_joints(spec: mujoco.MjSpec, locks: Mapping[str, Lock]) -> None:
    """Fix joints where `locks` says, in place; joints that follow them are fixed too.

    Args:
        spec: the body; actuators that move a locked joint must be gone.
        locks: joint -> where.

    Raises:
        ValueError: a joint cannot be locked there, or a tendon joins it to one that moves.
    """
    if not locks:
        return
    model = spec.compile()
    locked = with_followers(model, locks)
    for body in range(1, model.nbody):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = range(first, first + count)
        pose: Pose = (np.array(model.body_pos[body]), np.array(model.body_quat[body]))
        for place, joint in enumerate(joints):
            name = model.joint(joint).name
            if name not in locked:
                continue
            moved = _motion(model, joint, locked[name])
            pose = compose(pose, moved)
            # T_1 T_locked = T_locked (T_locked^-1 T_1 T_locked): earlier joints turn against it.
            for earlier in joints[:place]:
                back = inverse(moved)
                axis, anchor = np.zeros(3), np.zeros(3)
                mujoco.mju_rotVecQuat(axis, np.array(model.jnt_axis[earlier]), back[1])
                mujoco.mju_trnVecPose(anchor, *back, np.array(model.jnt_pos[earlier]))
                model.jnt_axis[earlier], model.jnt_pos[earlier] = axis, anchor
        model.body_pos[body], model.body_quat[body] = pose
    spec.copy_back(model)
    for equality in list(spec.equalities):
        if equality.type == _JOINT_EQUALITY and equality.name1 in locked:
            spec.delete(equality)
    # Delete the fixed tendons whose joints are all locked: their length is a constant.
    for tendon in list(spec.tendons):
        tendons_joints = [
            w.target.name for w in tendon.path if w.type == mujoco.mjtWrap.mjWRAP_JOINT
        ]
        moving = [name for name in tendons_joints if name not in locked]
        if not tendons_joints or len(moving) == len(tendons_joints):
            continue
        if moving:
            still = next(name for name in tendons_joints if name in locked)
            raise ValueError(
                f"locked_joints: got {still!r}, which the tendon {tendon.name!r} joins to "
                f"{moving[0]!r}; expected both locked, or an MJCF without the tendon"
            )
        for tendons_equality in list(spec.equalities):
            names = (tendons_equality.name1, tendons_equality.name2)
            if tendons_equality.type == mujoco.mjtEq.mjEQ_TENDON and tendon.name in names:
                spec.delete(tendons_equality)
        spec.delete(tendon)
    for name in locked:
        spec.delete(spec.joint(name))


def with_followers(model: mujoco.MjModel, locks: Mapping[str, Lock]) -> dict[str, Lock]:
    """Return the locked joints and those that couplings tie to them."""
    locked = dict(locks)
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
                lock = locked[driver.name]
                assert not isinstance(lock, tuple)  # couplings join hinges and slides
                angle = lock - float(model.qpos0[driver.qposadr[0]])
                turned = np.polynomial.polynomial.polyval(angle, model.eq_data[i, :5])
                locked[dependent.name] = float(turned + model.qpos0[dependent.qposadr[0]])
                grew = True
    return locked


def _motion(model: mujoco.MjModel, joint: int, lock: Lock) -> Pose:
    """The rigid motion of a body when its joint is where it is locked."""
    kind, name = model.jnt_type[joint], model.joint(joint).name
    if kind not in (_HINGE, _SLIDE) and not isinstance(lock, tuple):
        if lock:
            raise ValueError(
                f"locked_joints.{name}: got {lock:g}, expected 0: a free or ball joint is locked "
                "where the MJCF has its body"
            )
        return np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    axis, anchor = np.array(model.jnt_axis[joint]), np.array(model.jnt_pos[joint])
    turned, away = np.zeros(4), np.zeros(3)
    if isinstance(lock, tuple):
        turned[:] = lock
    else:
        moved = lock - float(model.qpos0[model.jnt_qposadr[joint]])
        if kind == _SLIDE:
            return axis * moved, np.array([1.0, 0.0, 0.0, 0.0])
        mujoco.mju_axisAngle2Quat(turned, axis, moved)
    mujoco.mju_rotVecQuat(away, anchor, turned)
    return anchor - away, turned
