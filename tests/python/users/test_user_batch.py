from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from python.users.bodies import body, rngs
from sim2vr_harness.client.frames import rotation_to_app
from sim2vr_harness.users import MotorNoiseSettings, UserBatch, make_effort

BODY = body()
FIELDS = ("qpos", "qvel", "qacc", "act", "ctrl", "actuator_force", "end_effector_pos")
FIELDS += ("effort_cost", "time", "diverged")
POSTURE = np.array([0.4, 1.1, -0.3, 1.2, 0.2, 0.1, -0.2])


def users(*seeds: int, **settings: Any) -> UserBatch:
    batch = UserBatch(BODY, len(seeds), **{"threads": 1} | settings)
    batch.reset(range(len(seeds)), rngs(*seeds))
    return batch


def _actions(steps: int, n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, n, 32))


def _snapshot(batch: UserBatch) -> dict[str, np.ndarray]:
    fields = {name: getattr(batch, name) for name in FIELDS}
    for device in BODY.devices:
        fields[f"{device} pos"], fields[f"{device} quat"] = batch.device_poses(device)
    return fields | {f"effort {k}": v for k, v in batch.effort.state_dict().items()}


def _play(actions: np.ndarray, *seeds: int, pose_samples: int = 1, **settings: Any) -> UserBatch:
    batch = users(*seeds, **settings)
    for action in actions:
        batch.step(action, pose_samples=pose_samples)
    return batch


def _same(a: Any, b: Any, rows: Any = ..., others: Any = ...) -> None:
    """Whether users of one batch are as those of another, in everything."""
    one, two = (each if isinstance(each, dict) else _snapshot(each) for each in (a, b))
    for name, values in one.items():
        np.testing.assert_array_equal(values[rows], two[name][others], err_msg=name)


def test_reset_follows_the_reference_and_a_posture_draws_the_rest_as_ever() -> None:
    batch = UserBatch(BODY, 3, threads=1)
    batch.reset([2, 0], rngs(7, 8))
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
    posed = UserBatch(BODY, 3, threads=1)
    posed.reset([2, 0], rngs(7, 8), [POSTURE, None])
    np.testing.assert_array_equal(posed.qpos[2], BODY.coupled_qpos(POSTURE))
    np.testing.assert_array_equal(posed.qpos[0], batch.qpos[0])
    np.testing.assert_array_equal(posed.qvel, batch.qvel)
    np.testing.assert_array_equal(posed.act, batch.act)


def test_step_equals_plain_mujoco() -> None:
    """One mj_step after the other, with kinematics computed once more at the end."""
    actions = _actions(5, 1)
    batch, start = _play(actions, 4), users(4)
    model, data = BODY.model, mujoco.MjData(BODY.model)
    data.qpos[:], data.qvel[:], data.act[:] = start.qpos[0], start.qvel[0], start.act[0]
    mujoco.mj_forward(model, data)
    for action in actions[:, 0]:
        data.ctrl[:] = np.clip(data.act + action, 0, 1)
        mujoco.mj_step(model, data, 25)
    last_qacc = data.qacc.copy()
    mujoco.mj_kinematics(model, data)
    expected = {"qpos": data.qpos, "act": data.act, "ctrl": data.ctrl, "qacc": last_qacc}
    expected["end_effector_pos"] = data.site("fingertip").xpos
    for device in BODY.devices:
        expected[f"{device} pos"] = data.site(device).xpos
        expected[f"{device} quat"] = data.body(device).xquat
    for name, values in expected.items():
        np.testing.assert_array_equal(_snapshot(batch)[name][0], values, err_msg=name)
    assert batch.time[0] == pytest.approx(0.25)


def test_actions_change_the_current_activation() -> None:
    batch = users(0)
    act = batch.act
    batch.step(np.full((1, 32), 0.25, dtype=np.float32))
    np.testing.assert_array_equal(batch.ctrl, np.clip(act + 0.25, 0, 1))
    batch.step(np.full((1, 32), -5.0))  # clipped to -1: every control is 0
    assert not batch.ctrl.any()
    batch.step(np.full((1, 32), 5.0))
    assert (batch.ctrl == 1).all()


@pytest.mark.parametrize("effort", ["cumulative_fatigue_3ccr", "consumed_endurance"])
def test_threads_and_company_do_not_matter_but_seeds_do(effort: str) -> None:
    actions, noise = _actions(8, 3), MotorNoiseSettings()
    together = _play(actions, 5, 6, 7, effort=effort, noise=noise)
    _same(together, _play(actions, 5, 6, 7, effort=effort, noise=noise, threads=2))
    _same(together, _play(actions[:, 1:2], 6, effort=effort, noise=noise), slice(1, 2))
    batch = _play(_actions(1, 1).repeat(2, axis=1), 1, 2)
    assert (batch.qpos[0] != batch.qpos[1]).any()


def test_pose_samples() -> None:
    samples = 5
    actions = _actions(4, 2)
    plain, sampled = _play(actions, 1, 2), _play(actions, 1, 2, pose_samples=samples)
    _same(plain, sampled)
    path = np.stack([sampled.device_poses("controller_right", sample=k)[0] for k in range(samples)])
    np.testing.assert_array_equal(path[-1], plain.device_poses("controller_right")[0])
    travelled = np.linalg.norm(np.diff(path, axis=0), axis=-1)
    assert (travelled > 0).all()
    assert travelled.max() < 0.1
    # The first sample of a step is the end of a step that is so much shorter.
    first, short = users(3), users(3, substeps=25 // samples)
    first.step(actions[0][:1], pose_samples=samples)
    short.step(actions[0][:1])
    place = first.device_poses("controller_right", sample=0)[0]
    np.testing.assert_array_equal(place, short.device_poses("controller_right")[0])


def test_save_and_restore() -> None:
    actions = _actions(6, 2)
    settings: dict[str, Any] = {"noise": MotorNoiseSettings("red", "red"), "head": "reflex"}
    batch = _play(actions, 1, 2, **settings)
    saved = batch.state_dict(1)
    other = _play(_actions(2, 3, seed=9), 7, 8, 9, **settings)
    other.load_state_dict(0, saved)
    _same(batch, other, 1, 0)
    for action in actions:
        batch.step(action)
        other.step(np.stack([action[1], action[0], action[0]]))
    _same(batch, other, 1, 0)


def test_a_diverged_user_is_frozen_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo notes the warning in MUJOCO_LOG.TXT
    actions = _actions(4, 3)
    healthy, batch = _play(actions, 1, 2, 3), _play(actions[:2], 1, 2, 3)
    qvel = batch.qvel
    qvel[1] = 1e5  # as a simulation about to blow up has it
    batch.set_motion(batch.qpos, qvel, batch.act, batch.motor)
    at_loss = _snapshot(batch)
    batch.step(actions[2], pose_samples=5)
    assert batch.diverged.tolist() == [False, True, False]
    for name, values in _snapshot(batch).items():
        assert np.isfinite(values[1]).all(), name
        if name not in ("diverged", "ctrl"):
            np.testing.assert_array_equal(values[1], at_loss[name][1], err_msg=name)
    batch.step(actions[3])
    np.testing.assert_array_equal(batch.qpos[1], at_loss["qpos"][1])
    _same(healthy, batch, [0, 2], [0, 2])
    batch.set_motion(healthy.qpos, healthy.qvel, healthy.act, healthy.motor)
    batch.step(actions[0])
    assert not batch.diverged.any()
    batch.reset([1], rngs(4))
    batch.step(actions[0])
    assert not batch.diverged.any()


def test_arrays_are_copies() -> None:
    batch = users(0)
    for name in FIELDS:
        before = getattr(batch, name)
        getattr(batch, name)[...] = 1
        np.testing.assert_array_equal(getattr(batch, name), before, err_msg=name)
    batch.device_poses("headset")[0][:] = 7
    assert (batch.device_poses("headset")[0] != 7).all()


def test_pauses_change_no_bit_and_show_the_moment() -> None:
    actions = _actions(2, 2)
    plain, batch = _play(actions, 1, 2), users(1, 2)
    seen: dict[int, dict[str, np.ndarray]] = {}
    for action in actions:
        stops = (1, 7, 10, 25)
        pauses = {s: lambda s=s: seen.__setitem__(s, _snapshot(batch)) for s in stops}
        batch.step(action, pose_samples=5, pauses=pauses)
        assert sorted(seen) == [1, 7, 10, 25]
    _same(plain, batch)
    for name in ("qpos", "qvel", "time", "end_effector_pos", "qacc", "actuator_force"):
        np.testing.assert_array_equal(seen[25][name], _snapshot(batch)[name], err_msg=name)
    # After 10 substeps, what the second of five samples has.
    hand = batch.device_poses("controller_right", sample=1)[0]
    np.testing.assert_array_equal(seen[10]["controller_right pos"], hand)


def test_a_head_that_is_asked_to_look() -> None:
    """The reference's rotations by placement (Unity x y z w): 30 down, 10 down, 30 up."""
    batch = _play(_actions(1, 4), 1, 2, 3, 4)
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
    other = users(0)
    other.load_state_dict(0, batch.state_dict(2))
    np.testing.assert_array_equal(other.device_poses("headset")[1][0], rotation[2])
    batch.turn_head([1], None)
    batch.reset([0], rngs(1))
    now = batch.device_poses("headset")[1]
    assert (now[1] != rotation[1]).any() and (now[0] != rotation[0]).any()
    np.testing.assert_array_equal(now[2], rotation[2])


def _spoiled(value: float) -> np.ndarray:
    action = np.zeros((2, 32))
    action[1, 3] = value
    return action


def _with(batch: UserBatch, **changes: Any) -> Any:
    return batch.load_state_dict(0, batch.state_dict(0) | changes)


NAN, MODEL = float("nan"), make_effort("neural", 3, BODY)
WRONG: list[tuple[Callable[[UserBatch], Any], str]] = [
    (lambda b: b.step(np.zeros((1, 32))), r"action: got shape \(1, 32\), expected \(2, 32\)"),
    (lambda b: b.step(_spoiled(NAN)), r"action\[1, 3\] \(SUPSP\): got nan, expected a finite nu"),
    (lambda b: b.step(_spoiled(0), pose_samples=3), "pose_samples: got 3, .* of substeps=25"),
    (lambda b: b.step(_spoiled(0), pauses={26: print}), "pauses: got substep 26, expected 1 to 25"),
    (lambda b: b.device_poses("headst"), r"device: got 'headst'.*did you mean 'headset'"),
    (lambda b: b.device_poses("headset", sample=1), "sample: got 1, expected -1 to 0"),
    (lambda b: b.reset([1, 1], rngs(1, 2)), r"ids: got .*, expected each user at most once"),
    (lambda b: b.reset([0, 1], rngs(1)), "rngs: got 1, expected 2, one per id"),
    (lambda b: b.load_state_dict(0, {"simulation": 0}), r"state: got keys .*, expected"),
    (lambda b: _with(b, simulation=np.zeros(3)), r"state simulation: got shape \(3,\), expected"),
    (
        lambda b: _with(b, simulation=b.state_dict(0)["simulation"] * NAN),
        "state simulation: got NaN",
    ),
    (
        lambda b: b.set_motion(b.qpos + 0.1, b.qvel * NAN, b.act, b.motor),
        "qvel: got NaN or infinity, expected finite numbers",
    ),
    (lambda b: b.turn_head([0], 95.0), r"pitch_deg: got 95.0, expected -90 to 90 degrees"),
    (lambda b: users(0, effort=MODEL), "effort: got a model of 3 users with 32 muscles"),
]


@pytest.mark.parametrize(("call", "message"), WRONG, ids=[message[:25] for _, message in WRONG])
def test_wrong_calls_change_nothing(call: Callable[[UserBatch], Any], message: str) -> None:
    batch = users(1, 2)
    before = _snapshot(batch)
    with pytest.raises(ValueError, match=message):
        call(batch)
    _same(before, batch)
