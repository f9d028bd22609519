"""Joints that do not move: folded into the poses of their bodies and taken away.

Legs that sit or stand still are locked so, and actuators that then move nothing go.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.meshes import Pose, compose, inverse
from sim2vr_harness.users.bodies.rules import moment_arms

Posture = Literal["seated", "standing"]
Lock = float | tuple[float, float, float, float]
"""Position at which a joint is locked: an angle of hinges (rad) or a position of slides (m), as in
qpos; a rotation of balls (w x y z); 0 for free joints and balls: their pose in the model."""

_JOINT = mujoco.mjtJoint
_FREE, _BALL = int(_JOINT.mjJNT_FREE), int(_JOINT.mjJNT_BALL)
_SLIDE, _HINGE = int(_JOINT.mjJNT_SLIDE), int(_JOINT.mjJNT_HINGE)
_JOINT_EQUALITY = mujoco.mjtEq.mjEQ_JOINT
_HIP, _KNEE = re.compile("hip|femur|thigh", re.I), re.compile("knee|tibia|shin|shank", re.I)
_SEATED_RAD = ((_HIP, -np.pi / 2), (_KNEE, np.pi / 2))
"""Flexion about the axis to the left: thighs forward, shanks down."""
_LEAST_LEFT = 0.5
"""Cosine between a flexion axis and the axis to the left, at least."""
_POSES, _LEAST_MOMENT = 4, 1e-9


@dataclass(frozen=True)
class StillLegs:
    """Legs that do not move.

    Attributes:
        locks: joint -> where it is locked: the joints from the world to the hips, and those of
            the legs.
        root: body that carries all others.
        lowered_m: by how much the root is lowered, so that the feet stay where they stood.
    """

    locks: Mapping[str, Lock]
    root: str
    lowered_m: float


def still_legs(model: mujoco.MjModel, posture: Posture, left: NDArray[np.float64]) -> StillLegs:
    """Find the joints that keep a body seated or standing.

    Args:
        model: of the whole body.
        posture: of the legs; seated has hips and knees at 90 degrees, or at their limit.
        left: (3,) axis to the person's left.

    Raises:
        ValueError: no joint is named after a hip.
    """
    named = _named(model, _HIP)
    if not named:
        raise ValueError(
            f"posture: got {posture!r}, expected a model with joints named after the hips (hip, "
            "femur or thigh): name them so, or write the joints under locked_joints"
        )
    hips = {int(model.jnt_bodyid[joint]) for joint in named}
    legs = [body for body in range(1, model.nbody) if hips & set(_ancestors(model, body))]
    above = {body for hip in hips for body in _ancestors(model, hip)}
    still = above.union(legs)
    joints = [joint for joint in range(model.njnt) if int(model.jnt_bodyid[joint]) in still]
    standing = {model.joint(joint).name: _at_rest(model, joint) for joint in joints}
    bent = _bent(model, left) if posture == "seated" else {}
    locks: dict[str, Lock] = {**standing, **with_followers(model, bent)}
    feet = [_lowest(model, legs, one) for one in (standing, locks)]
    return StillLegs(locks, model.body(int(model.body_rootid[legs[0]])).name, feet[1] - feet[0])


def idle_actuators(
    model: mujoco.MjModel, locks: Mapping[str, Lock], names: Iterable[str]
) -> set[str]:
    """Return those of some actuators that move nothing once joints are locked."""
    free = np.ones(model.nv, dtype=bool)
    for name in locks:
        first = int(model.joint(name).dofadr[0])
        free[first : first + len(model.joint(name).damping)] = False
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    moved = np.zeros(model.nu)
    for _ in range(_POSES):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-0.3, 0.3, model.nv) * free, 1.0)
        _set(model, data, locks)
        mujoco.mj_fwdPosition(model, data)
        moment = moment_arms(model, data)
        moved = np.maximum(moved, np.abs(moment[:, free]).max(axis=1, initial=0.0))
    return {name for name in names if moved[model.actuator(name).id] < _LEAST_MOMENT}


def _named(model: mujoco.MjModel, pattern: re.Pattern[str]) -> list[int]:
    """Hinges and balls with such a name that follow no other joint."""
    followers = model.eq_obj1id[model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)].tolist()
    return [
        joint
        for joint in range(model.njnt)
        if pattern.search(model.joint(joint).name)
        and model.jnt_type[joint] in (_HINGE, _BALL)
        and joint not in followers
    ]


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and all that carry it, without the world."""
    found = []
    while body:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def _at_rest(model: mujoco.MjModel, joint: int) -> float:
    """Return a joint's position in the reference posture, within limits; 0 for free and balls."""
    if model.jnt_type[joint] in (_FREE, _BALL):
        return 0.0
    return _limited(model, joint, float(model.qpos0[model.jnt_qposadr[joint]]))


def _limited(model: mujoco.MjModel, joint: int, angle: float) -> float:
    limits = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
    return float(np.clip(angle, *limits))


def _bent(model: mujoco.MjModel, left: NDArray[np.float64]) -> dict[str, Lock]:
    """Hips and knees at 90 degrees: of each body's joints the one whose axis is most to a side."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bent: dict[str, Lock] = {}
    for pattern, angle in _SEATED_RAD:
        joints = _named(model, pattern)
        for body in {int(model.jnt_bodyid[joint]) for joint in joints}:
            own = [joint for joint in joints if int(model.jnt_bodyid[joint]) == body]
            joint = max(own, key=lambda j: _sideways(model, data, j, left) ** 2)
            name, side = model.joint(joint).name, _sideways(model, data, joint, left)
            if model.jnt_type[joint] == _BALL:
                turn = np.zeros(4)
                mujoco.mju_axisAngle2Quat(turn, data.xmat[body].reshape(3, 3).T @ left, angle)
                w, x, y, z = turn.tolist()
                bent[name] = (w, x, y, z)
            elif abs(side) >= _LEAST_LEFT:
                start = float(model.qpos0[model.jnt_qposadr[joint]])
                bent[name] = _limited(model, joint, start + np.sign(side) * angle)
    return bent


def _sideways(
    model: mujoco.MjModel, data: mujoco.MjData, joint: int, left: NDArray[np.float64]
) -> float:
    """Cosine between a joint's axis and the axis to the left; a ball has any axis."""
    return 1.0 if model.jnt_type[joint] == _BALL else float(data.xaxis[joint] @ left)


def _lowest(model: mujoco.MjModel, bodies: list[int], locks: Mapping[str, Lock]) -> float:
    data = mujoco.MjData(model)
    _set(model, data, locks)
    mujoco.mj_kinematics(model, data)
    return float(data.xpos[bodies, 2].min())


def _set(model: mujoco.MjModel, data: mujoco.MjData, locks: Mapping[str, Lock]) -> None:
    """Put joints where they are locked; a number leaves free joints and balls where they are."""
    for name, lock in locks.items():
        joint = model.joint(name)
        if joint.type[0] not in (_FREE, _BALL) or isinstance(lock, tuple):
            data.joint(name).qpos[:] = lock


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
