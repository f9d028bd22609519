"""Contents of an app's scene, for drawing and measuring it outside the app."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.frames import (
    pose_to_mujoco,
    position_to_mujoco,
    scale_to_mujoco,
    triangles_to_mujoco,
)

Float64Array = NDArray[np.float64]

PLAYER_LAYER = 31
"""Of what stands for the player in pictures from outside (``rl::kPlayerLooksLayer``): headset,
hands. Code that draws the body itself leaves it out."""
POINTERS = ("Ray", "Cursor")
"""Objects that show the pointing direction of a hand in our games; these are no targets."""


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """A shape, app frame.

    Attributes:
        vertices: (V, 3) float32.
        triangles: (T, 3) int64 indices of vertices; fronts are clockwise.
    """

    name: str
    vertices: NDArray[np.float32]
    triangles: NDArray[np.int64]

    def in_mujoco(self) -> tuple[Float64Array, NDArray[np.int64]]:
        """Vertices (V, 3) and triangles (T, 3) in MuJoCo's frame, fronts counter-clockwise."""
        return position_to_mujoco(self.vertices), triangles_to_mujoco(self.triangles)


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An active object, and one thing that it shows; one that shows several comes as often.

    Attributes:
        id: the object's own within a round.
        path: its name and those above it, such as ``XR Rig/RightHand Controller/Hammer``.
        layer: 0 to 31.
        mesh: number of its shape in :attr:`AppScene.meshes`; None: it shows nothing.
        pose: (7,) position x y z (m), rotation x y z w, app frame.
        scale: (3,) along the shape's own axes.
        color: (4,) red, green, blue (sRGB) and opacity, 0 to 1.
        unlit: shown in its colour whatever the light.
    """

    id: int
    path: str
    layer: int
    mesh: int | None
    pose: Float64Array
    scale: Float64Array
    color: NDArray[np.float32]
    unlit: bool

    def in_mujoco(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Position (3,), quaternion w x y z (4,) and scale (3,) in MuJoCo's frame."""
        position, quat = pose_to_mujoco(self.pose)
        return position, quat, scale_to_mujoco(self.scale)


@dataclass(frozen=True)
class Observer:
    """A camera besides the user's eyes, for pictures of the app in any size.

    Attributes:
        width: Pixels.
        height: Pixels.
        pose: Position x y z (m), rotation x y z w, app frame; the direction of view is its z axis.
            None: the head's.
        vertical_fov_deg: Vertical angle of view.
    """

    width: int
    height: int
    pose: tuple[float, ...] | None = None
    vertical_fov_deg: float = 90.0


@dataclass(frozen=True, eq=False)
class Observed:
    """An observer's picture.

    Attributes:
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) along the direction of view, infinite where nothing is; None for
            observers at the head.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class AppScene:
    """A moment of an app's scene.

    Attributes:
        objects: in order of creation.
        meshes: their shapes; a shape keeps its number for the app's life.
    """

    objects: tuple[SceneObject, ...]
    meshes: tuple[SceneMesh, ...]

    @classmethod
    def of_columns(cls, columns: Sequence[Any], meshes: Sequence[SceneMesh]) -> AppScene:
        """Return the scene that the extension module reported.

        Args:
            columns: paths, objects, layers, meshes, poses, scales, colours, unlit.
            meshes: of these numbers.
        """
        paths, ids, layers, numbers, poses, scales, colors, unlit = columns
        objects = tuple(
            SceneObject(
                int(ids[i]),
                path,
                int(layers[i]),
                None if numbers[i] < 0 else int(numbers[i]),
                poses[i],
                scales[i],
                colors[i],
                bool(unlit[i]),
            )
            for i, path in enumerate(paths)
        )
        return cls(objects, tuple(meshes))

    def drawn(self, *, player: bool = False) -> Iterator[SceneObject]:
        """Objects that show something.

        Args:
            player: Whether what stands for the player is among them (:data:`PLAYER_LAYER`).
        """
        for one in self.objects:
            if one.mesh is not None and (player or one.layer != PLAYER_LAYER):
                yield one

    def named(self, pattern: str) -> list[SceneObject]:
        """Objects whose path, or last part of it, fits a pattern with ``*`` and ``?``."""
        return [
            one
            for one in self.objects
            if fnmatchcase(one.path, pattern) or fnmatchcase(one.path.rpartition("/")[2], pattern)
        ]
