"""Exertion of rounds that are played: against the meters fed by hand from the simulation."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.play.exertion import ExertionRecorder
from sim2vr_harness.play.round import ARM_MEASURES, Round
from sim2vr_harness.users import PeopleSettings, Population, UserBatch, load_body
from sim2vr_harness.users.exertion import (
    ArmDynamics,
    Strength,
    arms_of,
    consumed_endurance_time,
    endurance_time,
)

STEPS = 20
ROUND = Round("easy", 0, 1, None, STEPS, "finished", {}, {})


def _played(model: str, strength: float = 1.0) -> tuple[ExertionRecorder, UserBatch, list]:
    """Two users who start with bent arms and tense all muscles for a second, and what they did."""
    body = load_body(model, appearance=False)
    users = UserBatch(body, 2, effort="neural")
    bent = [1.2 if name.startswith("elbow") else 0.5 for name in body.independent_joints]
    rngs = [np.random.default_rng(i) for i in range(2)]
    users.reset(np.arange(2), rngs, [np.clip(bent, *body.joint_ranges.T)] * 2)
    user = UserConfig.model_validate({"model": model, "person": {"strength": strength}})
    config = SimpleNamespace(user=user)
    recorder = ExertionRecorder()
    recorder.started(SimpleNamespace(users=users, config=config), [])
    moments = [(users.qpos, users.qvel)]
    for step in range(STEPS):
        users.step(np.full((2, body.action_size), 0.1))
        recorder.stepped(np.zeros(2), [])
        if step == STEPS // 2:
            recorder.measured(1, ROUND)
        moments.append((users.qpos, users.qvel))
    return recorder, users, moments


def test_one_arm() -> None:
    recorder, users, moments = _played("mobl_arms_wrist", 0.5)
    values = recorder.measured(0, ROUND).values
    assert not any(name.endswith("_left") for name in values), "there is no such arm"
    (arm,) = arms_of(users.body)
    dynamics, strength = ArmDynamics(users.body.physics_model, arm), Strength(factor=0.5)
    loads = [
        dynamics.load(q[0], v[0], (v[0] - w[0]) / 0.05) for (_, w), (q, v) in pairwise(moments)
    ]
    mean = np.mean([load.torque for load in loads])
    consumed = 100.0 / consumed_endurance_time(mean / strength.consumed_endurance_torque)
    assert values["exertion.consumed_endurance_right"] == pytest.approx(float(consumed))
    assert consumed > 0.0
    # Neither raised above 90 degrees nor at rest: NICER is that of the mean torque, too.
    assert max(load.shoulder_deg for load in loads) < 90.0
    assert not any(load.shoulder_deg <= 25.0 and load.elbow_deg >= 125.0 for load in loads)
    maximum = strength.shoulder_torque(loads[-1].shoulder_deg, loads[-1].elbow_deg)
    expected = 100.0 / endurance_time(mean / maximum)
    assert values["exertion.nicer_right"] == pytest.approx(float(expected))
    both = _played("mobl_arms_bimanual_motor")[0].measured(0, ROUND).values
    assert {measure.name for measure in ARM_MEASURES} == {k for k, v in both.items() if v}


@pytest.mark.parametrize("median", [0.78, 1.28])
def test_rounds_of_people_count_their_strength_among_their_sex(median: float) -> None:
    people = Population(PeopleSettings(strength=median, vary=("strength",), seed=2))
    persons = [people.number(i) for i in range(6)]
    men = [people.is_man(i) for i in range(6)]
    assert len(set(men)) == 2
    body = load_body("mobl_arms_wrist", appearance=False)
    users = UserBatch(body, 6, effort="neural", people=people)
    bent = [1.2 if name.startswith("elbow") else 0.5 for name in body.independent_joints]
    rngs = [np.random.default_rng(i) for i in range(6)]
    users.reset(np.arange(6), rngs, [np.clip(bent, *body.joint_ranges.T)] * 6, persons=persons)
    recorder = ExertionRecorder()
    recorder.started(SimpleNamespace(users=users), [])
    before = users.qvel
    users.step(np.full((6, body.action_size), 0.1))
    recorder.stepped(np.zeros(6), [])
    dynamics = ArmDynamics(body.physics_model, *arms_of(body))
    for i, (person, man) in enumerate(zip(persons, men, strict=True)):
        load = dynamics.load(users.qpos[i], users.qvel[i], (users.qvel[i] - before[i]) / 0.05)
        relative = person.strength / (median * np.exp(0.249 if man else -0.249))
        maximum = 227.338 + 0.525 * load.elbow_deg - 0.296 * load.shoulder_deg
        maximum *= relative * (0.2845 if man else 0.1495)
        expected = 100.0 * 0.05 / (14.86 * (load.torque / maximum) ** -1.83)
        assert recorder.measured(i, ROUND).values["exertion.nicer_right"] == pytest.approx(expected)
