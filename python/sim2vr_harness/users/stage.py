"""An app's objects in the pictures of a user: both in one scene, in MuJoCo's world."""

from collections.abc import Sequence

import mujoco
import numpy as np

from sim2vr_harness.client import AppScene, SceneMesh, SceneObject
from sim2vr_harness.users.kinematics.forward import rotation_matrix

_NAME = "app_mesh_{}"
_DEGENERATE_M2 = 1e-14
_GLOW = 0.6
"""How much of its own colour an unlit surface shows without light; lamps add to it."""


def add_meshes(spec: mujoco.MjSpec, meshes: Sequence[SceneMesh]) -> None:
    """Add an app's shapes to a specification, so that a drawing context knows them."""
    for number, mesh in enumerate(meshes):
        vertices, triangles = mesh.in_mujoco()
        corners = vertices[triangles]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        kept = triangles[(area * area).sum(axis=1) > _DEGENERATE_M2**2]
        added = spec.add_mesh(name=_NAME.format(number))
        added.uservert = vertices.ravel()
        added.userface = kept.ravel()
        added.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # sheets are not closed


def put_objects(model: mujoco.MjModel, scene: mujoco.MjvScene, app: AppScene, known: int) -> None:
    """Put what an app shows into a scene, behind what is there; the player's stand-in is left out.

    Args:
        model: with the app's first ``known`` shapes (:func:`add_meshes`).
        scene: to be drawn.
        app: the app's moment.
        known: number of shapes.
    """
    for one in app.drawn():
        if one.mesh is not None and one.mesh < known and scene.ngeom < scene.maxgeom:
            _put(model, scene, one)


def _put(model: mujoco.MjModel, scene: mujoco.MjvScene, one: SceneObject) -> None:
    mesh = model.mesh(_NAME.format(one.mesh)).id
    position, quat, scale = one.in_mujoco()
    # MuJoCo moves a mesh to its middle and along its main axes; the scale comes before that.
    linear = rotation_matrix(quat) * scale
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_MESH.value,
        np.ones(3),
        position + linear @ model.mesh_pos[mesh],
        (linear @ rotation_matrix(model.mesh_quat[mesh])).ravel(),
        one.color.astype(np.float32),
    )
    geom.dataid = 2 * mesh  # the odd ones are convex hulls
    geom.specular, geom.emission = (0.0, _GLOW) if one.unlit else (0.2, 0.0)
    scene.ngeom += 1
