"""Whole bodies that sit or stand still: locked free joints and balls, and the two postures."""

from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from python.users.bodies import placed, write_body
from sim2vr_harness.users import Body, UserBatch, load_body

LEG = """
<body name="thigh_{side}" pos="0 {y} 0">
  {hip}
  <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".06"/>
  <body name="shank_{side}" pos="0 0 -.4">
    <joint name="knee_{side}" axis="0 {turn} 0" range="{range}"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/>
    <body name="foot_{side}" pos="0 0 -.4">
      <joint name="ankle_{side}" axis="0 1 0"/><geom size=".05"/>
    </body>
  </body>
</body>
"""
HINGES = (
    '<joint name="hip_turn" axis="0 0 1"/><joint name="hip_flexion" axis="0 1 0" range="-2 .5"/>'
)
LEGS = (
    LEG.format(side="r", y=-0.1, hip=HINGES, turn=1, range="0 2.4")
    + LEG.format(side="l", y=0.1, hip='<joint name="hip_l" type="ball"/>', turn=-1, range="-2.4 0")
)  # fmt: skip
WHOLE = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <geom type="plane" size="3 3 .1"/>
    <body name="pelvis" pos="0 0 .9">
      <freejoint name="root"/><geom size=".1"/>
      <body name="trunk" pos="0 0 .2"><geom size=".1"/><site name="eyes" pos=".1 0 .4"/>
        <body name="arm" pos="0 -.2 .2">
          <joint name="shoulder" axis="0 1 0" damping="1"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/><site name="hand" pos="0 0 -.3"/>
        </body>
      </body>
      {legs}
    </body>
  </worldbody>
  <tendon>
    <fixed name="hamstring">
      <joint joint="hip_flexion" coef="1"/><joint joint="knee_r" coef="1"/>
    </fixed>
    <fixed name="gait"><joint joint="knee_r" coef="1"/><joint joint="knee_l" coef="1"/></fixed>
  </tendon>
  <actuator>
    <motor name="shoulder" joint="shoulder" gear="5" ctrlrange="-1 1"/>
    <motor name="knee" joint="knee_r" ctrlrange="-1 1"/>
    <motor name="hamstring" tendon="hamstring" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
""".replace("{legs}", LEGS)
DESCRIPTION: dict[str, Any] = {
    "mjcf": "body.xml",
    "devices": {"headset": {"site": "eyes"}, "controller_right": {"site": "hand"}},
}


def moved(body: Body) -> np.ndarray:
    """How far the headset and the controller go in two seconds of random actions."""
    batch = UserBatch(body, 1, threads=1, effort="zero")
    before = [batch.device_poses(name)[0][0].copy() for name in body.devices]
    rng = np.random.default_rng(1)
    for _ in range(40):
        batch.step(rng.uniform(-1, 1, (1, body.action_size)))
    assert not batch.diverged.any()
    after = [batch.device_poses(name)[0][0] for name in body.devices]
    return np.linalg.norm(np.subtract(after, before), axis=1)


def test_a_seated_body(tmp_path: Path) -> None:
    """Hips and knees at 90 degrees, by hinges or a ball; the feet stay where they stood."""
    body = load_body(write_body(tmp_path, WHOLE, DESCRIPTION | {"posture": "seated"}))
    assert body.independent_joints == ("shoulder",)
    assert body.action_names == ("shoulder",)
    data = placed(body)
    for side, y in (("r", -0.1), ("l", 0.1)):
        np.testing.assert_allclose(data.body(f"shank_{side}").xpos, [0.4, y, 0.5], atol=1e-12)
        np.testing.assert_allclose(data.body(f"foot_{side}").xpos, [0.4, y, 0.1], atol=1e-12)
    head, hand = moved(body)
    assert head == 0.0
    assert hand > 0.01


def test_a_seated_body_that_looks_elsewhere(tmp_path: Path) -> None:
    """The side is that of the body as it is placed; one's own angle of a joint comes first."""
    turned = WHOLE.replace('name="pelvis"', 'name="pelvis" euler="0 0 -1.5707963267948966"')
    changes = {
        "posture": "seated",
        "place": {"yaw_deg": 90.0},
        "locked_joints": {"knee_r": 0.0},
    }
    data = placed(load_body(write_body(tmp_path, turned, DESCRIPTION | changes)))
    np.testing.assert_allclose(data.body("shank_l").xpos, [0.4, 0.1, 0.5], atol=1e-9)
    np.testing.assert_allclose(data.body("foot_l").xpos, [0.4, 0.1, 0.1], atol=1e-9)
    np.testing.assert_allclose(data.body("foot_r").xpos, [0.8, -0.1, 0.5], atol=1e-9)


@pytest.mark.parametrize("posture", ["seated", "standing"])
def test_gymnasiums_humanoid(posture: str, tmp_path: Path) -> None:
    assets = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
    devices = {
        "headset": {"body": "torso", "pos_m": [0.1, 0.0, 0.2]},
        "controller_right": {"body": "right_lower_arm"},
    }
    description = {"mjcf": "body.xml", "devices": devices, "posture": posture}
    mjcf = (assets / "humanoid.xml").read_text()
    body = load_body(write_body(tmp_path, mjcf, description))
    assert all("shoulder" in name or "elbow" in name for name in body.action_names)
    head, hand = moved(body)
    assert head == 0.0
    assert hand > 0.01
    data = placed(body)
    knee = data.body("right_shin").xpos - data.body("right_thigh").xpos
    assert (knee[0] > 0.35) == (posture == "seated")


def test_free_joints_and_balls_are_locked_where_they_are(tmp_path: Path) -> None:
    """The hints of the errors lead there; one's own angle of a joint comes first."""
    locked: dict[str, float] = {"root": 0.5, "knee_l": 0}

    def load() -> Body:
        changes = {"actuators": [{"names": ["shoulder"]}], "locked_joints": locked}
        return load_body(write_body(tmp_path, WHOLE, DESCRIPTION | changes))

    with pytest.raises(ValueError, match=r"locked_joints\.root: got 0\.5, expected 0"):
        load()
    locked["root"] = 0
    with pytest.raises(ValueError, match="'gait' joins to 'knee_r'; expected both locked"):
        load()
    locked |= dict.fromkeys(("knee_r", "hip_flexion", "hip_turn", "hip_l", "ankle_l", "ankle_r"), 0)
    body = load()
    assert (body.independent_joints, body.physics_model.ntendon) == (("shoulder",), 0)
    whole = mujoco.MjModel.from_xml_string(WHOLE)
    expected = mujoco.MjData(whole)
    mujoco.mj_kinematics(whole, expected)
    for part in ("trunk", "foot_l", "arm"):
        found = placed(body).body(part)
        np.testing.assert_allclose(found.xpos, expected.body(part).xpos, atol=1e-12)
        np.testing.assert_allclose(found.xmat, expected.body(part).xmat, atol=1e-12)
