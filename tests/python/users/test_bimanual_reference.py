"""The body with two arms and 14 motors against the User-in-the-Box conversion."""

from contextlib import closing

import mujoco
import numpy as np
import pytest

from python.users.references import coupling_jacobian, gap, load_reference
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.perception import Proprioception
from sim2vr_harness.users import Body, Physique, UserBatch, load_body

NAME = "mobl_arms_bimanual_motor"


@pytest.fixture(scope="module")
def bare() -> Body:
    return load_body(NAME, skull_rotation_deg=0.0, devices=(), appearance=False)


def test_trace(bare: Body) -> None:
    """m <- 0.1 m + 0.9 clip(m + a, 0, 1) from 0.5, a_i(k) = 0.25 sin(0.3 k + 1.3 i)."""
    trace = load_reference("bimanual_trace")
    assert list(bare.independent_joints) == trace["joints"]
    batch = UserBatch(bare, 1, threads=1, effort="zero")
    batch._physics.qpos[:] = batch._physics.qvel[:] = 0.0
    batch._physics.motor[:] = 0.5
    for k, step in enumerate(trace["steps"]):
        batch.step(0.25 * np.sin(0.3 * k + 1.3 * np.arange(14))[None])
        got_and_expected = {
            "motor_act": batch.motor[0],
            "ctrl": batch.ctrl[0],
            "qpos": batch.qpos[0, bare.qpos_independent],
            "qvel": batch.qvel[0, bare.qvel_independent],
        }
        for what, got in got_and_expected.items():
            assert gap(got, step[what]) < 1e-7, f"{what} at step {k}"


def test_postures(bare: Body) -> None:
    facts, worn = load_reference("bimanual_validation"), load_body(NAME, appearance=False)
    model, data = bare.physics_model, mujoco.MjData(bare.physics_model)
    other = mujoco.MjData(worn.physics_model)
    assert gap(model.body_subtreemass[0], facts["total_mass_kg"]) < 1e-6
    for posture in facts["postures"]:
        q = np.array(posture["q"])
        data.qpos[:] = other.qpos[:] = bare.coupled_qpos(q)
        for end, column in (("min", 0), ("max", 1)):
            data.ctrl[:] = model.actuator_ctrlrange[:, column]
            mujoco.mj_forward(model, data)
            torque = data.actuator_force
            assert gap(torque, posture[f"torque_at_ctrl_{end}_Nm"]) < 0.05
        for hand in ("hand_r", "hand_l"):
            assert gap(data.body(hand).xpos, posture[f"{hand}_pos"]) < 1e-8
        follow = coupling_jacobian(bare, q)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        assert gap(follow.T @ inertia @ follow, posture["mass_matrix_eff"]) < 5e-6
        assert gap(follow.T @ data.qfrc_bias, posture["bias_gravity_eff_Nm"]) < 5e-6
        mujoco.mj_kinematics(worn.physics_model, other)
        for device in ("controller_right", "controller_left"):
            assert gap(other.body(device).xpos, posture[f"{device}_pos"]) < 1e-7
            turned, expected = other.body(device).xquat, posture[f"{device}_quat_wxyz"]
            assert abs(float(turned @ expected)) == pytest.approx(1.0, abs=1e-8)


def test_two_controllers_and_two_end_effectors() -> None:
    body = load_body(NAME, appearance=False)
    assert body.devices == ("headset", "controller_right", "controller_left")
    assert body.physics_model.body("controller_left").mass[0] == 0.129
    sense = Proprioception(body)
    assert sense.size == 62  # the reference's Beats user: 3 x 14 joints, 2 x 3 hands, 14 motors
    assert sense.names[42:48] == tuple(
        f"controller_{h} {a}" for h in ("right", "left") for a in "xyz"
    )
    batch = UserBatch(body, 1, threads=1, effort="neural")
    batch.step(np.zeros((1, 14)))
    # Neural effort squares the angles that motors aim at (User-in-the-Box reference).
    np.testing.assert_allclose(batch.effort_cost[0], 1e-4 * (batch.ctrl[0] ** 2).sum(), rtol=1e-12)
    for k, device in enumerate(("controller_right", "controller_left")):
        np.testing.assert_array_equal(
            batch.end_effector_pos[0, 3 * k : 3 * k + 3], batch.device_poses(device)[0][0]
        )
    # Mirrored, right and left have changed places.
    swapped = load_body(NAME, person=Physique(handedness="left"), appearance=False)
    assert sorted(swapped.devices) == sorted(body.devices)
    assert swapped.end_effectors == ("controller_left", "controller_right")
    assert (
        swapped.physics_model.body("controller_left").parentid[0]
        == swapped.physics_model.body("hand_r").id
    )


def test_an_app_is_sent_both_controllers() -> None:
    config = EnvConfig.model_validate(
        {
            "app": {"renderer": "null"},
            "user": {"model": NAME, "effort": {"model": "neural", "weight": 0.001}},
            "cores": 1,
            "frames_per_step": 5,
        }
    )
    with closing(Simulation(config, 2)) as users:
        users.reset(seeds=[1, 2])
        users.step(np.zeros((2, 14)))
        poses = users._apps.step_poses(np.array([0, 1]))
        assert poses.left_controller is not None
        assert poses.right_controller is not None
        assert poses.left_controller.shape == poses.right_controller.shape == (2, 5, 7)
        left = position_to_app(users.users.device_poses("controller_left")[0])
        np.testing.assert_array_equal(poses.left_controller[:, -1, :3], left)
        assert (left[:, 0] < 0).all()  # x to the right in the app's frame
        terms = ResolvedEnv(config).contract
        assert terms["devices"] == ["controller_left", "controller_right", "headset"]
        assert terms["actuators"][0][:2] == ["motor", "elv_angle_motor_r"]
