from contextlib import closing
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from python.users.bodies import OWN_ARM, PENDULUM, PENDULUM_DESCRIPTION, write_body
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import UserBatch, load_body


def test_own_arm_plays_a_round() -> None:
    """A file alone makes a user: 10 s of Whac-A-Mole, random actions, to the end of the round."""
    options = {"condition": "easy", "round_seconds": 10.0}
    app = {"game": "whacamole", "options": options, "renderer": "null"}
    user = {"model": str(OWN_ARM), "effort": {"model": "neural"}}
    config = EnvConfig.model_validate({"app": app, "user": user, "cores": 1})
    with closing(Simulation(config, 1)) as users:
        assert users.action_space.shape == (6,)
        users.reset(seeds=[3])
        rng = np.random.default_rng(0)
        while not users.over.any():
            outcome = users.step(rng.uniform(-1, 1, (1, 6)))
        assert outcome.ends[0]["termination"] == "finished"
        assert users.users.time[0] == pytest.approx(201 * 0.05)
        assert "warnings" not in outcome.ends[0]
        assert outcome.effort_cost[0] > 0


def test_a_configuration_finds_the_body_beside_itself(tmp_path: Path) -> None:
    write_body(tmp_path, PENDULUM, PENDULUM_DESCRIPTION)
    for user in ("body.yaml", {"model": "body.yaml", "skull_rotation_deg": 3.0}):
        file = tmp_path / "training.yaml"
        file.write_text(yaml.safe_dump({"env": {"user": user}}))
        config = load_config(file)
        assert config.env.user.model == str(tmp_path / "body.yaml")
    assert config.env.user.skull_rotation_deg == 3.0
    assert EnvConfig.model_validate({"user": "mobl_arms_wrist"}) == EnvConfig()


def test_devices_are_where_the_description_says(tmp_path: Path) -> None:
    """The headset 10 cm before and 5 cm above the neck, looking 20 degrees down; no weight."""
    headset = {"body": "neck", "pos_m": [0.1, 0.0, 0.05], "weight": False}
    description = PENDULUM_DESCRIPTION | {
        "devices": {"headset": headset, "controller_left": {"body": "tip"}},
        "place": {"pos_m": [1.0, 0.0, -0.5], "yaw_deg": 90.0},
    }
    body = load_body(write_body(tmp_path, PENDULUM, description), skull_rotation_deg=20.0)
    assert body.devices == ("headset", "controller_left")
    data = mujoco.MjData(body.model)
    mujoco.mj_kinematics(body.model, data)
    # Turned to the left, x forward becomes y: (0.1, 0, 1.55) -> (0, 0.1, 1.55) -> + (1, 0, -0.5).
    np.testing.assert_allclose(data.site("headset").xpos, [1.0, 0.1, 1.05], atol=1e-12)
    gaze = data.body("headset").xmat.reshape(3, 3)[:, 0]
    down = np.deg2rad(20.0)
    np.testing.assert_allclose(gaze, [0.0, np.cos(down), -np.sin(down)], atol=1e-12)
    assert body.model.body("headset").mass[0] == 0.0
    assert body.model.body("controller_left").mass[0] == 0.129
    alone = load_body(tmp_path / "body.yaml", devices=("headset",), appearance=False)
    assert alone.devices == ("headset",)


THREE_JOINTS = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="head" pos="0 0 1"><geom size=".1" mass="1"/></body>
    <body name="hand" pos=".3 .1 1" euler=".2 -.3 .4">
      <joint name="a" axis="0 0 1" pos=".05 0 0"/>
      <joint name="b" axis="0 1 .2" pos="0 .1 0" ref=".2"/>
      <joint name="c" type="slide" axis="1 0 0"/>
      <geom size=".03" pos=".1 0 0" mass="1"/>
      <body name="finger" pos=".1 0 0">
        <joint name="d" axis="1 0 0"/><geom size=".01" pos="0 .02 0" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="d" joint2="b" polycoef="0 2 1 0 0"/></equality>
  <actuator>
    <position name="turn" joint="a" ctrlrange="-1 1"/>
    <position name="bend" joint="b" ctrlrange="-1 1"/>
    <position name="push" joint="c" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("locked", [["a"], ["c"], ["a", "b"]])
def test_locked_joints_keep_their_angle(locked: list[str], tmp_path: Path) -> None:
    """What is left moves as the whole does with those joints held; followers are held too."""
    angles = {"a": 0.6, "b": 0.7, "c": 0.05}
    targets = {"a": "turn", "b": "bend", "c": "push"}
    description = {
        "mjcf": "body.xml",
        "devices": {"headset": {"body": "head"}, "controller_right": {"body": "finger"}},
        "locked_joints": {name: angles[name] for name in locked},
        "actuators": [{"names": [targets[name] for name in "abc" if name not in locked]}],
    }
    body = load_body(write_body(tmp_path, THREE_JOINTS, description), appearance=False)
    assert body.independent_joints == tuple(name for name in "abc" if name not in locked)
    whole = mujoco.MjModel.from_xml_string(THREE_JOINTS)
    rng = np.random.default_rng(1)
    for _ in range(5):
        free = {name: rng.uniform(-1, 1) for name in body.independent_joints}
        posture = angles | free
        # d = 2 (b - 0.2) + (b - 0.2)^2.
        posture["d"] = 2 * (posture["b"] - 0.2) + (posture["b"] - 0.2) ** 2
        expected, data = mujoco.MjData(whole), mujoco.MjData(body.physics_model)
        for name, angle in posture.items():
            expected.joint(name).qpos[0] = angle
        data.qpos[:] = body.coupled_qpos(np.array(list(free.values())))
        mujoco.mj_kinematics(whole, expected)
        mujoco.mj_kinematics(body.physics_model, data)
        for part in ("hand", "finger"):
            np.testing.assert_allclose(data.body(part).xpos, expected.body(part).xpos, atol=1e-12)
            np.testing.assert_allclose(data.body(part).xmat, expected.body(part).xmat, atol=1e-12)


TABLE = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  {memory}
  <worldbody>
    <geom name="table" type="box" size=".5 .5 .1" pos="0 0 .4"/>
    <body name="head" pos="0 0 2"/>
    <body name="hand" pos="0 0 .7">
      <joint name="lift" type="slide" axis="0 0 1" damping="1"/>
      <geom name="ball" type="box" size=".05 .05 .05" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="m" joint="lift" ctrlrange="-.1 .1"/></actuator>
</mujoco>
"""
TABLE_DESCRIPTION: dict[str, Any] = {
    "mjcf": "body.xml",
    "devices": {"headset": {"body": "head", "weight": False}},
    "actuators": [{"names": ["m"], "rule": "direct"}],
    "reset": {"position_range": 0.0, "velocity_range": 0.0},
}


@pytest.mark.parametrize(("contacts", "end"), [(True, 0.55), (False, -2.0)])
def test_contacts_are_the_bodys_own(contacts: bool, end: float, tmp_path: Path) -> None:
    """A hand falls on a table of 0.5 m, or through it."""
    description = TABLE_DESCRIPTION | {"contacts": contacts}
    body = load_body(write_body(tmp_path, TABLE.format(memory=""), description), appearance=False)
    batch = UserBatch(body, 1, threads=1, effort="zero")
    for _ in range(30):
        batch.step(np.zeros((1, 1)))
    height = 0.7 + batch.qpos[0, 0]
    assert height == pytest.approx(end, abs=0.01) if contacts else height < end
    assert not batch.diverged[0]
    assert not any(counts.any() for counts in batch.warnings.values())


def test_warnings_are_counted_per_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model without room for its contacts goes on, says so, and forgets it at a reset."""
    monkeypatch.chdir(tmp_path)  # MuJoCo notes the warning in MUJOCO_LOG.TXT
    mjcf = TABLE.format(memory='<size memory="2K"/>')
    body = load_body(write_body(tmp_path, mjcf, TABLE_DESCRIPTION), appearance=False)
    batch = UserBatch(body, 2, threads=1, effort="zero")
    batch._physics.qpos[0] = -0.16  # 1 cm into the table; the other one is still in the air
    batch.step(np.zeros((2, 1)))
    warned = {name: counts.tolist() for name, counts in batch.warnings.items() if counts.any()}
    assert warned
    assert set(warned) <= {"contactfull", "cnstrfull"}
    assert all(counts[0] > 0 == counts[1] for counts in warned.values())
    assert batch.diverged.tolist() == [False, False]
    saved = batch.state_dict(0)
    batch.reset([0], [np.random.default_rng(1)])
    assert not any(counts.any() for counts in batch.warnings.values())
    batch.load_state_dict(1, saved)
    assert {n: c[1] for n, c in batch.warnings.items() if c.any()} == {
        name: counts[0] for name, counts in warned.items()
    }


WRONG = r"""
devices: {headset: {site: eye}} | devices.headset.site: got 'eye', .*eyes.*did you mean 'eyes'
effort: {peak_forces: {turn: -40.0}} | effort.peak_forces.turn: got -40.0, expected greater than 0
devices: {headset: {body: head, site: eyes}} | headset.site: got 'eyes' and a body
devices: {controller_right: {body: hand}} | devices: got .*expected a headset
devices: {headset: {body: head, quat_wxyz: [1, 1, 0, 0]}} | headset.quat_wxyz: got .*of norm 1
device: {} | device: got an unknown key, .*did you mean 'devices'
locked_joints: {shoulder_flexion: 1.0} | got 'shoulder_flexion', which the actuator
effort: {lifting: ["delt*"]} | effort.lifting: got 'delt\*', expected one of
mjcf: arms.xml | mjcf: got '.*arms.xml', which is not there
mjcf: null | mjcf: got both or neither of mjcf and model
package: no_such_package_of_bodies | got 'no_such_package_of_bodies', which is not inst
mjcf: null, package: os, model: arm | model: got 'arm' of 'os', which has no load_spec\(name\)
timestep_s: 1.0 | timestep_s: got 1\.0, expected less than or equal to 0\.02
reset: {posture: {elbow_flexion: 10.0}} | elbow_flexion: got 10, .* limits, 0 to
anatomy: {segments: {arm: {bodies: [head], start: a, end: a}}} | got 'a', as start
place: {pos_m: [1.0e+300, 0, 0]} | place\.pos_m\.0: got 1e\+300, expected less than
"""
"""Changes of the description, and what is said of each."""


@pytest.mark.parametrize("line", WRONG.strip().splitlines())
def test_errors_name_file_key_and_the_nearest(line: str, tmp_path: Path) -> None:
    change, _, message = line.partition(" | ")
    tree = yaml.safe_load(OWN_ARM.read_text()) | yaml.safe_load(change.join("{}"))
    (tmp_path / "arm.xml").write_text((OWN_ARM.parent / "arm.xml").read_text())
    file = tmp_path / "changed.yaml"
    file.write_text(yaml.safe_dump({k: v for k, v in tree.items() if v is not None}))
    with pytest.raises(ValueError, match=message) as error:
        load_body(file)
    assert str(error.value).startswith(f"{file}: ")
