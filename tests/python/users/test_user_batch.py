from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client.frames import rotation_to_app
from sim2vr_harness.users import MotorNoiseSettings, UserBatch, load_body, make_effort

BODY = load_body("mobl_arms_wrist")
FIELDS = (
    "qpos",
    "qvel",
    "qacc",
    "act",
    "ctrl",
    "actuator_force",
    "end_effector_pos",
    "effort_cost",
    "time",
    "diverged",
)


def _rngs(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]


def _actions(steps: int, n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, n, 32))


def _snapshot(batch: UserBatch) -> dict[str, np.ndarray]:
    fields = {name: getattr(batch, name) for name in FIELDS}
    for device in BODY.devices:
        fields[f"{device} pos"], fields[f"{device} quat"] = batch.device_poses(device)
    fields |= {f"effort {k}": v for k, v in batch.effort.state_dict().items()}
    return fields


def _play(
    actions: np.ndarray, seeds: list[int], *, pose_samples: int = 1, **settings: Any
) -> UserBatch:
    batch = UserBatch(BODY, actions.shape[1], **{"threads": 1, **settings})
    batch.reset(range(batch.n), _rngs(*seeds))
    for action in actions:
        batch.step(action, pose_samples=pose_samples)
    return batch


def _assert_same(a: dict[str, np.ndarray], b: dict[str, np.ndarray], rows: Any = ...) -> None:
    for name, values in a.items():
        np.testing.assert_array_equal(values[rows], b[name], err_msg=name)


def test_reset_follows_the_reference() -> None:
    batch = UserBatch(BODY, 3, threads=1)
    batch.reset([2, 0], _rngs(7, 8))
    rng = np.random.default_rng(7)
    free = BODY.qpos_independent
    np.testing.assert_array_equal(batch.qpos[2, free], rng.uniform(-0.05, 0.05, 7))
    np.testing.assert_array_equal(batch.qvel[2, BODY.qvel_independent], rng.uniform(-0.05, 0.05, 7))
    np.testing.assert_array_equal(batch.act[2], rng.uniform(0, 1, 32))
    assert not batch.qpos[:, BODY.qpos_dependent].any()
    assert not batch.qvel[:, BODY.qvel_dependent].any()
    assert not batch.time.any()
    # The effort model has already been updated once: rested units have followed half the load.
    np.testing.assert_allclose(batch.effort.state_dict()["MA"], 0.5 * batch.act, atol=1e-15)
    expected = 0.1 * np.linalg.norm(0.5 * batch.act, axis=1)
    np.testing.assert_allclose(batch.effort_cost, expected, atol=1e-15)


def test_reset_to_a_posture_draws_the_rest_as_ever() -> None:
    drawn, posed = UserBatch(BODY, 2, threads=1), UserBatch(BODY, 2, threads=1)
    posture = np.array([0.4, 1.1, -0.3, 1.2, 0.2, 0.1, -0.2])
    drawn.reset([1, 0], _rngs(7, 8))
    posed.reset([1, 0], _rngs(7, 8), [posture, None])
    np.testing.assert_array_equal(posed.qpos[1], BODY.coupled_qpos(posture))
    np.testing.assert_array_equal(posed.qpos[0], drawn.qpos[0])
    np.testing.assert_array_equal(posed.qvel, drawn.qvel)
    np.testing.assert_array_equal(posed.act, drawn.act)
    with pytest.raises(ValueError, match="postures: got 1, expected 2"):
        posed.reset([0, 1], _rngs(7, 8), [None])


def test_coarse_physics_stays_near() -> None:
    """50 ms in 10 steps of 5 ms instead of 25 of 2 ms: millimetres apart after a second."""
    actions = 0.3 * _actions(20, 4)
    fine = _play(actions, [1, 2, 3, 4])
    coarse = UserBatch(load_body("mobl_arms_wrist", timestep_s=0.005), 4, threads=1, substeps=10)
    coarse.reset(range(4), _rngs(1, 2, 3, 4))
    for action in actions:
        coarse.step(action)
    assert coarse.dt == fine.dt == pytest.approx(0.05)
    np.testing.assert_allclose(coarse.time, fine.time)
    apart = np.linalg.norm(coarse.end_effector_pos - fine.end_effector_pos, axis=1)
    assert 1e-5 < np.median(apart) < 0.02
    with pytest.raises(ValueError, match=r"timestep_s: got 0\.0, expected a number from"):
        load_body("mobl_arms_wrist", timestep_s=0.0)


def test_reset_leaves_the_others_alone() -> None:
    batch = _play(_actions(3, 3), [1, 2, 3])
    before = _snapshot(batch)
    batch.reset([1], _rngs(9))
    after = _snapshot(batch)
    for name in before:
        np.testing.assert_array_equal(before[name][[0, 2]], after[name][[0, 2]], err_msg=name)
    assert batch.time.tolist() == [pytest.approx(0.15), 0.0, pytest.approx(0.15)]
    # A reset user is like new, whatever it did before.
    fresh = UserBatch(BODY, 1, threads=1)
    fresh.reset([0], _rngs(9))
    batch.step(np.full((3, 32), 0.1))
    fresh.step(np.full((1, 32), 0.1))
    _assert_same(_snapshot(batch), _snapshot(fresh), rows=slice(1, 2))


def test_step_equals_plain_mujoco() -> None:
    """One mj_step after the other, with kinematics computed once more at the end."""
    actions = _actions(5, 1)
    batch = _play(actions, [4])
    start = UserBatch(BODY, 1, threads=1)
    start.reset([0], _rngs(4))
    model, data = BODY.model, mujoco.MjData(BODY.model)
    data.qpos[:], data.qvel[:], data.act[:] = start.qpos[0], start.qvel[0], start.act[0]
    mujoco.mj_forward(model, data)
    for action in actions[:, 0]:
        data.ctrl[:] = np.clip(data.act + action, 0, 1)
        mujoco.mj_step(model, data, 25)
    last_qacc = data.qacc.copy()
    mujoco.mj_kinematics(model, data)
    np.testing.assert_array_equal(batch.qpos[0], data.qpos)
    np.testing.assert_array_equal(batch.act[0], data.act)
    np.testing.assert_array_equal(batch.ctrl[0], data.ctrl)
    np.testing.assert_array_equal(batch.qacc[0], last_qacc)
    np.testing.assert_array_equal(batch.end_effector_pos[0], data.site("fingertip").xpos)
    for device in BODY.devices:
        pos, quat = batch.device_poses(device)
        np.testing.assert_array_equal(pos[0], data.site(device).xpos)
        np.testing.assert_array_equal(quat[0], data.body(device).xquat)
    assert batch.time[0] == pytest.approx(0.25)


def test_actions_change_the_current_activation() -> None:
    batch = UserBatch(BODY, 1, threads=1)
    act = batch.act
    batch.step(np.full((1, 32), 0.25, dtype=np.float32))
    np.testing.assert_array_equal(batch.ctrl, np.clip(act + 0.25, 0, 1))
    act = batch.act
    batch.step(np.full((1, 32), -5.0))  # clipped to -1: every control is 0
    assert not batch.ctrl.any()
    batch.step(np.full((1, 32), 5.0))
    assert (batch.ctrl == 1).all()


def test_threads_do_not_matter() -> None:
    actions = _actions(8, 3)
    one, two = (_play(actions, [5, 6, 7], threads=threads) for threads in (1, 2))
    _assert_same(_snapshot(one), _snapshot(two))


@pytest.mark.parametrize("effort", ["cumulative_fatigue_3ccr", "consumed_endurance", "neural"])
def test_company_does_not_matter(effort: str) -> None:
    actions = _actions(8, 3)
    noise = MotorNoiseSettings()
    together = _play(actions, [5, 6, 7], effort=effort, noise=noise)
    alone = _play(actions[:, 1:2], [6], effort=effort, noise=noise)
    _assert_same(_snapshot(together), _snapshot(alone), rows=slice(1, 2))


def test_seeds_matter() -> None:
    batch = _play(_actions(1, 1).repeat(2, axis=1), [1, 2])
    assert (batch.qpos[0] != batch.qpos[1]).any()


@pytest.mark.parametrize("samples", [5, 25])
def test_pose_samples(samples: int) -> None:
    actions = _actions(4, 2)
    plain, sampled = _play(actions, [1, 2]), _play(actions, [1, 2], pose_samples=samples)
    _assert_same(_snapshot(plain), _snapshot(sampled))
    last, _ = sampled.device_poses("controller_right", sample=samples - 1)
    np.testing.assert_array_equal(last, plain.device_poses("controller_right")[0])
    path = np.stack([sampled.device_poses("controller_right", sample=k)[0] for k in range(samples)])
    travelled = np.linalg.norm(np.diff(path, axis=0), axis=-1)
    assert (travelled > 0).all()
    assert travelled.max() < 0.1


def test_pose_samples_follow_shorter_steps() -> None:
    action = _actions(1, 1)[0]
    sampled, short = UserBatch(BODY, 1, threads=1), UserBatch(BODY, 1, threads=1, substeps=5)
    for batch in (sampled, short):
        batch.reset([0], _rngs(3))
    sampled.step(action, pose_samples=5)
    short.step(action)  # the first fifth of the same step
    first, _ = sampled.device_poses("controller_right", sample=0)
    np.testing.assert_array_equal(first, short.device_poses("controller_right")[0])


@pytest.mark.parametrize("noise", [None, MotorNoiseSettings("red", "red")])
def test_save_and_restore(noise: MotorNoiseSettings | None) -> None:
    actions = _actions(6, 2)
    batch = _play(actions, [1, 2], noise=noise)
    saved = batch.state_dict(1)
    assert all(isinstance(v, (np.ndarray, np.generic, bytes)) for v in saved.values())
    at_save = _snapshot(batch)
    other = _play(_actions(2, 3, seed=9), [7, 8, 9], noise=noise)
    other.load_state_dict(0, saved)
    restored = _snapshot(other)
    for name, values in at_save.items():
        np.testing.assert_array_equal(values[1], restored[name][0], err_msg=name)
    for action in actions:
        batch.step(action)
        other.step(np.stack([action[1], action[0], action[0]]))
    ahead, replayed = _snapshot(batch), _snapshot(other)
    for name, values in ahead.items():
        np.testing.assert_array_equal(values[1], replayed[name][0], err_msg=name)


def test_restore_errors() -> None:
    batch = UserBatch(BODY, 1, threads=1)
    state = batch.state_dict(0)
    with pytest.raises(ValueError, match=r"state: got keys .*, expected"):
        batch.load_state_dict(0, {"simulation": state["simulation"]})
    with pytest.raises(ValueError, match=r"state simulation: got shape \(3,\), expected"):
        batch.load_state_dict(0, {**state, "simulation": np.zeros(3)})
    with pytest.raises(ValueError, match="state simulation: got NaN"):
        batch.load_state_dict(0, {**state, "simulation": state["simulation"] * np.nan})
    with pytest.raises(ValueError, match="ids: got 1, expected 0 to 0"):
        batch.state_dict(1)


def test_a_motion_goes_on_from_where_it_is_put() -> None:
    actions = _actions(5, 1)
    first, other = _play(actions[:3], [1]), UserBatch(BODY, 1, threads=1)
    other.reset([0], _rngs(9))
    other.step(_actions(1, 1, 4)[0])
    other.set_motion(first.qpos, first.qvel, first.act, first.motor)
    for step in actions[3:]:
        first.step(step)
        other.step(step)
    for name in ("qpos", "qvel", "act"):  # the constraints' solver begins elsewhere
        np.testing.assert_allclose(getattr(other, name), getattr(first, name), atol=1e-5)


def test_a_motion_must_fit() -> None:
    batch = UserBatch(BODY, 2, threads=1)
    qpos, qvel, act, motor = batch.qpos, batch.qvel, batch.act, batch.motor
    with pytest.raises(ValueError, match=r"act: got shape \(1, 32\), expected \(2, 32\)"):
        batch.set_motion(qpos, qvel, act[:1], motor)
    with pytest.raises(ValueError, match="qvel: got NaN or infinity, expected finite numbers"):
        batch.set_motion(qpos + 0.1, np.full_like(qvel, np.nan), act, motor)
    np.testing.assert_array_equal(batch.qpos, qpos)


@pytest.mark.parametrize("speed", [1e5, 1e12])
def test_a_diverged_user_is_frozen_and_the_others_go_on(
    speed: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo notes the warning in MUJOCO_LOG.TXT
    actions = _actions(4, 3)
    healthy = _play(actions, [1, 2, 3])
    batch = _play(actions[:2], [1, 2, 3])
    batch._physics.qvel[1] = speed  # as a simulation about to blow up has it
    at_loss = _snapshot(batch)
    batch.step(actions[2], pose_samples=5)
    assert batch.diverged.tolist() == [False, True, False]
    for name, values in _snapshot(batch).items():
        assert np.isfinite(values[1]).all(), name
        if name not in ("diverged", "ctrl"):
            np.testing.assert_array_equal(values[1], at_loss[name][1], err_msg=name)
    batch.step(actions[3])
    np.testing.assert_array_equal(batch.qpos[1], at_loss["qpos"][1])
    for name, values in _snapshot(healthy).items():
        np.testing.assert_array_equal(values[[0, 2]], _snapshot(batch)[name][[0, 2]], err_msg=name)
    still = healthy.qpos, healthy.qvel, healthy.act, healthy.motor
    batch.set_motion(*still)
    batch.step(actions[0])
    assert not batch.diverged.any()
    batch.reset([1], _rngs(4))
    assert not batch.diverged.any()
    batch.step(actions[0])
    assert not batch.diverged.any()


def test_noise_changes_the_controls_but_not_the_start() -> None:
    plain = UserBatch(BODY, 1, threads=1)
    noisy = UserBatch(BODY, 1, threads=1, noise=MotorNoiseSettings())
    for batch in (plain, noisy):
        batch.reset([0], _rngs(1))
    np.testing.assert_array_equal(plain.act, noisy.act)
    for batch in (plain, noisy):
        batch.step(np.zeros((1, 32)))
    assert (plain.ctrl != noisy.ctrl).any()
    assert noisy.ctrl.min() >= 0
    assert noisy.ctrl.max() <= 1


def test_arrays_are_copies() -> None:
    batch = UserBatch(BODY, 1, threads=1)
    for name in FIELDS:
        before = getattr(batch, name)
        getattr(batch, name)[...] = 1
        np.testing.assert_array_equal(getattr(batch, name), before, err_msg=name)
    pos, _ = batch.device_poses("headset")
    pos[:] = 7
    assert (batch.device_poses("headset")[0] != 7).all()


def test_effort_time_step_follows_the_substeps() -> None:
    assert UserBatch(BODY, 1, threads=1, substeps=10).effort.dt == pytest.approx(0.02)
    model = make_effort("neural", 2, BODY)
    assert UserBatch(BODY, 2, threads=1, effort=model).effort is model
    with pytest.raises(ValueError, match="effort: got a model of 2 users with 32 muscles"):
        UserBatch(BODY, 3, threads=1, effort=model)
    with pytest.raises(ValueError, match="effort_weight, effort_params: got values next to"):
        UserBatch(BODY, 2, threads=1, effort=model, effort_weight=1.0)


def _spoiled(value: float) -> np.ndarray:
    action = np.zeros((2, 32))
    action[1, 3] = value
    return action


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros((1, 32)), r"action: got shape \(1, 32\), expected \(2, 32\)"),
        (np.zeros(32), r"action: got shape \(32,\), expected \(2, 32\)"),
        (_spoiled(np.nan), r"action\[1, 3\] \(SUPSP\): got nan, expected a finite number"),
        (_spoiled(-np.inf), r"action\[1, 3\] \(SUPSP\): got -inf"),
        (np.full((2, 32), "a"), "action: got dtype <U1, expected real numbers"),
    ],
)
def test_wrong_actions_change_nothing(action: np.ndarray, message: str) -> None:
    batch = UserBatch(BODY, 2, threads=1)
    before = _snapshot(batch)
    with pytest.raises(ValueError, match=message):
        batch.step(action)
    _assert_same(_snapshot(batch), before)


def test_other_errors() -> None:
    batch = UserBatch(BODY, 2, threads=1)
    with pytest.raises(ValueError, match="pose_samples: got 3, expected a divisor of substeps=25"):
        batch.step(np.zeros((2, 32)), pose_samples=3)
    with pytest.raises(ValueError, match=r"device: got 'headst'.*did you mean 'headset'"):
        batch.device_poses("headst")
    with pytest.raises(ValueError, match="sample: got 1, expected -1 to 0"):
        batch.device_poses("headset", sample=1)
    with pytest.raises(ValueError, match="ids: got 2, expected 0 to 1"):
        batch.reset([2], _rngs(1))
    with pytest.raises(ValueError, match=r"ids: got .*, expected each user at most once"):
        batch.reset([1, 1], _rngs(1, 2))
    with pytest.raises(ValueError, match="rngs: got 1, expected 2, one per id"):
        batch.reset([0, 1], _rngs(1))
    with pytest.raises(ValueError, match="n: got 0, expected a whole number, at least 1"):
        UserBatch(BODY, 0)
    with pytest.raises(ValueError, match=r"effort: got 'neurall'.*did you mean 'neural'"):
        UserBatch(BODY, 1, effort="neurall")


def test_pauses_change_no_bit_and_show_the_moment() -> None:
    actions = _actions(2, 2)
    plain = _play(actions, [1, 2])
    batch = UserBatch(BODY, 2, threads=1)
    batch.reset([0, 1], _rngs(1, 2))
    seen: dict[int, dict[str, np.ndarray]] = {}
    stops = (1, 7, 10, 25)
    for action in actions:
        pauses = {s: lambda s=s: seen.__setitem__(s, _snapshot(batch)) for s in stops}
        batch.step(action, pose_samples=5, pauses=pauses)
        assert sorted(seen) == [1, 7, 10, 25]
    _assert_same(_snapshot(plain), _snapshot(batch))
    for name in ("qpos", "qvel", "time", "end_effector_pos", "qacc", "actuator_force"):
        np.testing.assert_array_equal(seen[25][name], _snapshot(batch)[name], err_msg=name)
    # After 7 substeps: 7 single ones with the same controls.
    single = UserBatch(BODY, 1, threads=1)
    single.reset([0], _rngs(1))
    single.step(actions[0][:1])
    model, data = BODY.model, mujoco.MjData(BODY.model)
    data.qpos[:], data.qvel[:], data.act[:] = single.qpos[0], single.qvel[0], single.act[0]
    data.qacc_warmstart[:] = single._physics.batch.bind("qacc_warmstart")[0]
    data.ctrl[:] = np.clip(single.act[0] + actions[1][0], 0, 1)
    mujoco.mj_step(model, data, 7)
    np.testing.assert_array_equal(seen[7]["qpos"][0], data.qpos)
    np.testing.assert_array_equal(seen[7]["qacc"][0], data.qacc)
    mujoco.mj_kinematics(model, data)
    hand = seen[7]["controller_right pos"][0]
    np.testing.assert_array_equal(hand, data.site("controller_right").xpos)
    with pytest.raises(ValueError, match="pauses: got substep 26, expected 1 to 25"):
        batch.step(actions[0], pauses={26: lambda: None})


def test_a_head_that_is_asked_to_look() -> None:
    """The reference's rotations by placement (Unity x y z w): 30 down, 10 down, 30 up."""
    batch = _play(_actions(1, 4), [1, 2, 3, 4])
    held = batch.device_poses("headset")
    batch.turn_head([0, 1, 2], [-30.0, -10.0, 30.0])
    position, rotation = batch.device_poses("headset")
    np.testing.assert_array_equal(position, held[0])
    expected = [
        (-0.258819, 0.0, 0.0, -0.9659258),
        (-0.0871556774, 0.0, 0.0, -0.99619472),
        (0.258819, 0.0, 0.0, -0.9659258),
    ]
    np.testing.assert_allclose(rotation_to_app(rotation[:3]), expected, atol=1e-7)
    assert (rotation_to_app(rotation[:3])[:, 1:3] == 0).all()  # a pure pitch
    np.testing.assert_array_equal(rotation[3], held[1][3])
    batch.step(_actions(1, 4)[0], pose_samples=5)
    for sample in range(5):
        np.testing.assert_array_equal(batch.device_poses("headset", sample)[1][:3], rotation[:3])
    other = UserBatch(BODY, 1, threads=1)
    other.load_state_dict(0, batch.state_dict(2))
    np.testing.assert_array_equal(other.device_poses("headset")[1][0], rotation[2])
    batch.turn_head([1], None)
    assert (batch.device_poses("headset")[1][1] != rotation[1]).any()
    batch.reset([0], _rngs(1))
    assert (batch.device_poses("headset")[1][0] != rotation[0]).any()
    np.testing.assert_array_equal(batch.device_poses("headset")[1][2], rotation[2])
    with pytest.raises(ValueError, match=r"pitch_deg: got 95.0, expected -90 to 90 degrees"):
        batch.turn_head([0], 95.0)
    with pytest.raises(ValueError, match="pitch_deg: got 1, expected 2, one per id"):
        batch.turn_head([0, 1], [3.0])
    with pytest.raises(ValueError, match="for a body without a headset"):
        bare = load_body("mobl_arms_wrist", devices=(), appearance=False)
        UserBatch(bare, 1, threads=1).turn_head([0], 3.0)
