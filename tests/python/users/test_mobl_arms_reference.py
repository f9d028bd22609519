"""The rebuilt wrist model against reference values of the User-in-the-Box conversion."""

import mujoco
import numpy as np
import pytest

from python.users.references import (
    coupling_jacobian,
    gap,
    load_reference,
    moment_arms,
    rotation_gap,
)
from sim2vr_harness.users import Body, load_body


@pytest.fixture(scope="module")
def bare() -> Body:
    return load_body("mobl_arms_wrist", skull_rotation_deg=0.0, devices=(), appearance=False)


def test_postures(bare: Body) -> None:
    facts = load_reference("validation")
    model = bare.model
    data = mujoco.MjData(model)
    assert list(bare.independent_joints) == facts["independent_joints"]
    assert list(bare.muscles) == facts["muscles"]
    assert gap(model.body_subtreemass[0], facts["total_mass_kg"]) < 1e-7
    assert gap(model.body("clavicle").subtreemass[0], facts["arm_mass_kg"]) < 1e-7
    for posture in facts["postures"]:
        q = np.array(posture["q"])
        data.qpos[:] = bare.coupled_qpos(q)
        data.qvel[:], data.act[:] = 0.0, 1.0
        mujoco.mj_forward(model, data)
        for joint, angle in posture["qpos_all"].items():
            assert data.joint(joint).qpos[0] == pytest.approx(angle, abs=1e-8), joint

        # Reference numbers are rounded; within 10x of what the tables alone are known to reach.
        assert gap(data.ten_length, posture["tendon_length_m"]) < 1e-8
        assert gap(data.body("hand").xpos, posture["hand_pos"]) < 1e-8
        assert rotation_gap(data.body("hand").xquat, posture["hand_quat_wxyz"]) < 1e-8
        tip = posture["fingertip_geom_hand_2distph_pos"]
        assert gap(data.site(bare.end_effectors[0]).xpos, tip) < 1e-8
        assert gap(data.body("humerus").xpos, posture["humerus_pos"]) < 1e-8
        assert gap(data.body("ulna").xpos, posture["ulna_pos"]) < 1e-8

        # MuJoCo counts pulling as negative force.
        pulled = np.array(posture["F_act_N"]) + np.array(posture["F_pas_N"])
        assert gap(-data.actuator_force, pulled) < 0.05

        follow = coupling_jacobian(bare, q)
        arms = moment_arms(model, data) @ follow
        assert gap(arms, posture["moment_arm_m"]) < 1e-7
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        assert gap(follow.T @ inertia @ follow, posture["mass_matrix_eff"]) < 5e-6
        assert gap(follow.T @ data.qfrc_bias, posture["bias_gravity_eff_Nm"]) < 5e-6
        springs = posture["passive_spring_damper_eff_Nm"]
        assert gap(follow.T @ data.qfrc_passive, springs) < 5e-6


def test_device_poses_in_postures() -> None:
    user = load_body("mobl_arms_wrist", appearance=False)
    data = mujoco.MjData(user.model)
    for posture in load_reference("validation")["postures"]:
        data.qpos[:] = user.coupled_qpos(np.array(posture["q"]))
        mujoco.mj_kinematics(user.model, data)
        controller = data.body("controller_right")
        assert gap(controller.xpos, posture["controller_right_pos"]) < 1e-8
        assert rotation_gap(controller.xquat, posture["controller_right_quat_wxyz"]) < 1e-8


def test_start_poses_of_a_recorded_run() -> None:
    user = load_body("mobl_arms_wrist", appearance=False)
    data = mujoco.MjData(user.model)
    mujoco.mj_kinematics(user.model, data)
    recorded = load_reference("validation")["reference_initial_world_poses_from_recorded_run"]
    for device in ("headset", "controller_right"):
        # The recording has six significant digits.
        assert gap(data.body(device).xpos, recorded[device]["pos"]) < 5.1e-6
        assert rotation_gap(data.body(device).xquat, recorded[device]["quat"]) < 1e-6


def test_trace_with_attached_hardware() -> None:
    user = load_body("mobl_arms_wrist", appearance=False)
    model, trace = user.model, load_reference("trace")
    data = mujoco.MjData(model)
    joints, dofs = user.qpos_independent, user.qvel_independent
    data.qpos[joints], data.qvel[dofs] = trace["init"]["qpos"], trace["init"]["qvel"]
    data.act[:] = trace["init"]["act"]
    muscle = np.arange(model.nu)
    for k, step in enumerate(trace["steps"]):
        action = np.clip(-0.3 + 0.9 * np.sin(0.35 * k + 1.7 * muscle), -1.0, 1.0)
        data.ctrl[:] = np.clip(data.act + action, 0.0, 1.0)
        mujoco.mj_step(model, data, 25)
        mujoco.mj_kinematics(model, data)
        got_and_expected = {
            "ctrl": (data.ctrl, step["ctrl"]),
            "qpos": (data.qpos[joints], step["qpos"]),
            "qvel": (data.qvel[dofs], step["qvel"]),
            "act": (data.act, step["act"]),
            "hand": (data.body("hand").xpos, step["hand_pos"]),
            "controller": (data.body("controller_right").xpos, step["controller_right_pos"]),
            "headset": (data.body("headset").xpos, step["headset_pos"]),
        }
        for what, (got, expected) in got_and_expected.items():
            assert gap(got, expected) < 1.3e-7, f"{what} at step {k}"
        turned = data.body("controller_right").xquat
        assert rotation_gap(turned, step["controller_right_quat"]) < 1.3e-7
