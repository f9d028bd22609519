"""Bodies with legs that sit or stand still: what is locked, where, and which actuators go."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.locking import Lock, with_followers
from sim2vr_harness.users.bodies.moments import moment_arms

Posture = Literal["seated", "standing"]

_FREE, _BALL, _HINGE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_FREE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_HINGE,
    )
)
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
    """Where a joint is in the reference posture, within its limits; free joints and balls: 0."""
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
