"""The wrist model's arm on both sides: right as in the tables, left its mirror image."""

from typing import Any

import mujoco
import numpy as np
import pytest

from python.users.references import coupling_jacobian, gap, load_reference, moment_arms
from sim2vr_harness.perception import Proprioception
from sim2vr_harness.users import Body, ResetOptions, UserBatch, load_body
from sim2vr_harness.users.bodies.tables import load_device_rows

NAME = "mobl_arms_bimanual"
MIRROR = np.array([1.0, -1.0, 1.0])
SIDES = ("_r", "_l")


@pytest.fixture(scope="module")
def bare() -> Body:
    return load_body(NAME, skull_rotation_deg=0.0, devices=(), appearance=False)


@pytest.fixture(scope="module")
def worn() -> Body:
    return load_body(NAME, appearance=False)


@pytest.fixture(scope="module")
def facts() -> Any:
    return load_reference("validation")


def test_sizes(worn: Body) -> None:
    model = worn.physics_model
    assert (model.nu, model.na, model.ntendon) == (64, 64, 64)
    assert (model.nq, model.neq) == (1 + 2 * 20, 1 + 2 * 13)
    assert len(worn.independent_joints) == 14
    assert worn.action_names[:2] + worn.action_names[32:34] == (
        *("DELT1_r", "DELT2_r"),
        *("DELT1_l", "DELT2_l"),
    )
    assert worn.devices == ("headset", "controller_right", "controller_left")
    sense = Proprioception(worn)
    assert sense.size == 3 * 14 + 2 * 3 + 64
    assert sense.names[42:48] == tuple(
        f"controller_{hand} {axis}" for hand in ("right", "left") for axis in "xyz"
    )
    assert load_body(NAME).model.ngeom > worn.physics_model.ngeom + 100


@pytest.mark.parametrize("side", [0, 1])
def test_each_arm_has_the_numbers_of_the_tables(facts: Any, bare: Body, side: int) -> None:
    model, data = bare.physics_model, mujoco.MjData(bare.physics_model)
    arm, other = slice(7 * side, 7 * side + 7), slice(7 - 7 * side, 14 - 7 * side)
    muscles = slice(32 * side, 32 * side + 32)
    mass = model.body(f"clavicle{SIDES[side]}").subtreemass[0]
    assert mass == pytest.approx(facts["arm_mass_kg"], abs=1e-7)
    for posture in facts["postures"]:
        q = np.zeros(14)
        q[arm], q[other] = posture["q"], facts["postures"][-1]["q"]
        data.qpos[:], data.qvel[:], data.act[:] = bare.coupled_qpos(q), 0.0, 1.0
        mujoco.mj_forward(model, data)
        assert gap(data.ten_length[muscles], posture["tendon_length_m"]) < 1e-8
        reflect = MIRROR if side else 1.0
        for body in ("hand", "humerus", "ulna"):
            place = data.body(body + SIDES[side]).xpos * reflect
            assert gap(place, posture[f"{body}_pos"]) < 1e-8
        tip = posture["fingertip_geom_hand_2distph_pos"]
        assert gap(data.site(f"fingertip{SIDES[side]}").xpos * reflect, tip) < 1e-8
        pulled = np.array(posture["F_act_N"]) + np.array(posture["F_pas_N"])
        assert gap(-data.actuator_force[muscles], pulled) < 0.05
        follow = coupling_jacobian(bare, q)
        arms = (moment_arms(model, data) @ follow)[muscles]
        assert gap(arms[:, arm], posture["moment_arm_m"]) < 1e-7
        assert np.abs(arms[:, other]).max() < 1e-12  # no muscle crosses to the other arm
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        effective = follow.T @ inertia @ follow
        assert gap(effective[arm, arm], posture["mass_matrix_eff"]) < 5e-6
        assert np.abs(effective[arm, other]).max() < 1e-9
        assert gap((follow.T @ data.qfrc_bias)[arm], posture["bias_gravity_eff_Nm"]) < 5e-6
        springs = posture["passive_spring_damper_eff_Nm"]
        assert gap((follow.T @ data.qfrc_passive)[arm], springs) < 5e-6


def test_moment_arms_by_hand_are_symmetric(bare: Body) -> None:
    """d length / d q as a difference quotient, equal angles left and right."""
    model, data = bare.physics_model, mujoco.MjData(bare.physics_model)
    low, high = bare.joint_ranges[:7].T

    def lengths(q: np.ndarray) -> np.ndarray:
        data.qpos[:] = bare.coupled_qpos(q)
        mujoco.mj_fwdPosition(model, data)
        return data.ten_length.copy()

    rng = np.random.default_rng(3)
    for _ in range(5):
        q = np.tile(rng.uniform(low, high), 2)
        assert gap(lengths(q)[:32], lengths(q)[32:]) < 1e-12
        for joint in range(7):
            step = 1e-5 * np.eye(14)[[joint, joint + 7]]
            right = (lengths(q + step[0]) - lengths(q - step[0])) / 2e-5
            left = (lengths(q + step[1]) - lengths(q - step[1])) / 2e-5
            assert gap(right[:32], left[32:]) < 1e-9
            assert np.abs(right[32:]).max() == 0.0
            assert np.abs(right).max() > 1e-3 or joint == 0  # nothing moves elv_angle at rest


@pytest.mark.parametrize("torso", [False, True])
def test_forces_and_trajectories_are_mirror_images(torso: bool) -> None:
    """Equal starts and actions left and right; 1.5 s, to 1e-12 rad and 1e-9 N.

    Without the headset, which the reference wears 1.6 mm beside the middle.
    """
    body = load_body(
        NAME,
        devices=("controller_right", "controller_left"),
        appearance=False,
        torso=torso,
        reset=ResetOptions(posture="ready"),
    )
    batch = UserBatch(body, 1, threads=1, effort="zero")
    start = np.array([body.reset_rule.posture.get(j, 0.0) for j in body.independent_joints])
    batch.reset([0], [np.random.default_rng(1)], [start])
    batch._physics.qvel[:] = 0.0
    batch._physics.act[0, 32:] = batch._physics.act[0, :32]
    arms = [[body.independent_joints.index(j + s) for j in _ARM] for s in SIDES]
    right, left = (body.qpos_independent[arm] for arm in arms)
    rng = np.random.default_rng(2)
    travelled = 0.0
    for _ in range(30):
        action = np.zeros((1, body.action_size))
        action[0, -64:] = np.tile(rng.uniform(-1, 1, 32), 2)
        batch.step(action)
        force = batch.actuator_force[0, -64:]
        assert gap(force[:32], force[32:]) < 1e-9
        assert gap(batch.qpos[0, right], batch.qpos[0, left]) < 1e-12
        at, turned = batch.device_poses("controller_right")
        other, other_turned = batch.device_poses("controller_left")
        assert gap(at * MIRROR, other) < 1e-12
        dot = (turned * [1, -1, 1, -1] * other_turned).sum()
        assert abs(dot) == pytest.approx(1.0, abs=1e-12)
        travelled = max(travelled, float(np.abs(batch.qpos[0, right] - start[arms[0]]).max()))
    assert travelled > 0.5
    if torso:  # the trunk leans under the arms' weight, but to no side
        trunk = {j: batch.qpos[0, body.physics_model.joint(j).qposadr[0]] for j in _TRUNK}
        assert abs(trunk["trunk_flexion"]) > 1e-3
        assert max(abs(trunk["trunk_bending"]), abs(trunk["trunk_rotation"])) < 1e-12


_ARM = (
    *("elv_angle", "shoulder_elv", "shoulder_rot", "elbow_flexion", "pro_sup"),
    *("deviation", "flexion"),
)
_TRUNK = ("trunk_flexion", "trunk_bending", "trunk_rotation")


def test_the_right_arm_moves_as_the_wrist_models(worn: Body) -> None:
    """Same start, same actions; the arms meet only in the thorax, which yields by 3e-4 rad.

    The left arm is relaxed and hangs. Measured within 3 s: 3e-4 rad.
    """
    wrist = load_body("mobl_arms_wrist", appearance=False)
    one, two = (UserBatch(body, 1, threads=1, effort="zero") for body in (wrist, worn))
    for batch in (one, two):
        batch._physics.qpos[:] = batch._physics.qvel[:] = batch._physics.act[:] = 0.0
    rng = np.random.default_rng(5)
    worst = moved = 0.0
    for _ in range(60):
        action = rng.uniform(-1, 1, 32)
        one.step(action[None])
        two.step(np.concatenate([action, -np.ones(32)])[None])
        assert gap(one.ctrl[0], two.ctrl[0, :32]) < 1e-12
        q = one.qpos[0, wrist.qpos_independent]
        worst = max(worst, gap(two.qpos[0, worn.qpos_independent[:7]], q))
        moved = max(moved, float(np.abs(q).max()))
    assert worst < 1e-3
    assert moved > 1.0


def test_the_left_hand_holds_what_a_left_hander_holds(worn: Body) -> None:
    model = worn.physics_model
    right, left = model.body("controller_right"), model.body("controller_left")
    assert left.mass[0] == right.mass[0] == 0.129
    np.testing.assert_allclose(left.pos, right.pos * [1, 1, -1], atol=1e-15)  # z: to the left
    offset = load_device_rows()["controller_right"].openxr_offset
    np.testing.assert_allclose(model.site("controller_left").pos, offset, atol=1e-15)
