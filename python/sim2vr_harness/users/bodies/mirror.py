"""Left-handers: a body mirrored across its sagittal plane.

The world's y turns round (x forward, y left, z up). Every body's frame is mirrored along the axis
of its own that lies nearest to the world's y, so that anatomical frames stay anatomical: a frame
with z to the right gets one with z to the left. With D that reflection, places become D p,
rotations D R D and, because hinge axes are pseudovectors, axes -D a; a hinge keeps its angles and
range, a muscle its activations. All of it changes signs only, so the motion is mirrored to the bit
of each operation.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.body import DEVICES
from sim2vr_harness.users.bodies.meshes import Pose, change_mesh_geoms, rescale_meshes

FloatArray = NDArray[np.float64]

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_SWAP = {"controller_right": "controller_left", "controller_left": "controller_right"}


def mirror(spec: mujoco.MjSpec) -> None:
    """Mirrors the body and the views of it, in place; the controllers change hands.

    Names stay, but for the devices: a left-hander's `humerus_r` is the left one.

    Raises:
        ValueError: the body has a part that cannot be mirrored.
    """
    model = spec.compile()
    _refuse_what_cannot_be_mirrored(model)
    # (nbody, 3) signs of each body's reflection: -1 for the axis nearest to the world's y.
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    lateral = np.abs(data.xmat.reshape(-1, 3, 3)[:, 1, :])
    lateral[:, 1] += 1e-6  # of two equally near ones the y axis, as the world's
    flips = np.ones((model.nbody, 3))
    flips[np.arange(model.nbody), lateral.argmax(axis=1)] = -1.0
    for name in DEVICES:  # their frames are the devices' own: x forward, y left, z up
        i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if i >= 0:
            flips[i] = [1.0, -1.0, 1.0]
    parents = flips[model.body_parentid]
    for body in range(1, model.nbody):
        model.body_pos[body] *= parents[body]
        model.body_quat[body] = _mirrored(model.body_quat[body], parents[body], flips[body])
        model.body_ipos[body] *= flips[body]
        model.body_iquat[body] = _mirrored(model.body_iquat[body], flips[body], flips[body])
    joints = flips[model.jnt_bodyid]
    model.jnt_pos[:] *= joints
    slides = (model.jnt_type == _SLIDE)[:, None]
    model.jnt_axis[:] *= np.where(slides, joints, -joints)
    _mirror_poses(model.site_pos, model.site_quat, flips[model.site_bodyid])
    flips_of_shapes = flips.copy()
    flips_of_shapes[0] = 1.0  # what stands in the room stays, as writing would be unreadable
    for geom in np.flatnonzero(model.geom_type != mujoco.mjtGeom.mjGEOM_MESH).tolist():
        if model.geom_bodyid[geom] == 0:
            continue
        flip = flips[model.geom_bodyid[geom]]
        model.geom_pos[geom] *= flip
        model.geom_quat[geom] = _mirrored(model.geom_quat[geom], flip, flip)

    def mirrored(body: int, pose: Pose) -> Pose:
        if body == 0:
            return pose
        return pose[0] * flips[body], _mirrored(pose[1], flips[body], flips[body])

    shown = change_mesh_geoms(model, mirrored)
    # Cameras look along their -z with x to the right: their x is mirrored, whatever the body's.
    for camera in range(model.ncam):
        views_flip = flips[model.cam_bodyid[camera]]
        model.cam_pos[camera] *= views_flip
        x_flip = np.array([-1.0, 1.0, 1.0])
        model.cam_quat[camera] = _mirrored(model.cam_quat[camera], views_flip, x_flip)
    lights = flips[model.light_bodyid]
    model.light_pos[:] *= lights
    model.light_dir[:] *= lights
    model.opt.gravity[1] *= -1.0
    model.opt.wind[1] *= -1.0
    spec.copy_back(model)
    rescale_meshes(spec, model, shown, lambda body: tuple(flips_of_shapes[body].tolist()))
    _swap_controllers(spec)


def swapped(name: str) -> str:
    """Returns what a device is called when it has changed hands."""
    return _SWAP.get(name, name)


def _mirrored(quaternion: FloatArray, outer: FloatArray, inner: FloatArray) -> FloatArray:
    """The rotation D_outer R D_inner of reflections along one axis each; signs change only."""
    turned = np.array(quaternion)
    turned[1:] *= -outer  # D_outer R D_outer
    if (outer == inner).all():
        return turned
    # What is left, D_outer D_inner, is half a turn about the axis that neither reflects.
    half_turn = np.array([0.0, *((outer > 0) & (inner > 0)).astype(float)])
    product = np.empty(4)
    mujoco.mju_mulQuat(product, turned, half_turn)
    return product


def _mirror_poses(positions: FloatArray, quaternions: FloatArray, flips: FloatArray) -> None:
    positions[:] *= flips
    quaternions[:, 1:] *= -flips


def _swap_controllers(spec: mujoco.MjSpec) -> None:
    """Gives bodies and sites of the controllers each other's name, and their shapes' too."""
    for find in (spec.body, spec.site):
        held = {name: find(name) for name in _SWAP}
        for name, element in held.items():
            if element is not None:
                element.name = f"{name} changing hands"
        for name, element in held.items():
            if element is not None:
                element.name = _SWAP[name]


def _refuse_what_cannot_be_mirrored(model: mujoco.MjModel) -> None:
    for joint in range(model.njnt):
        if model.jnt_type[joint] not in (_SLIDE, _HINGE):
            raise ValueError(
                f"person.handedness: got a body with the joint {model.joint(joint).name!r}, which "
                "is neither a hinge nor a slide; expected hinges and slides, or the joint under "
                "locked_joints"
            )
    for i in range(model.neq):
        if model.eq_type[i] not in (int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)):
            raise ValueError(
                f"person.handedness: got a body with the equality {model.equality(i).name!r}, "
                "expected couplings of joints or tendons only"
            )
    allowed = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_TENDON))
    for i in range(model.nu):
        if model.actuator_trntype[i] not in allowed:
            raise ValueError(
                f"person.handedness: got a body with the actuator {model.actuator(i).name!r}, "
                "which acts on neither a joint nor a tendon; expected one that does"
            )
    if model.nflex:
        raise ValueError("person.handedness: got a body with a flex, expected rigid parts only")
