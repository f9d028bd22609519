"""Meshes of a page as boxes in a scene, for pictures of the body beside them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.scene import AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.webxr.replies import Box

_LARGEST_M = 30.0
"""What is longer is no thing that people meet."""
_FLOOR_M = 0.02
"""Pictures have a floor of their own."""


def _cube() -> SceneMesh:
    """Return a cube of 1 m around the origin."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    triangles = []
    for axis in range(3):
        for side in (-0.5, 0.5):
            face = np.flatnonzero(corners[:, axis] == side)
            for three in (face[[0, 1, 2]], face[[3, 2, 1]]):
                a, b, c = corners[three]
                # Clockwise from outside, in a left-handed frame: this product points outwards.
                outwards = np.cross(b - a, c - a)[axis] * side > 0.0
                triangles.append(three if outwards else three[::-1])
    return SceneMesh("box", corners.astype(np.float32), np.array(triangles, np.int64))


_CUBE = _cube()


def scene_of(boxes: Sequence[Box], head: NDArray[np.float64]) -> AppScene:
    """Return boxes as a scene; left out are rooms and skies, which the head is in, and floors.

    Args:
        boxes: the page's.
        head: (3,) where the head is, app frame, m.
    """
    objects = []
    for number, box in enumerate(boxes):
        length = float(np.linalg.norm(box.rotation))
        rotation = (
            np.array(box.rotation) / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])
        )
        way = head - np.array(box.place)
        axis, w = -rotation[:3], rotation[3]
        away = way + 2.0 * np.cross(axis, np.cross(axis, way) + w * way)
        size = np.array(box.size)
        within = (np.abs(away) <= size / 2.0).all()
        floor = size.min() < _FLOOR_M and abs(box.place[1]) < _FLOOR_M and size.max() > 1.0
        if size.max() > _LARGEST_M or within or floor:
            continue
        pose = np.concatenate([box.place, rotation])
        color = np.array(box.color, np.float32)
        objects.append(SceneObject(number, box.name, 0, 0, pose, size, color, unlit=False))
    return AppScene(tuple(objects), (_CUBE,))
