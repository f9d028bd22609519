"""Whether everybody can hold up an arm: what the strength of people is judged by."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from python.users.references import coupling_jacobian, moment_arms
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import Body, load_body
from sim2vr_harness.users.people import PeopleSettings, Population

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
FORWARDS = {"elv_angle": 90.0, "shoulder_elv": 90.0}
"""The arm straight ahead at the height of the shoulder, degrees."""
PERSONS = 12


def lift_and_weight(body: Body) -> tuple[float, float]:
    """The most that all muscles together lift the arm with there, and what it weighs, Nm."""
    model = body.physics_model
    data = mujoco.MjData(model)
    angles = np.array([np.radians(FORWARDS.get(name, 0.0)) for name in body.independent_joints])
    data.qpos[:] = body.coupled_qpos(angles)
    data.act[:] = 1.0
    mujoco.mj_forward(model, data)
    follow = coupling_jacobian(body, angles)
    lifted = body.independent_joints.index("shoulder_elv")
    torques = (moment_arms(model, data) @ follow)[:, lifted] * data.actuator_force
    return float(torques.clip(0.0).sum()), float((follow.T @ data.qfrc_bias)[lifted])


def margins(settings: PeopleSettings) -> list[float]:
    people = Population(settings)
    found = []
    for number in range(PERSONS):
        physique = people.physique(people.sample(7, number))
        lift, weight = lift_and_weight(load_body("mobl_arms_wrist", person=physique))
        found.append(lift / weight)
    return found


@pytest.mark.parametrize("name", ["whacamole_people", "pointing_people"])
def test_everybody_can_hold_a_straight_arm_ahead(name: str) -> None:
    """With something to spare; of people for whom its muscles are a man's a quarter could not."""
    settings = load_config(CONFIGS / f"{name}.yaml").env.user.people
    assert settings is not None
    assert min(margins(settings)) > 1.15
    assert sum(margin < 1.0 for margin in margins(PeopleSettings())) >= PERSONS / 4


def test_the_body_s_raised_arm_is_weak() -> None:
    """At 90 degrees the muscles of the model hardly lift more than the arm weighs."""
    lift, weight = lift_and_weight(load_body("mobl_arms_wrist"))
    assert (lift, weight) == (pytest.approx(20.1, abs=0.3), pytest.approx(13.0, abs=0.2))
