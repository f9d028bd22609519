"""MuJoCo <-> app frame conversion, against numbers of the SIM2VR reference and by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim2vr_harness.client import frames
from sim2vr_harness.client.frames import aim_direction, position_to_app, rotation_to_app

# Handedness flip as a matrix: app = FLIP @ mujoco.
FLIP = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def test_axes_map_forward_left_up_to_right_up_forward() -> None:
    forward, left, up = np.eye(3)
    np.testing.assert_array_equal(position_to_app(forward), [0, 0, 1])
    np.testing.assert_array_equal(position_to_app(left), [-1, 0, 0])
    np.testing.assert_array_equal(position_to_app(up), [0, 1, 0])


def test_recorded_start_poses_of_the_reference() -> None:
    # Headset and right controller of a recorded run, both frames given (reference, coordinates).
    np.testing.assert_allclose(
        position_to_app([0.138642, -0.001594, 1.16992]), [0.001594, 1.16992, 0.138642]
    )
    # The headset looks 10 degrees down: about MuJoCo's y axis, about the app's x axis.
    half = np.deg2rad(10.0) / 2
    q = rotation_to_app([np.cos(half), 0.0, np.sin(half), 0.0])
    np.testing.assert_allclose(q, [-0.0871557, 0.0, 0.0, -0.9961947], atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_rotation_agrees_with_the_matrix_form(seed: int) -> None:
    quat_xyzw = Rotation.random(random_state=seed).as_quat()
    expected = FLIP @ Rotation.from_quat(quat_xyzw).as_matrix() @ FLIP.T
    converted = rotation_to_app(quat_xyzw[[3, 0, 1, 2]])
    np.testing.assert_allclose(Rotation.from_quat(converted).as_matrix(), expected, atol=1e-12)


def test_poses_come_back() -> None:
    rng = np.random.default_rng(4)
    rows = np.concatenate([rng.standard_normal((20, 3)), rng.standard_normal((20, 4))], axis=1)
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1)[:, None]
    position, quat = frames.pose_to_mujoco(rows)
    assert (quat[:, 0] >= 0.0).all()
    back = frames.pose_to_app(position, quat)
    np.testing.assert_allclose(back[:, :3], rows[:, :3])
    signs = np.sign((back[:, 3:] * rows[:, 3:]).sum(axis=1))
    np.testing.assert_allclose(back[:, 3:] * signs[:, None], rows[:, 3:], atol=1e-12)


def test_fronts_of_triangles_stay_fronts() -> None:
    # A sheet that faces the viewer who looks ahead, along the app's z: (b - a) x (c - a) points
    # back at the viewer, to -z there and to -x in MuJoCo's world.
    vertices = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    a, b, c = vertices
    assert np.cross(b - a, c - a)[2] < 0.0
    moved = frames.position_to_mujoco(vertices)
    (corners,) = frames.triangles_to_mujoco(np.array([[0, 1, 2]]))
    a, b, c = moved[corners]
    np.testing.assert_allclose(np.cross(b - a, c - a), [-1.0, 0.0, 0.0])
    np.testing.assert_allclose(frames.scale_to_mujoco([1.0, 2.0, 3.0]), [3.0, 1.0, 2.0])


def test_the_aim_ray_leaves_the_grip_60_degrees_below_forward() -> None:
    level = aim_direction([1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(level, [0.5, 0.0, -np.sqrt(3.0) / 2.0])
    # Pitched up by 60 degrees (about y, which points left, by -60): the ray is level.
    pitched = aim_direction([np.cos(np.pi / 6), 0.0, -np.sin(np.pi / 6), 0.0])
    np.testing.assert_allclose(pitched, [1.0, 0.0, 0.0], atol=1e-12)
    # Rolled by a quarter turn about forward (left to up): what pointed down points left.
    rolled = aim_direction([[np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]])
    np.testing.assert_allclose(rolled, [[0.5, np.sqrt(3.0) / 2.0, 0.0]], atol=1e-12)
