"""Joint groups with independent dynamics: two arms on a fixed chest are two limbs.

A limb's motion depends on its own joints and actuators alone. A model of each is smaller and
better than one of both; nearly alike limbs, such as a right and a left arm, share one.
Arms and a head on a moving trunk are carried by it. The trunk's motion, with their weight and reach
included, is a model of its own, and theirs depends on it and on nothing else beside them.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import Body
from sim2vr_harness.users.bodies.moments import moment_arms

_TRIALS, _ALIKE = 4, 0.1
"""States in which limbs are compared, and how far their accelerations may differ, as a share."""


@dataclass(frozen=True)
class JointGroup:
    """Independent joints that are moved together, and all that they depend on.

    Attributes:
        joints: which of the body's independent joints.
        actuators: which of the body's actions work on them.
        seen: other joints whose angles and speeds matter.
        base: those of them that carry the limb: how their speeds change matters too.
    """

    joints: tuple[int, ...]
    actuators: tuple[int, ...]
    seen: tuple[int, ...] = ()
    base: tuple[int, ...] = ()


def limbs_of(body: Body) -> list[list[JointGroup]]:
    """Return the limbs of a body, what carries before what is carried.

    They are in groups of those that are nearly alike.
    """
    groups: list[list[JointGroup]] = []
    for limb in [part for whole in _apart(body) for part in _divided(body, whole)]:
        for group in groups:
            if _alike(body, group[0], limb):
                group.append(limb)
                break
        else:
            groups.append([limb])
    return groups


def _apart(body: Body, without: tuple[int, ...] = ()) -> list[JointGroup]:
    """Return what moves by itself if the joints ``without`` stand still, those left out."""
    model = body.physics_model
    root = list(range(model.njnt))
    """Of every joint one that it moves together with, in the end the same for all of a limb."""

    def find(joint: int) -> int:
        while root[joint] != joint:
            joint = root[joint]
        return joint

    def join(joints: list[int]) -> None:
        for other in joints[1:]:
            root[find(other)] = find(joints[0])

    locked = {c.dependent for c in body.couplings if not any(c.coefficients[1:])}
    still = {_joint_id(body, j) for j in without}
    moves = [model.joint(i).name not in locked and i not in still for i in range(model.njnt)]
    for i in range(1, model.nbody):  # a joint, and the nearest one above it
        own = _own(model, i, moves)
        if own:
            join([*own, *_above(model, i, moves)])
    for coupling in body.couplings:
        if coupling.dependent not in locked:
            join([model.joint(coupling.dependent).id, model.joint(coupling.driver).id])
    pulled = _pulled(body)
    for joints in pulled:
        join([j for j in joints if moves[j]])
    limbs: dict[int, list[int]] = {}
    for number in range(len(body.independent_joints)):
        if number not in without:
            limbs.setdefault(find(_joint_id(body, number)), []).append(number)
    works_on = [find(joints[0]) if joints else -1 for joints in pulled]
    return [
        JointGroup(tuple(joints), tuple(a for a, limb in enumerate(works_on) if limb == which))
        for which, joints in limbs.items()
    ]


def _divided(body: Body, whole: JointGroup) -> list[JointGroup]:
    """Divide a limb where it branches: what carries the branches, and each of them.

    A limb without branches, or with an actuator or a coupling from what carries to what is carried,
    stays whole.
    """
    stem = _stem(body, whole.joints)
    if len(stem) in (0, len(whole.joints)):
        return [whole]
    branches = [limb for limb in _apart(body, stem) if set(limb.joints) <= set(whole.joints)]
    if len(branches) < 2 or _is_bridged(body, stem):
        return [whole]
    carried = tuple(joint for branch in branches for joint in branch.joints)
    return [
        JointGroup(stem, whole.actuators, seen=carried),
        *(replace(branch, seen=stem, base=stem) for branch in branches),
    ]


def _stem(body: Body, joints: tuple[int, ...]) -> tuple[int, ...]:
    """Those of a limb's joints that carry, or are carried by, every other one."""
    model = body.physics_model
    owner = {j: int(model.jnt_bodyid[_joint_id(body, j)]) for j in joints}

    def carries(lower: int, upper: int) -> bool:
        while upper > lower:
            upper = int(model.body_parentid[upper])
        return upper == lower

    return tuple(
        j
        for j in joints
        if all(carries(owner[j], owner[k]) or carries(owner[k], owner[j]) for k in joints)
    )


def _is_bridged(body: Body, stem: tuple[int, ...]) -> bool:
    """Whether an actuator or a coupling goes from joints of the stem to others."""
    model = body.physics_model
    inside = {_joint_id(body, j) for j in stem}
    together = [set(joints) for joints in _pulled(body)]
    together += [{model.joint(c.dependent).id, model.joint(c.driver).id} for c in body.couplings]
    return any(joints & inside and joints - inside for joints in together)


def _joint_id(body: Body, independent: int) -> int:
    return int(body.physics_model.joint(body.independent_joints[independent]).id)


def _own(model: mujoco.MjModel, body: int, moves: list[bool]) -> list[int]:
    """The joints of a body that move."""
    first = int(model.body_jntadr[body])
    return [j for j in range(first, first + int(model.body_jntnum[body])) if moves[j]]


def _above(model: mujoco.MjModel, body: int, moves: list[bool]) -> list[int]:
    """The nearest moving joint above a body; empty if there is none."""
    above = int(model.body_parentid[body])
    while above != 0:
        own = _own(model, above, moves)
        if own:
            return own[-1:]
        above = int(model.body_parentid[above])
    return []


def _pulled(body: Body) -> list[list[int]]:
    """Of every action, the joints that its actuator pulls at in some posture."""
    model = body.physics_model
    data = mujoco.MjData(model)
    rng, (low, high) = np.random.default_rng(0), body.joint_ranges.T
    pulls = np.zeros((model.nu, model.nv), dtype=bool)
    for _ in range(_TRIALS):
        data.qpos[:] = body.coupled_qpos(rng.uniform(low, high))
        mujoco.mj_forward(model, data)
        moment = moment_arms(model, data)
        pulls |= np.abs(moment) > 1e-9
    joint_of = np.array(model.dof_jntid)
    ids = [model.actuator(name).id for name in body.action_names]
    return [sorted({int(joint_of[dof]) for dof in np.flatnonzero(pulls[i])}) for i in ids]


def _alike(body: Body, one: JointGroup, other: JointGroup) -> bool:
    """Whether two limbs, on nothing that moves, accelerate nearly alike in the same states."""
    if (len(one.joints), len(one.actuators)) != (len(other.joints), len(other.actuators)):
        return False
    if one.seen or other.seen:
        return False
    ranges = body.joint_ranges
    if not np.allclose(ranges[list(one.joints)], ranges[list(other.joints)]):
        return False
    rng, (low, high) = np.random.default_rng(1), ranges.T
    for _ in range(_TRIALS):
        angles, speeds = rng.uniform(low, high), rng.normal(0.0, 2.0, len(low))
        drives = rng.uniform(0.0, 1.0, body.action_size)
        for values, first, second in (
            (angles, one.joints, other.joints),
            (speeds, one.joints, other.joints),
            (drives, one.actuators, other.actuators),
        ):
            values[list(second)] = values[list(first)]
        # (J,) of the independent joints, rad/s^2, with the dependent joints at rest.
        model = body.physics_model
        data = mujoco.MjData(model)
        data.qpos[:] = body.coupled_qpos(angles)
        data.qvel[body.qvel_independent] = speeds
        for name, drive in zip(body.action_names, drives, strict=True):
            i = model.actuator(name).id
            accelerations_low, accelerations_high = (
                model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else (0.0, 1.0)
            )
            data.ctrl[i] = accelerations_low + drive * (accelerations_high - accelerations_low)
            if model.actuator_actadr[i] >= 0:
                data.act[model.actuator_actadr[i]] = drive
        mujoco.mj_forward(model, data)
        accelerations: NDArray[np.float64] = data.qacc[body.qvel_independent].copy()
        moved = accelerations
        mine, others = moved[list(one.joints)], moved[list(other.joints)]
        if np.abs(mine - others).max() > _ALIKE * np.abs(mine).max():
            return False
    return True
