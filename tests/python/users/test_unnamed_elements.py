"""Elements of an MJCF need no names."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from python.users.bodies import write_body
from sim2vr_harness.cli.main import main
from sim2vr_harness.users import UserBatch, load_body

MJCF = """
<mujoco>
  <worldbody>
    <body name="trunk" pos="0 0 1.2">
      <geom name="trunk" size=".1"/><site name="eyes" pos=".1 0 .4"/>{in_trunk}
      <body name="upper">
        <joint name="shoulder" axis="0 1 0" damping="1"/>{in_arm}
        <geom name="upper" type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
        <site name="elbow" pos="0 .1 -.3"/><site name="hand" pos="0 0 -.3"/>
      </body>
    </body>{in_world}
  </worldbody>
  <tendon><spatial name="string"><site site="eyes"/><site site="hand"/></spatial>{tendon}</tendon>
  <actuator><motor name="m" joint="shoulder" gear="5" ctrlrange="-1 1"/>{actuator}</actuator>
  <sensor>{sensor}</sensor>
  <equality>{equality}</equality>
  <contact>{contact}</contact>
  <keyframe>{key}</keyframe>
</mujoco>
"""
PARTS = ("in_trunk", "in_arm", "in_world", "tendon", "actuator", "sensor", "equality", "contact",
         "key")  # fmt: skip
DEVICES = {"headset": {"site": "eyes"}, "controller_right": {"site": "hand"}}
FLEX = (
    '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" pos="1 0 1" mass="1" '
    'radius=".01" dim="2"><edge equality="true"/></flexcomp>'
)
ELEMENTS = {
    "joint": {"in_arm": '<joint axis="1 0 0" damping="1"/>'},
    "geom": {"in_arm": '<geom size=".03" pos="0 0 -.2"/>'},
    "site": {"in_arm": '<site pos="0 0 -.1"/>'},
    "body": {
        "in_trunk": '<body pos="0 .3 0"><joint name="left" axis="0 1 0" damping="1"/>'
        '<geom size=".05"/></body>'
    },
    "camera": {"in_arm": '<camera pos="0 0 1"/>'},
    "light": {"in_world": '<light pos="0 0 3"/>'},
    "flex": {"in_world": FLEX},
    "tendon": {"tendon": '<spatial><site site="eyes"/><site site="elbow"/></spatial>'},
    "actuator": {"actuator": '<motor joint="shoulder" gear="2" ctrlrange="-1 1"/>'},
    "sensor": {"sensor": '<jointpos joint="shoulder"/>'},
    "equality": {
        "equality": '<joint joint1="shoulder" polycoef="0.1"/>',
        "in_arm": '<joint name="other" axis="1 0 0" damping="1"/>',
    },
    "pair": {"contact": '<pair geom1="trunk" geom2="upper"/>'},
    "exclude": {"contact": '<exclude body1="trunk" body2="upper"/>'},
    "key": {"key": '<key time="1"/>'},
}


@pytest.fixture(params=ELEMENTS)
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    mjcf = MJCF.format(**(dict.fromkeys(PARTS, "") | ELEMENTS[request.param]))
    return write_body(tmp_path, mjcf, {"mjcf": "body.xml", "devices": DEVICES})


def test_a_body_with_an_unnamed_element_is_exported_and_plays(file: Path, tmp_path: Path) -> None:
    worn = tmp_path / "worn.xml"
    with pytest.raises(SystemExit) as end:
        main(["users", "export", str(file), str(worn)])
    assert end.value.code == 0
    again = mujoco.MjModel.from_xml_path(str(worn))
    names = [again.joint(i).name for i in range(again.njnt)]
    assert all(names)
    assert len(set(names)) == len(names)
    users = UserBatch(load_body(file), 1, threads=1, effort="neural")
    users.step(np.full((1, users.action_size), 0.5))
    assert not users.diverged[0]


def test_names_that_are_given_are_kept_and_not_given_again(tmp_path: Path) -> None:
    in_arm = '<joint axis="1 0 0" damping="1"/><joint name="joint_0" axis="0 0 1" damping="1"/>'
    mjcf = MJCF.format(**(dict.fromkeys(PARTS, "") | {"in_arm": in_arm}))
    description = {
        "mjcf": "body.xml",
        "devices": DEVICES,
        "actuators": [{"names": ["m"], "rule": "direct"}],
    }
    file = write_body(tmp_path, mjcf, description)
    assert load_body(file).independent_joints == ("shoulder", "joint_1", "joint_0")
