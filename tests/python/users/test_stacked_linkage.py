"""Stacked linkages: many bodies at once move as MuJoCo moves each of them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client.frames import aim_direction
from sim2vr_harness.users import Body, load_body
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import solve
from sim2vr_harness.users.kinematics.stacked import StackedLinkage

GRIP = Point("controller_right")
AIM = Point("controller_right", (0.5, 0.0, -float(np.sqrt(0.75))))


@pytest.fixture(scope="module")
def bodies() -> list[Body]:
    sizes = [
        Physique(stature_m=1.52, segment_factors={"upper_arm": 0.95}),
        Physique(stature_m=1.70),
        Physique(stature_m=1.93, segment_factors={"forearm": 1.06}),
    ]
    return [load_body("mobl_arms_wrist", person=size, torso=True) for size in sizes]


def mujoco_grip(body: Body, linkage: Linkage, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and rotation w x y z of the controller, by MuJoCo."""
    model = body.physics_model
    data = mujoco.MjData(model)
    angles = np.zeros(len(body.independent_joints))
    angles[[body.independent_joints.index(joint) for joint in linkage.joints]] = q
    data.qpos[:] = body.coupled_qpos(angles)
    mujoco.mj_kinematics(model, data)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, data.site("controller_right").xmat)
    return data.site("controller_right").xpos.copy(), quat


def test_each_row_is_the_body_s_own(bodies: list[Body]) -> None:
    linkages = [Linkage(body, GRIP) for body in bodies]
    stack = StackedLinkage(linkages)
    rows = np.array([2, 0, 1, 1, 0])
    low, high = linkages[0].limits.T
    q = low + np.random.default_rng(1).random((len(rows), len(low))) * (high - low)
    found = stack.take(rows).place(q)
    for row, place, angles in zip(rows, found, q, strict=True):
        expected = mujoco_grip(bodies[row], linkages[row], angles)[0]
        np.testing.assert_allclose(place, expected, atol=1e-9)


def test_the_last_coordinate_of_a_ray_is_its_length(bodies: list[Body]) -> None:
    linkages = [Linkage(body, GRIP) for body in bodies]
    stack = StackedLinkage(linkages, [Linkage(body, AIM) for body in bodies])
    q = np.concatenate([np.tile(linkages[0].rest, (3, 1)), [[0.0], [1.0], [2.5]]], axis=1)
    for i, place in enumerate(stack.place(q)):
        grip, quat = mujoco_grip(bodies[i], linkages[i], q[i, :-1])
        np.testing.assert_allclose(place, grip + q[i, -1] * aim_direction(quat), atol=1e-9)


def test_solving_many_bodies_is_solving_each(bodies: list[Body]) -> None:
    linkages = [Linkage(body, GRIP) for body in bodies]
    places = np.array([[0.45, -0.2, 1.1], [0.5, 0.0, 1.2], [0.4, -0.3, 1.5]])
    starts = np.tile(linkages[0].rest, (3, 1))
    _, together = solve(StackedLinkage(linkages), places, starts)
    alone = [
        solve(linkage, places[i : i + 1], starts[:1])[1][0] for i, linkage in enumerate(linkages)
    ]
    np.testing.assert_allclose(together, alone, atol=1e-4)


def test_other_joints_are_refused(bodies: list[Body]) -> None:
    other = load_body("mobl_arms_wrist")
    with pytest.raises(ValueError, match="expected other sizes only"):
        StackedLinkage([Linkage(bodies[0], GRIP), Linkage(other, GRIP)])
