"""The rebuilt arms against reference values of the User-in-the-Box conversion.

The wrist model, its arm on both sides (right as in the tables, left its mirror image), and both
arms with motors.
"""

from contextlib import closing

import mujoco
import numpy as np
import pytest

from python.users.bodies import body, rngs
from python.users.references import (
    coupling_jacobian,
    gap,
    load_reference,
    moment_arms,
    rotation_gap,
)
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.perception import Proprioception
from sim2vr_harness.users import Body, Physique, ResetOptions, UserBatch

WRIST, BOTH, MOTORS = "mobl_arms_wrist", "mobl_arms_bimanual", "mobl_arms_bimanual_motor"
MIRROR, SIDES = np.array([1.0, -1.0, 1.0]), ("_r", "_l")
ARM = ("elv_angle", "shoulder_elv", "shoulder_rot", "elbow_flexion", "pro_sup", "deviation")
TRUNK = ("trunk_flexion", "trunk_bending", "trunk_rotation")


def bare(name: str) -> Body:
    return body(name, skull_rotation_deg=0.0, devices=())


def effective(user: Body, q: np.ndarray, data: mujoco.MjData) -> tuple[np.ndarray, ...]:
    """Inertia, gravity and springs at the independent joints, and how all joints follow."""
    model, follow = user.physics_model, coupling_jacobian(user, q)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    passive = follow.T @ data.qfrc_passive
    return follow.T @ inertia @ follow, follow.T @ data.qfrc_bias, passive, follow


@pytest.mark.parametrize(("name", "side"), [(WRIST, ""), (BOTH, "_r"), (BOTH, "_l")])
def test_each_arm_has_the_numbers_of_the_tables(name: str, side: str) -> None:
    """Reference numbers are rounded; within 10x of what the tables alone are known to reach."""
    facts, user = load_reference("validation"), bare(name)
    model, data, count = user.physics_model, mujoco.MjData(user.physics_model), len(user.muscles)
    left = int(side == "_l")
    arm, muscles = slice(7 * left, 7 * left + 7), slice(32 * left, 32 * left + 32)
    if name == WRIST:
        assert list(user.independent_joints) == facts["independent_joints"]
        assert list(user.muscles) == facts["muscles"]
        assert gap(model.body_subtreemass[0], facts["total_mass_kg"]) < 1e-7
    assert gap(model.body(f"clavicle{side}").subtreemass[0], facts["arm_mass_kg"]) < 1e-7
    reflect = MIRROR if left else 1.0
    for posture in facts["postures"]:
        q = np.resize(facts["postures"][-1]["q"], len(user.independent_joints))
        q[arm] = posture["q"]
        data.qpos[:], data.qvel[:], data.act[:] = user.coupled_qpos(q), 0.0, 1.0
        mujoco.mj_forward(model, data)
        for joint, angle in posture["qpos_all"].items() if name == WRIST else ():
            assert data.joint(joint).qpos[0] == pytest.approx(angle, abs=1e-8), joint
        assert gap(data.ten_length[muscles], posture["tendon_length_m"]) < 1e-8
        for part in ("hand", "humerus", "ulna"):
            assert gap(data.body(part + side).xpos * reflect, posture[f"{part}_pos"]) < 1e-8
        if name == WRIST:
            assert rotation_gap(data.body("hand").xquat, posture["hand_quat_wxyz"]) < 1e-8
        tip = data.site(f"fingertip{side}").xpos * reflect
        assert gap(tip, posture["fingertip_geom_hand_2distph_pos"]) < 1e-8
        # MuJoCo counts pulling as negative force.
        pulled = np.array(posture["F_act_N"]) + np.array(posture["F_pas_N"])
        assert gap(-data.actuator_force[muscles], pulled) < 0.05
        inertia, gravity, springs, follow = effective(user, q, data)
        arms = moment_arms(model, data) @ follow
        assert gap(arms[muscles, arm], posture["moment_arm_m"]) < 1e-7
        assert gap(inertia[arm, arm], posture["mass_matrix_eff"]) < 5e-6
        assert gap(gravity[arm], posture["bias_gravity_eff_Nm"]) < 5e-6
        assert gap(springs[arm], posture["passive_spring_damper_eff_Nm"]) < 5e-6
        # Neither muscles nor inertia reach from one arm to the other.
        other = [i for i in range(len(q)) if not arm.start <= i < arm.stop]
        assert np.abs(arms[muscles][:, other]).max(initial=0.0) < 1e-12
        assert np.abs(inertia[arm][:, other]).max(initial=0.0) < 1e-9
    assert count == (32 if name == WRIST else 64)


def test_devices_are_where_the_reference_has_them() -> None:
    facts = load_reference("validation")
    for user, postures in (
        (body(WRIST), facts["postures"]),
        (body(MOTORS), load_reference("bimanual_validation")["postures"]),
    ):
        data = mujoco.MjData(user.physics_model)
        for posture in postures:
            data.qpos[:] = user.coupled_qpos(np.array(posture["q"]))
            mujoco.mj_kinematics(user.physics_model, data)
            for hand in (name for name in user.devices if name != "headset"):
                assert gap(data.body(hand).xpos, posture[f"{hand}_pos"]) < 1e-7
                assert rotation_gap(data.body(hand).xquat, posture[f"{hand}_quat_wxyz"]) < 1e-7
    data = mujoco.MjData(body(WRIST).physics_model)
    mujoco.mj_kinematics(body(WRIST).physics_model, data)
    recorded = facts["reference_initial_world_poses_from_recorded_run"]
    for device in ("headset", "controller_right"):
        # The recording has six significant digits.
        assert gap(data.body(device).xpos, recorded[device]["pos"]) < 5.1e-6
        assert rotation_gap(data.body(device).xquat, recorded[device]["quat"]) < 1e-6


def test_trace_with_attached_hardware() -> None:
    user, trace = body(WRIST), load_reference("trace")
    model, data = user.physics_model, mujoco.MjData(user.physics_model)
    joints, dofs = user.qpos_independent, user.qvel_independent
    data.qpos[joints], data.qvel[dofs] = trace["init"]["qpos"], trace["init"]["qvel"]
    data.act[:] = trace["init"]["act"]
    for k, step in enumerate(trace["steps"]):
        action = np.clip(-0.3 + 0.9 * np.sin(0.35 * k + 1.7 * np.arange(model.nu)), -1.0, 1.0)
        data.ctrl[:] = np.clip(data.act + action, 0.0, 1.0)
        mujoco.mj_step(model, data, 25)
        mujoco.mj_kinematics(model, data)
        got = {"ctrl": data.ctrl, "qpos": data.qpos[joints], "qvel": data.qvel[dofs]}
        got |= {"act": data.act, "hand_pos": data.body("hand").xpos}
        got |= {f"{d}_pos": data.body(d).xpos for d in ("controller_right", "headset")}
        for what, value in got.items():
            assert gap(value, step[what]) < 1.3e-7, f"{what} at step {k}"
        turned = data.body("controller_right").xquat
        assert rotation_gap(turned, step["controller_right_quat"]) < 1.3e-7


def test_trace_of_motors() -> None:
    """m <- 0.1 m + 0.9 clip(m + a, 0, 1) from 0.5, a_i(k) = 0.25 sin(0.3 k + 1.3 i)."""
    trace, user = load_reference("bimanual_trace"), bare(MOTORS)
    assert list(user.independent_joints) == trace["joints"]
    batch = UserBatch(user, 1, threads=1, effort="zero")
    batch.set_motion(0.0 * batch.qpos, 0.0 * batch.qvel, batch.act, 0.0 * batch.motor + 0.5)
    for k, step in enumerate(trace["steps"]):
        batch.step(0.25 * np.sin(0.3 * k + 1.3 * np.arange(14))[None])
        got = {"motor_act": batch.motor[0], "ctrl": batch.ctrl[0]}
        got["qpos"] = batch.qpos[0, user.qpos_independent]
        got["qvel"] = batch.qvel[0, user.qvel_independent]
        for what, value in got.items():
            assert gap(value, step[what]) < 1e-7, f"{what} at step {k}"


def test_postures_of_motors() -> None:
    facts, user = load_reference("bimanual_validation"), bare(MOTORS)
    model, data = user.physics_model, mujoco.MjData(user.physics_model)
    assert gap(model.body_subtreemass[0], facts["total_mass_kg"]) < 1e-6
    for posture in facts["postures"]:
        q = np.array(posture["q"])
        data.qpos[:] = user.coupled_qpos(q)
        for end, column in (("min", 0), ("max", 1)):
            data.ctrl[:] = model.actuator_ctrlrange[:, column]
            mujoco.mj_forward(model, data)
            assert gap(data.actuator_force, posture[f"torque_at_ctrl_{end}_Nm"]) < 0.05
        for hand in ("hand_r", "hand_l"):
            assert gap(data.body(hand).xpos, posture[f"{hand}_pos"]) < 1e-8
        inertia, gravity, _, _ = effective(user, q, data)
        assert gap(inertia, posture["mass_matrix_eff"]) < 5e-6
        assert gap(gravity, posture["bias_gravity_eff_Nm"]) < 5e-6


def test_an_app_is_sent_both_controllers() -> None:
    user = {"model": MOTORS, "effort": {"model": "neural", "weight": 0.001}}
    changes = {"app": {"renderer": "null"}, "user": user, "cores": 1, "frames_per_step": 5}
    config = EnvConfig.model_validate(changes)
    with closing(Simulation(config, 2)) as users:
        users.reset(seeds=[1, 2])
        users.step(np.zeros((2, 14)))
        poses = users._apps.step_poses(np.array([0, 1]))
        left = position_to_app(users.users.device_poses("controller_left")[0])
        assert poses.left_controller.shape == poses.right_controller.shape == (2, 5, 7)
        np.testing.assert_array_equal(poses.left_controller[:, -1, :3], left)
        assert (left[:, 0] < 0).all()  # x to the right in the app's frame
        terms = ResolvedEnv(config).contract
        assert terms["devices"] == ["controller_left", "controller_right", "headset"]
        assert terms["actuators"][0][:2] == ["motor", "elv_angle_motor_r"]


def test_forces_and_trajectories_are_mirror_images() -> None:
    """Equal starts and actions left and right; 1 s, to 1e-12 rad and 1e-9 N.

    Without the headset, which the reference wears 1.6 mm beside the middle.
    """
    hands = ("controller_right", "controller_left")
    user = body(BOTH, devices=hands, torso=True, reset=ResetOptions(posture="ready"))
    batch = UserBatch(user, 1, threads=1, effort="zero")
    start = np.array([user.reset_rule.posture.get(j, 0.0) for j in user.independent_joints])
    batch.reset([0], rngs(1), [start])
    alike = np.tile(batch.act[:, :32], 2)
    batch.set_motion(batch.qpos, 0.0 * batch.qvel, alike, batch.motor)
    arms = [
        [user.independent_joints.index(joint + side) for joint in (*ARM, "flexion")]
        for side in SIDES
    ]
    right, left = (user.qpos_independent[arm] for arm in arms)
    rng, travelled = np.random.default_rng(2), 0.0
    for _ in range(20):
        action = np.zeros((1, user.action_size))
        action[0, -64:] = np.tile(rng.uniform(-1, 1, 32), 2)
        batch.step(action)
        force = batch.actuator_force[0, -64:]
        assert gap(force[:32], force[32:]) < 1e-9
        assert gap(batch.qpos[0, right], batch.qpos[0, left]) < 1e-12
        (at, turned), (other, other_turned) = (batch.device_poses(hand) for hand in hands)
        assert gap(at * MIRROR, other) < 1e-12
        dot = (turned * [1, -1, 1, -1] * other_turned).sum()
        assert abs(dot) == pytest.approx(1.0, abs=1e-12)
        travelled = max(travelled, float(np.abs(batch.qpos[0, right] - start[arms[0]]).max()))
    assert travelled > 0.5
    # The trunk leans under the arms' weight, but to no side.
    leans = [batch.qpos[0, user.physics_model.joint(j).qposadr[0]] for j in TRUNK]
    assert abs(leans[0]) > 1e-3
    assert np.abs(leans[1:]).max() < 1e-12


def test_the_motors_user_senses_and_wears_what_the_reference_s_does() -> None:
    user = body(MOTORS)
    assert user.devices == ("headset", "controller_right", "controller_left")
    right, left = (user.physics_model.body(f"controller_{s}") for s in ("right", "left"))
    assert right.mass[0] == left.mass[0] == 0.129
    assert Proprioception(user).size == 3 * 14 + 6 + 14 == 62  # the reference's Beats user has 62
    batch = UserBatch(user, 1, threads=1, effort="neural")
    batch.step(np.zeros((1, user.action_size)))
    # Neural effort squares the angles that motors aim at (User-in-the-Box reference).
    np.testing.assert_allclose(batch.effort_cost[0], 1e-4 * (batch.ctrl[0] ** 2).sum(), rtol=1e-12)
    for k, device in enumerate(("controller_right", "controller_left")):
        place = batch.end_effector_pos[0, 3 * k : 3 * k + 3]
        np.testing.assert_array_equal(place, batch.device_poses(device)[0][0])
    # Mirrored, right and left have changed places.
    model = body(MOTORS, person=Physique(handedness="left")).physics_model
    assert model.body("controller_left").parentid[0] == model.body("hand_r").id
