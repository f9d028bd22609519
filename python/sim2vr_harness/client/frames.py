"""The one place that converts MuJoCo's frame to the app's.

MuJoCo: right-handed, x forward, y left, z up, quaternions w x y z. App (Unity's convention):
left-handed, x right, y up, z forward, quaternions x y z w. Positions are metres in both; the
origin (on the floor below the body) is shared. Source: SIM2VR reference, coordinates.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.base.rotations import turned

Float64Array = NDArray[np.float64]

_TO_APP, _SIGNS = np.array([1, 2, 0, 5, 6, 4, 3]), np.array([-1.0, 1, 1, -1, 1, 1, -1])


def position_to_app(position: ArrayLike) -> Float64Array:
    """MuJoCo positions to the app's frame.

    Args:
        position: (..., 3) x forward, y left, z up, m.

    Returns:
        (..., 3) x right, y up, z forward, m.
    """
    p = np.asarray(position, dtype=np.float64)
    return np.stack([-p[..., 1], p[..., 2], p[..., 0]], axis=-1)


def position_to_mujoco(position: ArrayLike) -> Float64Array:
    """Inverse of :func:`position_to_app`, (..., 3) -> (..., 3)."""
    p = np.asarray(position, dtype=np.float64)
    return np.stack([p[..., 2], -p[..., 0], p[..., 1]], axis=-1)


def rotation_to_app(quat_wxyz: ArrayLike) -> Float64Array:
    """MuJoCo rotations to the app's frame.

    Args:
        quat_wxyz: (..., 4) unit quaternions, w first, body to world.

    Returns:
        (..., 4) unit quaternions, w last, body to world in the app's frame. A body's own axes are
        converted like the world's: its x forward becomes z forward.
    """
    q = np.asarray(quat_wxyz, dtype=np.float64)
    return np.stack([-q[..., 2], q[..., 3], q[..., 1], -q[..., 0]], axis=-1)


def rotation_to_mujoco(quat_xyzw: ArrayLike) -> Float64Array:
    """Inverse of :func:`rotation_to_app`, (..., 4) w last -> (..., 4) w first."""
    q = np.asarray(quat_xyzw, dtype=np.float64)
    return np.stack([-q[..., 3], q[..., 2], -q[..., 0], q[..., 1]], axis=-1)


def pose_to_mujoco(pose: ArrayLike) -> tuple[Float64Array, Float64Array]:
    """Inverse of :func:`pose_to_app`: (..., 7) -> positions (..., 3), quaternions w x y z (..., 4).

    Unlike :func:`rotation_to_mujoco` alone it gives each rotation the sign with w of 0 or more.
    """
    rows = np.asarray(pose, dtype=np.float64)
    quat = rotation_to_mujoco(rows[..., 3:])
    return position_to_mujoco(rows[..., :3]), np.where(quat[..., :1] < 0.0, -quat, quat)


def scale_to_mujoco(scale: ArrayLike) -> Float64Array:
    """Sizes along a body's own x right, y up, z forward as those along x forward, y left, z up."""
    s = np.asarray(scale, dtype=np.float64)
    return np.stack([s[..., 2], s[..., 0], s[..., 1]], axis=-1)


def triangles_to_mujoco(triangles: NDArray[np.integer]) -> NDArray[np.int64]:
    """Corners (T, 3) of triangles, from clockwise fronts (left-handed) to counter-clockwise ones.

    The corners' own coordinates are those of :func:`position_to_mujoco`.
    """
    return np.asarray(triangles, dtype=np.int64)[:, ::-1].copy()


def pose_to_app(position: ArrayLike, quat_wxyz: ArrayLike) -> Float64Array:
    """MuJoCo poses as the app's pose rows.

    Args:
        position: (..., 3) m. quat_wxyz: (..., 4) unit quaternions.

    Returns:
        (..., 7): position x y z in m, rotation x y z w, app frame.
    """
    # As position_to_app and rotation_to_app have it, at once.
    rows = np.concatenate([position, quat_wxyz], axis=-1, dtype=np.float64)
    return np.asarray(rows[..., _TO_APP] * _SIGNS)


AIM_DIRECTION: Float64Array = np.array([0.5, 0.0, -np.sqrt(0.75)])
"""(3,) of a controller's aim ray in the controller's own axes, MuJoCo's frame (x forward, y left,
z up): 60 degrees below forward, as a Touch controller's. The ray begins at the grip pose
(``xr::kGripToAim``; ``GRIP_TO_RAY`` of pages)."""


def aim_direction(quat_wxyz: ArrayLike) -> Float64Array:
    """Return the direction of the aim ray of controllers with these rotations.

    Args:
        quat_wxyz: (..., 4) unit quaternions, w first, controller to MuJoCo's world.

    Returns:
        (..., 3) unit vectors, MuJoCo's world; the rays begin where the controllers are.
    """
    q = np.asarray(quat_wxyz, dtype=np.float64)
    return turned(q[..., 1:], q[..., :1], AIM_DIRECTION)
