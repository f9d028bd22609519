"""Wanted joint accelerations and the muscles that bring them about."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from sim2vr_harness.users import UserBatch, load_user
from sim2vr_harness.users.joint_drive import JointDrive, _least_activations

USER = load_user("mobl_arms_wrist")
SCALE = np.array([40.0, 40.0, 40.0, 60.0, 60.0, 60.0, 60.0])


def _batch(n: int, seed: int = 0) -> UserBatch:
    """Users in postures well inside their joints' ranges."""
    batch = UserBatch(USER, n, threads=1)
    rng = np.random.default_rng(seed)
    low, high = USER.joint_ranges.T
    postures = list(rng.uniform(low + 0.25 * (high - low), high - 0.25 * (high - low), (n, 7)))
    batch.reset(range(n), [np.random.default_rng(k) for k in range(n)], postures)
    return batch


def _two(effect: list[list[float]], target: list[float], effort: float) -> np.ndarray:
    bounds = np.zeros((1, 2)), np.ones((1, 2))
    return _least_activations(np.array([effect]), np.array([target]), effort, *bounds)[0]


def test_two_muscles_share_a_load_by_their_strength() -> None:
    """Pulls of 3 and 4 want 1: y (9 + 16) + y e = 1, so that e -> 0 gives a = (3, 4) / 25."""
    np.testing.assert_allclose(_two([[3.0, 4.0]], [1.0], 1e-6), [0.12, 0.16], atol=2e-3)
    # Twice as much as both can: both give all they have.
    np.testing.assert_allclose(_two([[3.0, 4.0]], [14.0], 1e-3), [1.0, 1.0], atol=1e-6)
    # Muscles do not push.
    np.testing.assert_allclose(_two([[3.0, 4.0]], [-1.0], 1e-3), [0.0, 0.0], atol=1e-6)
    # Of two that pull against each other, one rests: a (4 + e) = 2 * 0.5.
    np.testing.assert_allclose(_two([[2.0, -2.0]], [0.5], 0.5), [1 / 4.5, 0.0], atol=2e-3)


def test_least_activations_are_nearly_the_least() -> None:
    """Against SciPy's bounded least squares, on problems of the drive's size."""
    rng = np.random.default_rng(1)
    effect, target = rng.normal(0.0, 2.0, (20, 10, 32)), rng.normal(0.0, 3.0, (20, 10))
    low, high = 0.3 * rng.random((20, 32)), 1.0 - 0.3 * rng.random((20, 32))
    found = _least_activations(effect, target, 0.02, low, high)
    assert (found >= low).all()
    assert (found <= high).all()

    def cost(i: int, a: np.ndarray) -> float:
        return float(0.02 * a @ a + np.sum((effect[i] @ a - target[i]) ** 2))

    for i in range(20):
        rows = np.vstack([effect[i], np.sqrt(0.02) * np.eye(32)])
        right = np.concatenate([target[i], np.zeros(32)])
        least = lsq_linear(rows, right, (low[i], high[i])).x
        assert cost(i, found[i]) < cost(i, least) + 0.1


def test_controls_make_up_for_the_lag_of_the_muscles() -> None:
    """The mean activation over the step is the wanted one, by MuJoCo's own muscle dynamics."""
    batch = _batch(6)
    drive = JointDrive(batch, SCALE)
    before = batch.act
    wanted = np.clip(before + np.linspace(-0.2, 0.3, 32), 0.0, 1.0)
    controls = drive.controls_over_a_step(before, wanted)
    act, means = before.copy(), np.zeros_like(before)
    tau_rise, tau_fall = 0.01, 0.04
    for _ in range(25):
        means += act / 25
        difference = controls - act
        factor = 0.5 + 1.5 * act
        rate = np.where(difference > 0, 1 / (tau_rise * factor), factor / tau_fall)
        act = act + 0.002 * rate * difference
    reachable = (controls > 0.0) & (controls < 1.0)
    assert reachable.mean() > 0.3
    np.testing.assert_allclose(means[reachable], wanted[reachable], atol=0.05)


def test_the_muscles_forces_are_mujoco_s() -> None:
    batch = _batch(20)
    drive = JointDrive(batch, SCALE)
    dense = np.zeros((20, 32, USER.physics_model.nv))
    dense[:, drive._moment_rows, drive._moment_columns] = batch.live("actuator_moment")
    for speed in (0.0, 3.0):
        velocity = np.full((20, 32), speed) * np.linspace(-1, 1, 32)
        gain, bias = drive._curves(batch.live("actuator_length"), velocity)
        model = USER.physics_model
        for i in range(20):
            length = batch.live("actuator_length")[i]
            for m in range(32):
                parameters = model.actuator_gainprm[m, :9]
                expected = mujoco.mju_muscleGain(
                    length[m],
                    velocity[i, m],
                    model.actuator_lengthrange[m],
                    model.actuator_acc0[m],
                    parameters,
                )
                assert gain[i, m] == pytest.approx(expected, rel=1e-9, abs=1e-9)
                expected = mujoco.mju_muscleBias(
                    length[m],
                    model.actuator_lengthrange[m],
                    model.actuator_acc0[m],
                    model.actuator_biasprm[m, :9],
                )
                assert bias[i, m] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_predicted_accelerations_are_mujoco_s() -> None:
    """Up to the couplings' softness."""
    batch = _batch(12)
    drive = JointDrive(batch, SCALE)
    activations = np.random.default_rng(1).uniform(0.0, 0.3, (12, 32))
    effect, rest = drive._accelerations(USER.coupled_motion(batch.qpos))
    predicted = np.einsum("njm,nm->nj", effect, activations) + rest
    for i in range(12):
        data = mujoco.MjData(USER.physics_model)
        data.qpos, data.qvel, data.act = batch.qpos[i], batch.qvel[i], activations[i]
        mujoco.mj_forward(USER.physics_model, data)
        found = data.qacc[USER.qvel_independent]
        assert np.abs((predicted[i] - found) / SCALE).max() < 0.1


def test_joints_accelerate_as_wanted() -> None:
    """Around a posture in front of the body, where the muscles can do what is asked."""
    batch = _batch(8)
    home = np.array([1.0, 0.9, 0.1, 1.4, 0.0, 0.1, -0.1])
    batch.reset(range(8), [np.random.default_rng(k) for k in range(8)], [home] * 8)
    drive = JointDrive(batch, SCALE)
    rng = np.random.default_rng(1)
    wanted, found = [], []
    for step in range(25):
        angles, speeds = batch.qpos[:, USER.qpos_independent], batch.qvel[:, USER.qvel_independent]
        asked = 60.0 * (home - angles) - 8.0 * speeds + 0.3 * SCALE * rng.uniform(-1, 1, (8, 7))
        batch.step(drive.controls_for(asked) - batch.act)
        if step >= 8:  # the drawn activations of the start are over
            wanted.append(asked)
            found.append((batch.qvel[:, USER.qvel_independent] - speeds) / batch.dt)
    for joint in range(7):
        one, other = (np.array(values)[..., joint].ravel() for values in (wanted, found))
        assert np.corrcoef(one, other)[0, 1] > 0.8, USER.independent_joints[joint]


def test_an_arm_that_wants_nothing_stays_where_it_is() -> None:
    """Gravity is held; a limp arm falls."""
    held, limp = _batch(8), _batch(8)
    drive = JointDrive(held, SCALE)
    moved = []
    for step in range(12):
        before = (held.end_effector_pos, limp.end_effector_pos)
        speeds = held.qvel[:, USER.qvel_independent]
        held.step(drive.controls_for(-4.0 * speeds) - held.act)
        limp.step(-limp.act)
        if step >= 4:  # the drawn activations of the start are over
            after = (held.end_effector_pos, limp.end_effector_pos)
            moved.append(
                [np.linalg.norm(a - b, axis=1) for a, b in zip(after, before, strict=True)]
            )
    of_held, of_limp = np.median(np.sum(moved, axis=0), axis=1)
    assert of_held < 0.3 * of_limp


def test_a_user_s_activations_are_its_own() -> None:
    together, wanted = _batch(3), 10.0 * np.random.default_rng(2).uniform(-1, 1, (3, 7))
    expected = JointDrive(together, SCALE).controls_for(wanted)
    alone = UserBatch(USER, 1, threads=1)
    drive = JointDrive(alone, SCALE)
    alone.set_state(0, together.get_state(2))
    np.testing.assert_array_equal(drive.controls_for(wanted[2:]), expected[2:])


def test_the_hand_accelerates_as_wanted() -> None:
    """The controller's own velocity, by MuJoCo's Jacobian, changes as asked; the joints follow."""
    batch = _batch(8)
    home = np.array([1.0, 0.9, 0.1, 1.4, 0.0, 0.1, -0.1])
    batch.reset(range(8), [np.random.default_rng(k) for k in range(8)], [home] * 8)
    drive = JointDrive(batch, SCALE)
    model = USER.physics_model
    site = model.site("controller_right").id

    def velocity(i: int) -> np.ndarray:
        data = mujoco.MjData(model)
        data.qpos = batch.qpos[i]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        return jacobian @ batch.qvel[i]

    rng = np.random.default_rng(3)
    place, _ = batch.device_poses("controller_right")
    wanted, found = [], []
    for step in range(25):
        before = np.array([velocity(i) for i in range(8)])
        speeds = batch.qvel[:, USER.qvel_independent]
        told = drive.device_velocities("controller_right", speeds)
        np.testing.assert_allclose(told, before, atol=0.05)  # but for the couplings' softness
        here, _ = batch.device_poses("controller_right")
        asked = 60.0 * (place - here) - 8.0 * told + rng.uniform(-6, 6, (8, 3))
        joints = 15.0 * (home - batch.qpos[:, USER.qpos_independent]) - 4.0 * speeds
        batch.step(drive.controls_for(joints, "controller_right", asked) - batch.act)
        if step >= 8:
            wanted.append(asked)
            found.append((np.array([velocity(i) for i in range(8)]) - before) / batch.dt)
    for axis in range(3):
        one, other = (np.array(values)[..., axis].ravel() for values in (wanted, found))
        assert np.corrcoef(one, other)[0, 1] > 0.9


def test_wrong_shapes_are_named() -> None:
    batch = _batch(2)
    with pytest.raises(ValueError, match=r"scale_radps2: got shape \(3,\), expected \(7,\)"):
        JointDrive(batch, np.ones(3))
    with pytest.raises(ValueError, match=r"joints: got shape \(1, 7\), expected \(2, 7\)"):
        JointDrive(batch, SCALE).controls_for(np.zeros((1, 7)))


def test_coupled_motion_is_the_slope_of_coupled_postures() -> None:
    posture = np.array([0.4, 1.1, -0.3, 1.2, 0.2, 0.1, -0.2])
    slopes = USER.coupled_motion(USER.coupled_qpos(posture)[None])[0]
    for joint in range(7):
        step = np.zeros(7)
        step[joint] = 1e-6
        apart = USER.coupled_qpos(posture + step) - USER.coupled_qpos(posture - step)
        np.testing.assert_allclose(slopes[:, joint], apart / 2e-6, atol=1e-7)
