"""What every body that is registered must keep, with and without a trunk that moves."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim2vr_harness.perception import Proprioception
from sim2vr_harness.users import Body, Physique, ResetOptions, UserBatch, list_bodies, load_body
from sim2vr_harness.users.bodies import DEVICES
from sim2vr_harness.users.bodies.export import export_body

TRUNKS = ("mobl_arms_bimanual_motor", "mobl_arms_wrist")
CASES = [(name, False) for name in list_bodies()] + [(name, True) for name in TRUNKS]


@pytest.fixture(params=CASES, ids=[f"{name}{'-torso' * torso}" for name, torso in CASES])
def body(request: pytest.FixtureRequest) -> Body:
    name, torso = request.param
    return loaded(name, torso)


@cache
def loaded(name: str, torso: bool) -> Body:
    return load_body(name, torso=torso)


def batch_of(body: Body, n: int = 1, threads: int = 1) -> UserBatch:
    return UserBatch(body, n, threads=threads, effort="neural")


def actions(body: Body, steps: int, n: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, n, body.action_size))


def rngs(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]


def state(batch: UserBatch, i: int) -> list[np.ndarray]:
    poses = [part[i] for name in batch.body.devices for part in batch.device_poses(name)]
    own = (batch.qpos, batch.qvel, batch.act, batch.motor, batch.effort_cost)
    return [*(part[i] for part in own), *poses]


def equal(one: list[np.ndarray], two: list[np.ndarray]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_what_it_says_of_itself(body: Body) -> None:
    assert set(body.devices) <= set(DEVICES)
    assert "headset" in body.devices
    assert len(body.action_names) == len(set(body.action_names)) == body.action_size
    assert body.joint_ranges.shape == (len(body.independent_joints), 2)
    assert (body.joint_ranges[:, 0] < body.joint_ranges[:, 1]).all()
    assert body.physics_model.opt.timestep == body.timestep
    for device in body.devices:  # where the app is told they are
        assert body.physics_model.site(device).id >= 0
    sense = Proprioception(body)
    assert len(sense.names) == sense.size == len(set(sense.names))


def test_the_same_seed_and_actions_give_the_same_bits(body: Body) -> None:
    """For any number of users, place among them and number of threads."""
    played = actions(body, 10, 3)
    many, alone = batch_of(body, 3, threads=2), batch_of(body)
    many.reset([0, 1, 2], rngs(1, 2, 3))
    alone.reset([0], rngs(3))
    assert not equal(state(many, 0), state(many, 1))  # seeds matter
    for step in played:
        many.step(step)
        alone.step(step[2:])
        assert equal(state(many, 2), state(alone, 0))
    assert not many.diverged.any()
    assert all(np.isfinite(part).all() for part in state(many, 0))
    sense = Proprioception(body)
    seen = sense.observe(many)
    assert seen.shape == (3, sense.size)
    assert sense.observation_space.contains(seen[0])
    assert np.abs(seen[0] - seen[1]).max() > 0.01


def test_a_saved_user_goes_on_to_the_bit(body: Body) -> None:
    played = actions(body, 12, 1)
    one, two = batch_of(body), batch_of(body)
    for step in played[:5]:
        one.step(step)
    two.load_state_dict(0, one.state_dict(0))
    for step in played[5:]:
        one.step(step)
        two.step(step)
        assert equal(state(one, 0), state(two, 0))


def test_everything_that_moves_can_be_moved(body: Body) -> None:
    """Every independent joint that starts at rest is elsewhere after random actions."""
    batch = batch_of(body)
    start = batch.qpos[0, body.qpos_independent]
    moved = np.zeros(len(start))
    for step in actions(body, 30, 1, seed=4):
        batch.step(step)
        moved = np.maximum(moved, np.abs(batch.qpos[0, body.qpos_independent] - start))
    assert dict(zip(body.independent_joints, moved > 0.005, strict=True)) == dict.fromkeys(
        body.independent_joints, True
    )


def test_it_begins_as_told(body: Body) -> None:
    if "controller_left" not in body.devices:
        return
    reset = ResetOptions(posture="ready", hold=True, position_range=0.0)
    told = load_body(body.name, appearance=False, torso=body.nod is not None, reset=reset)
    q = batch_of(told).qpos[0, told.qpos_independent]
    expected = [told.reset_rule.posture.get(j, 0.0) for j in told.independent_joints]
    np.testing.assert_array_equal(q, expected)
    low, high = told.joint_ranges.T
    assert ((low <= q) & (q <= high)).all()


def test_other_people_can_be_it(body: Body) -> None:
    person = Physique(stature_m=1.55, handedness="left")
    other = load_body(body.name, person=person, torso=body.nod is not None, appearance=False)
    assert other.action_names == body.action_names
    batch = batch_of(other)
    for step in actions(other, 10, 1):
        batch.step(step)
    assert not batch.diverged.any()
    hands = (batch_of(body).end_effector_pos[0], batch_of(other).end_effector_pos[0])
    assert np.abs(hands[0] - hands[1]).max() > 1e-3


def test_it_can_be_exported(body: Body, tmp_path: Path) -> None:
    file = tmp_path / "body.xml"
    export_body(body, file)
    again = mujoco.MjModel.from_xml_path(str(file))
    first, second = mujoco.MjData(body.model), mujoco.MjData(again)
    low, high = again.actuator_ctrlrange.T
    first.ctrl[:] = second.ctrl[:] = np.random.default_rng(1).uniform(low, high)
    mujoco.mj_step(body.model, first, 100)
    mujoco.mj_step(again, second, 100)
    np.testing.assert_allclose(second.qpos, first.qpos, atol=1e-12)
