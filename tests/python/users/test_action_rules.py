from pathlib import Path

import numpy as np
import pytest

from python.users.bodies import OWN_ARM, PENDULUM, PENDULUM_DESCRIPTION, write_body
from python.users.bodies import body as made
from sim2vr_harness.perception import Proprioception
from sim2vr_harness.users import MotorNoiseSettings, UserBatch, load_body, make_effort
from sim2vr_harness.users.actuation import Actuation
from sim2vr_harness.users.bodies.registry import installed_bodies

BODY = made(OWN_ARM)


def _batch(n: int = 2, **settings: object) -> UserBatch:
    batch = UserBatch(BODY, n, threads=1, effort="neural", **settings)  # type: ignore[arg-type]
    batch.reset(range(n), [np.random.default_rng(i) for i in range(n)])
    return batch


def test_motors_and_muscles_follow_their_rules() -> None:
    batch = _batch()
    motor, act = batch.motor, batch.act
    action = np.tile([0.25, -2.0, 0.5, -0.5, 0.0, 1.0], (2, 1))
    batch.step(action)
    # m <- 0.1 m + 0.9 clip(m + a, 0, 1), where a is clipped to [-1, 1].
    expected = 0.1 * motor + 0.9 * np.clip(motor + np.array([0.25, -1.0]), 0.0, 1.0)
    np.testing.assert_array_equal(batch.motor, expected)
    low, span = np.array([-0.8, -0.5]), np.array([3.6, 2.1])
    np.testing.assert_allclose(batch.ctrl[:, :2], low + expected * span, atol=1e-15)
    muscles = np.clip(act + np.array([0.5, -0.5, 0.0, 1.0]), 0.0, 1.0)
    np.testing.assert_array_equal(batch.ctrl[:, 2:], muscles)
    # Motors by their forcerange, muscles by their F0.
    assert BODY.peak_forces.tolist() == [40.0, 40.0, 600.0, 600.0, 150.0, 150.0]


def test_start_draws_activations_then_motors() -> None:
    batch = _batch(1)
    rng = np.random.default_rng(0)
    posture = np.array([0.4, 0.0, 1.4, 0.0])
    np.testing.assert_array_equal(batch.qpos[0], rng.uniform(-0.05, 0.05, 4) + posture)
    np.testing.assert_array_equal(batch.qvel[0], rng.uniform(-0.05, 0.05, 4))
    np.testing.assert_array_equal(batch.act[0], rng.uniform(0, 1, 4))
    np.testing.assert_array_equal(batch.motor[0], rng.uniform(0, 1, 2))


@pytest.mark.parametrize("name", installed_bodies())
def test_idleness_tires_no_muscle_and_the_hand_comes_to_rest(name: str) -> None:
    """From 5 s on hands stay within 2 cm; the published arms hang where they began, within 5 cm."""
    body = made(name, timestep_s=0.005)
    effort = "cumulative_fatigue_3ccr" if body.muscles else "neural"
    batch = UserBatch(body, 2, threads=1, effort=effort, substeps=10)
    batch.reset(range(2), [np.random.default_rng(i) for i in range(2)])
    hands = [device for device in body.devices if device != "headset"]
    path = []
    for _ in range(1200 if name == "mobl_arms_wrist" else 200):
        path.append(np.stack([batch.device_poses(hand)[0] for hand in hands]))
        batch.step(np.tile(Actuation(body).rest, (2, 1)))
    moved = np.linalg.norm(np.array(path) - path[-1], axis=-1)
    assert moved[100:].max() < 0.02
    if body.muscles:
        assert batch.effort.max_fatigued().max() < 0.005
        assert batch.act.max() < 1e-3
        if name.startswith("mobl_arms"):
            assert moved[0].max() < 0.05


def test_motors_come_last_in_proprioception() -> None:
    batch, sense = _batch(), Proprioception(BODY)
    seen = sense.observe(batch)
    assert sense.size == 3 * 4 + 3 + 4 + 2 == seen.shape[1]
    np.testing.assert_allclose(seen[:, -6:-2], 2 * batch.act - 1, atol=1e-6)
    np.testing.assert_allclose(seen[:, -2:], 2 * batch.motor - 1, atol=1e-6)
    assert sense.names[-1] == "shoulder_abduction_motor target"
    elbow = batch.qpos[:, BODY.independent_joints.index("elbow_flexion")]
    np.testing.assert_allclose(seen[:, 2], elbow / 2.4 * 2 - 1, atol=1e-6)


def test_effort_of_a_mixed_body() -> None:
    """Neural counts raw controls of all, fatigue the muscles, endurance those that lift."""
    batch = _batch()
    batch.step(np.full((2, 6), 0.3))
    np.testing.assert_allclose(batch.effort_cost, 1e-4 * (batch.ctrl**2).sum(axis=1), rtol=1e-12)
    fatigue = UserBatch(BODY, 1, threads=1)
    assert fatigue.effort.state_dict()["MA"].shape == (1, 4)
    # Half of a motor's 40 Nm: E = 1236.5 / 35^0.618 - 72.5; ln 35 = 3.5553481, x 0.618 = 2.1972051,
    # e^ = 8.999824; 1236.5 / 8.999824 = 137.39158; E = 64.89158 s; cost = 0.05 / 64.89158.
    endurance = make_effort("consumed_endurance", 1, BODY)
    force = np.array([[20.0, 0.0, -600.0, 0.0, 0.0, 0.0]])  # biceps does not lift here
    cost = endurance.update(np.zeros((1, 4)), np.zeros((1, 6)), force)
    assert cost == pytest.approx([0.05 / 64.89158], rel=1e-5)


def test_noise_is_the_muscles_alone() -> None:
    plain, noisy = _batch(), _batch(noise=MotorNoiseSettings())
    np.testing.assert_array_equal(plain.act, noisy.act)
    for batch in (plain, noisy):
        batch.step(np.zeros((2, 6)))
    np.testing.assert_array_equal(plain.ctrl[:, :2], noisy.ctrl[:, :2])
    assert (plain.ctrl[:, 2:] != noisy.ctrl[:, 2:]).any()


def test_a_body_without_muscles(tmp_path: Path) -> None:
    description = PENDULUM_DESCRIPTION | {"actuators": [{"names": ["drive"], "rule": "direct"}]}
    body = load_body(write_body(tmp_path, PENDULUM, description), appearance=False)
    batch = UserBatch(body, 1, threads=1, effort="neural", substeps=100)
    batch.step(np.array([[0.5]]))
    assert batch.ctrl.tolist() == [[0.5]]
    assert batch.act.shape == batch.motor.shape == (1, 0)
    batch.step(Actuation(body).rest[None])
    assert batch.ctrl.tolist() == [[0.0]]
    assert np.isnan(body.peak_forces).all()
    for effort in ("cumulative_fatigue_3ccr", "consumed_endurance"):
        with pytest.raises(ValueError, match=f"'{effort}' for body 'body', which"):
            UserBatch(body, 1, effort=effort)


def test_a_motor_needs_a_range(tmp_path: Path) -> None:
    unlimited = PENDULUM.replace(' ctrlrange="-1 1"', "")
    with pytest.raises(ValueError, match="'motor' for actuator 'drive', which has no ctrlrange"):
        load_body(write_body(tmp_path, unlimited, PENDULUM_DESCRIPTION))
