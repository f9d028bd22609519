"""A hand that is told where to go comes there, by muscles alone."""

from __future__ import annotations

from contextlib import closing

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from sim2vr_harness.users import load_body
from sim2vr_harness.users.kinematics.reach_controller import ReachController


@pytest.mark.parametrize("goal_m", [(0.12, 0.85, 0.42), (0.3, 1.0, 0.35)])
def test_the_hand_comes_within_5_cm_in_two_seconds(goal_m: tuple[float, ...]) -> None:
    app = AppConfig(game="sample", renderer="null")
    env = EnvConfig(app=app, vision=VisionConfig(width=16, height=16))
    with closing(Simulation(env, 1)) as simulation:
        simulation.reset(seeds=[1])
        users, goal = simulation.users, position_to_mujoco(goal_m)
        reacher = ReachController(simulation.body)
        gaps = []
        for _ in range(40):
            action = reacher.action(users.qpos[0], users.qvel[0], users.act[0], goal)
            assert action.shape == simulation.action_space.shape
            assert (np.abs(action) <= 1.0).all()
            simulation.step(action[None])
            gaps.append(np.linalg.norm(users.device_poses("controller_right")[0][0] - goal))
    assert gaps[0] > 0.4
    assert max(gaps[-5:]) < 0.05


def test_who_cannot_reach() -> None:
    with pytest.raises(ValueError, match=r"device: got 'controller_left', expected one of headset"):
        ReachController(load_body("mobl_arms_wrist"), "controller_left")


def test_the_least_activations_hold_a_posture() -> None:
    """With them what stood still hardly accelerates; without, the arm falls."""
    body = load_body("mobl_arms_wrist")
    reacher = ReachController(body)
    model, data = body.physics_model, mujoco.MjData(body.physics_model)
    posture = np.zeros(len(body.independent_joints))
    posture[body.independent_joints.index("elbow_flexion")] = np.pi / 2.0
    data.qpos[:] = body.coupled_qpos(posture)
    held = reacher.holding(data.qpos)
    assert held.min() >= 0.0
    assert held.max() <= 1.0
    data.act[:] = 0.0
    mujoco.mj_forward(model, data)
    limp = np.abs(data.qacc[body.qvel_independent]).max()
    data.act[:] = held
    mujoco.mj_forward(model, data)
    still = np.abs(data.qacc[body.qvel_independent]).max()
    assert limp > 10.0
    assert still < 0.1 * limp
    assert np.square(held).mean() < 0.1
