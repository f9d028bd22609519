"""Hands that touch and aim, by muscles alone."""

from __future__ import annotations

from contextlib import closing

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client.frames import aim_direction, position_to_mujoco
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from sim2vr_harness.users import load_body
from sim2vr_harness.users.kinematics.bounded import bounded_least_squares
from sim2vr_harness.users.kinematics.posture_controller import AIM_RAY, PostureController

SECONDS = 2.5


def played(place_m: tuple[float, ...], *, by_ray: bool) -> list[tuple[float, float]]:
    """Return the distance (m) and the angle (degrees) in every user step, from the devices."""
    app = AppConfig(game="sample", renderer="null")
    env = EnvConfig(app=app, vision=VisionConfig(width=16, height=16))
    with closing(Simulation(env, 1)) as simulation:
        simulation.reset(seeds=[1])
        users, place = simulation.users, position_to_mujoco(place_m)
        controller = PostureController(simulation.body)
        start = controller.angles(users.qpos[0])
        wanted = {"aim_at": place} if by_ray else {"place": place}
        found = controller.find(start, **wanted)
        steps = []
        for _ in range(int(SECONDS * 20)):
            action = controller.towards(users.qpos[0], users.qvel[0], users.act[0], found.angles)
            assert (np.abs(action) <= 1.0).all()
            simulation.step(action[None])
            (position,), (quat,) = users.device_poses("controller_right")
            gap = place - position
            along = float(aim_direction(quat) @ gap / np.linalg.norm(gap))
            steps.append((float(np.linalg.norm(gap)), float(np.degrees(np.arccos(along)))))
    return steps


@pytest.mark.parametrize("place_m", [(0.12, 0.85, 0.42), (0.3, 1.0, 0.35)])
def test_the_hand_settles_within_a_centimetre(place_m: tuple[float, ...]) -> None:
    gaps = [gap for gap, _ in played(place_m, by_ray=False)]
    assert gaps[0] > 0.3
    assert max(gaps[-10:]) < 0.01


@pytest.mark.parametrize("place_m", [(0.1, 1.2, 1.5), (-0.8, 1.0, 1.0)])
def test_the_aim_ray_settles_within_a_degree(place_m: tuple[float, ...]) -> None:
    """A degree is 2.6 cm at 1.5 m: a third of the half width of a key of 16 cm."""
    angles = [angle for _, angle in played(place_m, by_ray=True)]
    assert angles[0] > 45.0
    assert max(angles[-10:]) < 1.0


def test_a_place_out_of_reach_is_said_to_be() -> None:
    """The arm is shorter than 1 m, so of 2 m ahead more than 1 m remains."""
    body = load_body("mobl_arms_wrist")
    controller = PostureController(body)
    start = np.zeros(len(body.independent_joints))
    assert controller.find(start, place=np.array([2.0, 0.0, 1.0])).gap_m > 1.0
    assert controller.find(start, place=np.array([0.4, -0.15, 0.9])).gap_m < 0.005


def test_a_tool_comes_to_the_place_instead_of_the_hand() -> None:
    body = load_body("mobl_arms_wrist")
    controller = PostureController(body)
    start, place = np.zeros(len(body.independent_joints)), np.array([0.4, -0.15, 0.9])
    found = controller.find(start, place=place, tip_m=(0.1, 0.0, 0.0))
    assert found.gap_m < 0.005
    # Without the tool the same posture has the device 10 cm from there.
    _, device, *_ = controller._reached(found.angles, (0.0, 0.0, 0.0), AIM_RAY)
    assert np.linalg.norm(device - place) == pytest.approx(0.1, abs=0.006)


def test_a_hand_without_a_controller_is_refused() -> None:
    with pytest.raises(ValueError, match=r"device: got 'controller_left', expected one of headset"):
        PostureController(load_body("mobl_arms_wrist"), "controller_left")


def test_the_least_activations_hold_a_posture() -> None:
    """With them what stood still hardly accelerates; without, the arm falls."""
    body = load_body("mobl_arms_wrist")
    data = mujoco.MjData(body.physics_model)
    posture = np.zeros(len(body.independent_joints))
    posture[body.independent_joints.index("elbow_flexion")] = np.pi / 2.0
    data.qpos[:] = body.coupled_qpos(posture)
    held = PostureController(body).holding(data.qpos)
    assert held.min() >= 0.0 and held.max() <= 1.0
    fastest = []
    for activations in (np.zeros_like(held), held):
        data.act[:] = activations
        mujoco.mj_forward(body.physics_model, data)
        fastest.append(np.abs(data.qacc[body.qvel_independent]).max())
    assert fastest[0] > 10.0
    assert fastest[1] < 0.1 * fastest[0]
    assert np.square(held).mean() < 0.1


def test_bounded_least_squares_meet_the_conditions_of_the_optimum() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        matrix = np.concatenate([rng.normal(size=(6, 12)), 0.1 * np.eye(12)])
        target, high = rng.normal(size=18), np.where(rng.random(12) < 0.2, np.inf, 0.5)
        x = bounded_least_squares(matrix, target, high)
        downhill = matrix.T @ (target - matrix @ x)
        assert (downhill[x < 1e-9] < 1e-6).all()
        assert (downhill[x > high - 1e-9] > -1e-6).all()
        assert np.abs(downhill[(x >= 1e-9) & (x <= high - 1e-9)]).max(initial=0.0) < 1e-6
