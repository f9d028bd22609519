"""Meshes whose size or handedness changes with the bodies that they are drawn on.

MuJoCo moves a mesh to its centre of mass when it compiles, so a geom's compiled pose is its own
pose followed by the mesh's. Here own poses are changed, and meshes by their scale.
"""

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Pose = tuple[FloatArray, FloatArray]
"""Position in m, unit quaternion w x y z."""

_MESH = mujoco.mjtGeom.mjGEOM_MESH


def compose(first: Pose, second: Pose) -> Pose:
    """Returns `second`, given in the frame `first`, in the frame that `first` is given in."""
    position, quaternion = np.zeros(3), np.zeros(4)
    mujoco.mju_mulPose(position, quaternion, *first, *second)
    return position, quaternion


def inverse(pose: Pose) -> Pose:
    """Returns the pose that undoes `pose`."""
    position, quaternion = np.zeros(3), np.zeros(4)
    mujoco.mju_negPose(position, quaternion, *pose)
    return position, quaternion


def change_mesh_geoms(
    model: mujoco.MjModel, change: Callable[[int, Pose], Pose]
) -> dict[str, list[int]]:
    """Changes the own poses of mesh geoms in `model`, in place.

    Args:
        model: the compiled model.
        change: (body, own pose) -> own pose.

    Returns:
        Mesh name -> the geoms that show it.
    """
    shown: dict[str, list[int]] = {}
    for geom in np.flatnonzero(model.geom_type == _MESH).tolist():
        mesh = int(model.geom_dataid[geom])
        centre = (np.array(model.mesh_pos[mesh]), np.array(model.mesh_quat[mesh]))
        compiled = (np.array(model.geom_pos[geom]), np.array(model.geom_quat[geom]))
        own = change(int(model.geom_bodyid[geom]), compose(compiled, inverse(centre)))
        model.geom_pos[geom], model.geom_quat[geom] = compose(own, centre)
        shown.setdefault(model.mesh(mesh).name, []).append(geom)
    return shown


def rescale_meshes(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    shown: dict[str, list[int]],
    factor: Callable[[int], tuple[float, float, float]],
) -> None:
    """Scales meshes by what the bodies that show them say; a mesh shown in several sizes is copied.

    Args:
        spec: what `model` was compiled of; changed in place.
        model: the compiled model.
        shown: from `change_mesh_geoms`.
        factor: body -> factors along the mesh's x, y, z; negative ones mirror.
    """
    for name, geoms in shown.items():
        original = spec.mesh(name)
        scale = np.array(original.scale)
        sizes: dict[tuple[float, float, float], list[int]] = {}
        for geom in geoms:
            sizes.setdefault(factor(int(model.geom_bodyid[geom])), []).append(geom)
        for number, (factors, users) in enumerate(sizes.items()):
            mesh = original
            if number:
                # Adds a mesh with the vertices and faces that the model has of another one.
                copy = f"{name}_size{number}"
                i = model.mesh(name).id
                first, count = int(model.mesh_vertadr[i]), int(model.mesh_vertnum[i])
                face, faces = int(model.mesh_faceadr[i]), int(model.mesh_facenum[i])
                rotation = np.zeros(9)
                mujoco.mju_quat2Mat(rotation, model.mesh_quat[i])
                vertices = model.mesh_vert[first : first + count] @ rotation.reshape(3, 3).T
                copy_mesh = spec.add_mesh(name=copy)
                copy_mesh.uservert = (vertices + model.mesh_pos[i]).ravel()
                copy_mesh.userface = np.array(model.mesh_face[face : face + faces]).ravel()
                copy_mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
                mesh = copy_mesh
                for geom in users:
                    spec.geoms[geom].meshname = mesh.name
            mesh.scale = (scale if number == 0 else np.ones(3)) * factors
