"""Pictures of the simulated user, without a display and without a GPU."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.base.gl import prepare_process
from sim2vr_harness.client import AppScene, Observed, Observer, SceneMesh, SceneObject
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.users.appearance import colour_muscles
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.kinematics.forward import rotation_matrix

_FLOOR_GAP_M = 0.01
_NAME = "app_mesh_{}"
_DEGENERATE_M2 = 1e-14
_GLOW = 0.6
"""Brightness of an unlit surface as a proportion of its own colour; lamps add to it."""
_PLATFORMS = ("egl", "osmesa")  # EGL also works on Mesa's software rasteriser


@dataclass(frozen=True)
class OrbitView:
    """A camera that looks at a place.

    Attributes:
        towards_m: the place, MuJoCo's world.
        distance_m: from there.
        azimuth_deg: of the direction of view about the vertical; 0 looks ahead, 90 to the left.
        elevation_deg: of the direction of view; negative looks down.
    """

    towards_m: tuple[float, float, float]
    distance_m: float
    azimuth_deg: float
    elevation_deg: float


class RenderingError(RuntimeError):
    """No OpenGL platform could be started on this machine."""


class UserRenderer:
    """Draws one user off-screen. Owns an OpenGL context: close it, or use it in a `with` block.

    Use it from the thread that made it. One renderer can draw any user of a batch, one after the
    other.

    Args:
        body: a body loaded with `appearance=True`.
        width: image width in pixels, at most 1280.
        height: image height in pixels, at most 960.

    Raises:
        ValueError: the body has no appearance or the size is out of range.
        RenderingError: neither EGL nor OSMesa works. MUJOCO_GL=egl|osmesa forces one of them.
    """

    def __init__(self, body: Body, width: int = 640, height: int = 480) -> None:
        if not body.appearance:
            raise ValueError("body: got appearance=False, expected load_body(appearance=True)")
        self._body, self._muscles = body, body.muscles
        self._model = body.spec().compile()  # own copy: muscle colours are written into it
        self._meshes = 0
        limits = self._model.vis.global_
        for field, size, limit in (
            ("width", width, limits.offwidth),
            ("height", height, limits.offheight),
        ):
            if not 1 <= size <= limit:
                raise ValueError(f"{field}: got {size}, expected 1 to {limit} pixels")
        self.width, self.height = width, height
        self._options = mujoco.MjvOption()
        self._context = _open_context(width, height)
        self._painter: mujoco.MjrContext | None = None
        self._prepare()

    def _prepare(self) -> None:
        """Make ready to draw the model, in the place of the one before."""
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, maxgeom=10_000)
        # Sheets are seen from both sides.
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE.value] = 0
        self._context.make_current()
        if self._painter is not None:
            self._painter.free()
        self._painter = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._painter)

    def _learn(self, scene: AppScene) -> None:
        """Take in shapes of the app that were not there before."""
        if len(scene.meshes) == self._meshes:
            return
        spec = self._body.spec()
        _add_meshes(spec, scene.meshes)
        self._model, self._meshes = spec.compile(), len(scene.meshes)
        # The app's floor, where it has one, lies on the room's.
        self._model.geom_pos[self._planes, 2] -= _FLOOR_GAP_M
        self._prepare()

    @property
    def _planes(self) -> NDArray[np.bool_]:
        return self._model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE

    def observer(self, camera: str, width: int, height: int) -> Observer:
        """Return a camera of the model as one of the app's, for the argument ``behind``."""
        found = self._model.camera(camera)
        quat = np.empty(4)
        right, up, back = rotation_matrix(found.quat).T
        mujoco.mju_mat2Quat(quat, np.stack([-back, -right, up], axis=1).ravel())
        pose = tuple(pose_to_app(found.pos, quat).tolist())
        return Observer(width, height, pose, float(found.fovy[0]))

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the model's cameras."""
        return tuple(self._model.camera(i).name for i in range(self._model.ncam))

    def render(
        self,
        qpos: NDArray[np.floating] | mujoco.MjData,
        camera: str | OrbitView = "front",
        activations: NDArray[np.floating] | None = None,
        scene: AppScene | None = None,
        behind: Observed | None = None,
    ) -> NDArray[np.uint8]:
        """Draws a posture.

        Args:
            qpos: (nq,) posture in rad, e.g. `batch.qpos[i]`, or an MjData of the body's model,
                whose activations then colour the muscles.
            camera: one of `cameras`, or a view of one's own.
            activations: (M,) muscle activations in [0, 1] that colour the muscles, skin to red.
            scene: of the app that the user plays in, to be drawn around the user.
            behind: the app's own picture from this camera (:meth:`observer`), in the place of the
                room; the image is a whole number of times as large. The user covers what is further
                away.

        Returns:
            (height, width, 3) uint8 RGB image, owned by the caller.

        Raises:
            ValueError: wrong shape, or unknown camera.
            RenderingError: the renderer was closed.
        """
        if self._painter is None:
            raise RenderingError("render was called after close")
        if isinstance(camera, str) and camera not in self.cameras:
            raise unknown_name("camera", camera, self.cameras)
        if scene is not None:
            self._learn(scene)
        self._pose(qpos, activations)
        self._model.geom_rgba[self._planes, 3] = behind is None
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        # MuJoCo's camera of a name, or of a view.
        view = mujoco.MjvCamera()
        if isinstance(camera, str):
            view.type = mujoco.mjtCamera.mjCAMERA_FIXED
            view.fixedcamid = self._model.camera(camera).id
        else:
            view.type = mujoco.mjtCamera.mjCAMERA_FREE
            view.lookat[:], view.distance = camera.towards_m, camera.distance_m
            view.azimuth, view.elevation = camera.azimuth_deg, camera.elevation_deg
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            self._options,
            None,
            view,
            everything,
            self._scene,
        )
        if scene is not None:
            _put_objects(self._model, self._scene, scene, self._meshes)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX.value] = behind is None
        # Scene as (height, width, 3) RGB.
        self._context.make_current()
        window = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(window, self._scene, self._painter)
        image = np.empty((self.height, self.width, 3), dtype=np.uint8)
        depth = None if behind is None else np.empty((self.height, self.width), np.float32)
        mujoco.mjr_readPixels(image, depth, window, self._painter)
        if behind is None or depth is None or behind.depth_m is None:
            return np.ascontiguousarray(image[::-1])
        clip, extent_m = self._model.vis.map, self._model.stat.extent
        near, far = clip.znear * extent_m, clip.zfar * extent_m
        image, depth = image[::-1], depth[::-1]
        depth_m = near / (1.0 - depth * (1.0 - near / far))
        times = self.height // len(behind.rgb)
        rgb, far_m = (
            each.repeat(times, axis=0).repeat(times, axis=1)
            for each in (behind.rgb, behind.depth_m)
        )
        nearer = (depth < 1.0) & (depth_m < far_m)
        return np.where(nearer[..., None], image, rgb)

    def project(self, places: NDArray[np.floating], view: OrbitView) -> NDArray[np.float64]:
        """Return where places are in a picture of a view, pixels from its left and top.

        Args:
            places: (N, 3) MuJoCo's world, m, in front of the camera.
            view: as drawn.

        Returns:
            (N, 2).
        """
        a, e = np.radians([view.azimuth_deg, view.elevation_deg])
        ahead = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        axes = np.stack([right, -np.cross(right, ahead), ahead], axis=1)
        aside, down, depth = ((places - view.towards_m) @ axes + [0.0, 0.0, view.distance_m]).T
        scale = 0.5 * self.height / np.tan(np.radians(self._model.vis.global_.fovy) / 2.0)
        middle = np.array([self.width, self.height]) / 2.0
        return middle + scale * np.stack([aside, down], axis=1) / depth[:, None]

    def _pose(
        self,
        qpos: NDArray[np.floating] | mujoco.MjData,
        activations: NDArray[np.floating] | None,
    ) -> None:
        """Put the drawn body into a posture, and colour its muscles."""
        if isinstance(qpos, mujoco.MjData):
            if activations is None:
                muscles = [self._model.actuator(m).id for m in self._muscles]
                activations = np.array(qpos.act[self._model.actuator_actadr[muscles]])
            qpos = np.array(qpos.qpos)
        posture = np.asarray(qpos, dtype=np.float64)
        if posture.shape != (self._model.nq,):
            raise ValueError(f"qpos: got shape {posture.shape}, expected ({self._model.nq},)")
        self._data.qpos[:] = posture
        mujoco.mj_fwdPosition(self._model, self._data)
        relaxed = np.zeros(len(self._muscles))
        colour_muscles(self._model, self._muscles, relaxed if activations is None else activations)

    def close(self) -> None:
        """Frees the OpenGL context. Safe to call twice."""
        if self._painter is not None:
            self._context.make_current()
            self._painter.free()
            self._painter = None
            self._context.free()

    def __enter__(self) -> UserRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _add_meshes(spec: mujoco.MjSpec, meshes: Sequence[SceneMesh]) -> None:
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


def _put_objects(model: mujoco.MjModel, scene: mujoco.MjvScene, app: AppScene, known: int) -> None:
    """Put what an app shows into a scene, behind what is there; the player's stand-in is left out.

    Args:
        model: with the app's first ``known`` shapes (:func:`_add_meshes`).
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


def _open_context(width: int, height: int) -> Any:
    """Opens EGL, or OSMesa where EGL fails, unless MUJOCO_GL names one of them."""
    prepare_process()
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    reasons = []
    for platform in (wanted,) if wanted in _PLATFORMS else _PLATFORMS:
        # PyOpenGL binds itself to one platform when first imported, by a variable that MuJoCo's
        # modules set. What a failed attempt imported must not block the next platform.
        before, imported = os.environ.get("PYOPENGL_PLATFORM"), set(sys.modules)
        try:
            context = importlib.import_module(f"mujoco.{platform}").GLContext(width, height)
            os.environ["MUJOCO_GL"] = platform  # tells MuJoCo where to load OpenGL from
            return context
        except Exception as error:  # a driver may fail with about any type
            reasons.append(f"{platform}: {error}")
            if before is None:
                os.environ.pop("PYOPENGL_PLATFORM", None)
            for module in set(sys.modules) - imported:
                if module.split(".")[0] == "OpenGL" or module.startswith("mujoco.egl"):
                    del sys.modules[module]
    raise RenderingError(
        "no OpenGL platform works for off-screen rendering (" + "; ".join(reasons) + "). Install "
        "Mesa's EGL or OSMesa library, or set MUJOCO_GL to the one that this machine has"
    )
