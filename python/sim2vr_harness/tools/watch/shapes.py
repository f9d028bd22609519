"""A body's drawn shapes as triangles, for viewers outside MuJoCo."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import Body

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SEGMENTS = 12
_TILTS = np.pi * np.array([0.0, 0.15, 0.3, 0.44])
"""Of the rings of half a ball."""
_RELAXED, _ACTIVE = np.array([64, 92, 184]), np.array([224, 31, 26])
"""As in pictures (``users/appearance.py``)."""
_LEAST_ALPHA = 0.05
_SEEN_GROUPS = (0, 1, 2)


@dataclass(frozen=True)
class BodyShape:
    """What a part of the body looks like in one colour.

    Attributes:
        part: number of the part in the model.
        name: unique.
        vertices: (V, 3) in the part's frame, m.
        faces: (F, 3).
        color: red, green, blue, 0 to 255.
    """

    part: int
    name: str
    vertices: FloatArray
    faces: IntArray
    color: tuple[int, int, int]


@dataclass(frozen=True)
class Posture:
    """Where a body's parts and muscles are.

    Attributes:
        positions: (parts, 3) MuJoCo's world, m.
        quats: (parts, 4) w x y z.
        muscles: (S, 2, 3) ends of the pieces of muscles.
        colors: (S, 2, 3) uint8, blue (relaxed) to red (fully active).
    """

    positions: FloatArray
    quats: FloatArray
    muscles: FloatArray
    colors: NDArray[np.uint8]


class Poser:
    """Works out postures.

    Args:
        body: loaded with `appearance=True`.
    """

    def __init__(self, body: Body) -> None:
        self._model = body.model
        self._data = mujoco.MjData(self._model)
        self._tendon_muscle = np.full(self._model.ntendon, -1)
        for row, name in enumerate(body.muscles):
            actuator = self._model.actuator(name).id
            if self._model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON:
                self._tendon_muscle[self._model.actuator_trnid[actuator, 0]] = row

    def pose(self, qpos: FloatArray, activations: FloatArray) -> Posture:
        """Return the posture of angles (nq,) and activations (M,) of the muscles."""
        data = self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_tendon(self._model, data)
        places = np.array(data.wrap_xpos).reshape(-1, 3)
        pieces, colors = [np.empty((0, 2, 3))], [np.empty((0, 2, 3))]
        for tendon in np.flatnonzero(self._tendon_muscle >= 0):
            first, count = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
            path = places[first : first + count]
            level = float(np.clip(activations[self._tendon_muscle[tendon]], 0.0, 1.0))
            color = _RELAXED + level * (_ACTIVE - _RELAXED)
            pieces.append(np.stack([path[:-1], path[1:]], axis=1))
            colors.append(np.broadcast_to(color, (max(count - 1, 0), 2, 3)))
        return Posture(
            np.array(data.xpos),
            np.array(data.xquat),
            np.concatenate(pieces),
            np.concatenate(colors).astype(np.uint8),
        )


def body_shapes(body: Body) -> list[BodyShape]:
    """Return the shapes of a body that was loaded with `appearance=True`, the floor left out."""
    model = body.model
    parts: dict[tuple[int, tuple[int, int, int]], list[tuple[FloatArray, IntArray]]] = {}
    for geom in range(model.ngeom):
        material = int(model.geom_matid[geom])
        color_rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        rgba = np.asarray(color_rgba, dtype=np.float64)
        if model.geom_group[geom] not in _SEEN_GROUPS or rgba[3] < _LEAST_ALPHA:
            continue
        shape = _shape(model, geom)
        if shape is None:
            continue
        vertices, faces = shape
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        placed = vertices @ turn.reshape(3, 3).T + model.geom_pos[geom]
        red, green, blue = (int(255 * channel) for channel in rgba[:3])
        parts.setdefault((int(model.geom_bodyid[geom]), (red, green, blue)), []).append(
            (placed, faces)
        )
    shapes = []
    for (part, color), own in parts.items():
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in own)])
        faces = np.concatenate([f + start for (_, f), start in zip(own, starts, strict=False)])
        vertices = np.concatenate([vertices for vertices, _ in own])
        name = f"{model.body(part).name}_{bytes(color).hex()}"
        shapes.append(BodyShape(part, name, vertices, faces, color))
    return shapes


def _shape(model: mujoco.MjModel, geom: int) -> tuple[FloatArray, IntArray] | None:
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        return vertices, np.array(model.mesh_face[face : face + faces], dtype=np.int64)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
        return _rings([(z, ring) for z in (-1.0, 1.0)], size)
    angles = 2.0 * np.pi * np.arange(_SEGMENTS) / _SEGMENTS
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        radii = np.full(3, size[0]) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
        return _rings([(np.sin(a), np.cos(a) * circle) for a in (*-_TILTS[:0:-1], *_TILTS)], radii)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _rings([(-1.0, circle), (1.0, circle)], [size[0], size[0], size[1]])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = size[1] / size[0]
        upper = [(np.sin(a) + half, np.cos(a) * circle) for a in _TILTS]
        lower = [(-height, ring) for height, ring in upper[::-1]]
        return _rings([*lower, *upper], [size[0]] * 3)
    return None  # planes: the viewer has a floor


def _rings(
    rings: list[tuple[float, FloatArray]], scale: FloatArray | list[float]
) -> tuple[FloatArray, IntArray]:
    """A closed skin over rings of as many corners, (height, (K, 2)) from low to high."""
    count = len(rings[0][1])
    vertices = [np.column_stack([ring, np.full(count, height)]) for height, ring in rings]
    ids = np.arange(len(rings) * count).reshape(len(rings), count)
    here, beside = ids, np.roll(ids, -1, axis=1)
    faces = [
        np.stack([here[:-1], beside[:-1], beside[1:]], axis=-1).reshape(-1, 3),
        np.stack([here[:-1], beside[1:], here[1:]], axis=-1).reshape(-1, 3),
    ]
    for ring in (ids[0, ::-1], ids[-1]):
        faces.append(
            np.stack([np.full(count - 2, ring[0]), ring[1:-1], ring[2:]], axis=-1).reshape(-1, 3)
        )
    return np.concatenate(vertices) * np.asarray(scale), np.concatenate(faces)
