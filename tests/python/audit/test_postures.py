"""Postures that are held, against balances worked out by hand."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from sim2vr_harness.audit.postures import hold, posture_of, who_hold
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import app
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.users import load_body

BODY = load_body("mobl_arms_wrist", appearance=False)

_ROD = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="torso" pos="0 0 1.2"><geom size=".01" mass="1"/>
    <body name="head"><geom size=".01" mass="1"/></body>
    <body name="humerus" pos="0 -.2 0">
      <joint name="lift" axis="0 -1 0" range="-2 2" limited="true"/>
      <inertial pos=".15 0 0" mass="2" diaginertia=".01 .01 .01"/>
      <body name="ulna" pos=".3 0 0"><inertial pos=".1 0 0" mass="1" diaginertia=".01 .01 .01"/>
        <body name="radius"><inertial pos=".1 0 0" mass=".5" diaginertia=".01 .01 .01"/>
          <body name="palm" pos=".25 0 0">
            <inertial pos="0 0 0" mass=".5" diaginertia="1e-3 1e-3 1e-3"/>
          </body></body></body>
    </body>
  </body></worldbody>
  <tendon><fixed name="up"><joint joint="lift" coef="-.03"/></fixed></tendon>
  <actuator><muscle name="deltoid" tendon="up" force="1000" lengthrange="-.1 .1"
    ctrllimited="true" ctrlrange="0 1" range=".75 1.05"/></actuator>
</mujoco>"""
"""An outstretched arm on a hinge: 2 kg at .15 m, 1 and .5 kg at .4 m, .5 kg at .55 m, and one
muscle with a moment arm of 3 cm."""


@pytest.fixture
def rod(tmp_path: Path) -> str:
    (tmp_path / "rod.xml").write_text(_ROD)
    file = tmp_path / "rod.yaml"
    file.write_text(
        "name: rod\nmjcf: rod.xml\ndevices:\n  headset: {body: head, weight: false}\n"
        "  controller_right: {body: palm, pos_m: [0, 0, 0], weight: false}\n"
        "actuators: [{names: [deltoid], rule: muscle}]\n"
    )
    return str(file)


def test_a_hinge_with_one_muscle_by_hand(rod: str) -> None:
    # 9.81 (2*.15 + 1.5*.4 + .5*.55) = 9.81 * 1.175 = 11.52675 Nm; 2 kg more hang from the
    # controller's tracked point, .053 m beyond the palm (users/data/hardware.json).
    # The muscle's length at 0 is the middle of its range: fibres at .9 of the optimum. Its force
    # at full activation is MuJoCo's; the activation is the torque over force times moment arm.
    (bare,), (heavy,) = hold(UserConfig(model=rod), "lift=0"), hold(UserConfig(model=rod), "", 2.0)
    assert bare.torque_nm == pytest.approx(11.52675, rel=1e-6)
    assert heavy.torque_nm == pytest.approx(11.52675 + 2.0 * 9.81 * 0.603, rel=1e-6)
    assert (bare.shoulder_deg, bare.elbow_deg) == pytest.approx((90.0, 180.0))
    muscle = [0.75, 1.05, 1000, 200, 0.5, 1.6, 1.5, 1.3, 1.2]
    gain = mujoco.mju_muscleGain(0.0, 0.0, [-0.1, 0.1], 1.0, muscle)
    passive = mujoco.mju_muscleBias(0.0, [-0.1, 0.1], 1.0, muscle)
    for held in (bare, heavy):
        activation = (held.torque_nm / 0.03 + passive) / -gain
        assert held.activations == {"deltoid": pytest.approx(activation, rel=1e-6)}
        assert held.share == pytest.approx(activation, rel=1e-6)
    # Chaffin's strength at 90 and 180 degrees: 83.98383 Nm; men's maximum of CE: 22.59087 Nm.
    assert bare.strength_share == pytest.approx(11.52675 / 83.98383, rel=1e-5)
    consumed = 1236.5 / (100 * 11.52675 / 22.59087 - 15) ** 0.618 - 72.5
    assert bare.endurance_s["Consumed Endurance"] == pytest.approx(consumed, rel=1e-5)


def test_a_muscle_that_is_too_weak(rod: str) -> None:
    (held,) = hold(UserConfig(model=rod), "lift=0", 20.0)
    assert held.share is not None
    assert held.share > 1.0
    assert held.endurance_s["3CC-r, shoulder"] == 0.0


def test_activations_balance_the_simulated_arm() -> None:
    """Applied to the model itself, they leave no acceleration of the free joints."""
    (held,) = hold(UserConfig(), "elv_angle=45,shoulder_elv=60,elbow_flexion=30")
    assert held.share is not None
    assert 0.1 < held.share < 1.0
    model = BODY.physics_model
    data = mujoco.MjData(model)
    data.qpos[:] = BODY.coupled_qpos(
        posture_of(BODY, "elv_angle=45,shoulder_elv=60,elbow_flexion=30")
    )
    for name, value in held.activations.items():
        data.act[int(model.actuator(name).actadr[0])] = value
    mujoco.mj_forward(model, data)
    fallen = data.qacc[BODY.qvel_independent].copy()
    data.act[:] = 0.0
    mujoco.mj_forward(model, data)
    loose = data.qacc[BODY.qvel_independent]
    assert np.abs(fallen).max() < 0.02 * np.abs(loose).max()


def test_load_shortens_endurance_and_strength_lengthens_it() -> None:
    pose = "elv_angle=45,shoulder_elv=60"
    strong = UserConfig.model_validate({"person": {"strength": 2.0}})
    (usual,), (loaded,), (better,) = (
        *(hold(UserConfig(), pose), hold(UserConfig(), pose, 1.0)),
        hold(strong, pose),
    )
    for name, time in usual.endurance_s.items():
        assert loaded.endurance_s[name] < time < better.endurance_s[name]


def test_people_differ() -> None:
    persons = who_hold(UserConfig(), 3)
    assert len({person.person.strength for person, _ in persons}) == 3
    assert who_hold(UserConfig(), None) == [(UserConfig(), None)]


def test_people_s_published_strength_is_not_that_of_the_body_s_model() -> None:
    """Populations of weak and strong models hold as long, by NICER: only 3CC-r differs."""
    times = []
    for strength in (0.78, 1.28):
        user = UserConfig.model_validate({"people": {"strength": strength}})
        held = [
            hold(one, "elv_angle=45,shoulder_elv=60", strength=own)[0]
            for one, own in who_hold(user, 3)
        ]
        times.append([[each.endurance_s[name] for each in held] for name in held[0].endurance_s])
    np.testing.assert_allclose(times[0][-2:], times[1][-2:])
    assert (np.array(times[0][:2]) < np.array(times[1][:2])).all()


def test_two_arms_without_muscles_use_published_strength() -> None:
    right, left = hold(UserConfig.model_validate(MOTORS), "shoulder_elv=90,elv_angle=90")
    assert (right.side, left.side) == ("right", "left")
    assert right.torque_nm == pytest.approx(left.torque_nm, rel=1e-3)
    assert right.share == right.strength_share
    assert right.activations == {}


MOTORS = {"model": "mobl_arms_bimanual_motor", "effort": {"model": "neural"}}


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ("shoulder_elv", "--pose: got 'shoulder_elv', expected JOINT=DEGREES"),
        ("shoulder_elv=nan", "--pose: got 'shoulder_elv=nan'"),
        ("shoulder=90", "--pose: got 'shoulder'"),
        ("shoulder_elv=200", "--pose shoulder_elv: got 200, expected 0 to 180 degrees"),
    ],
)
def test_wrong_postures(pose: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        posture_of(BODY, pose)


def test_wrong_numbers() -> None:
    with pytest.raises(InputError, match="--load: got -1, expected 0 to 100 kg"):
        hold(UserConfig(), "", -1.0)
    with pytest.raises(InputError, match="--people: got 0, expected 1 to 200"):
        who_hold(UserConfig(), 0)


def test_command(tmp_path: Path) -> None:
    words = ["audit", "--user", "mobl_arms_wrist", "--pose", "elv_angle=45,shoulder_elv=60"]
    said = CliRunner().invoke(app, [*words, "--out", str(tmp_path)])
    assert said.exit_code == 0, said.output
    for text in ("share of maximum at the shoulder", "NICER", "Consumed Endurance", "3CC-r"):
        assert text in said.output
    ((arm,),) = json.loads((tmp_path / "postures.json").read_text())["persons"]
    (held,) = hold(UserConfig(), "elv_angle=45,shoulder_elv=60")
    assert arm["endurance_s"] == pytest.approx(dict(held.endurance_s))
