"""Small bodies for tests: an MJCF and its description, written to a folder."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from sim2vr_harness.users import Body, load_body

ROOT = Path(__file__).resolve().parents[3]
OWN_ARM = ROOT / "docs" / "examples" / "own_body" / "body.yaml"

PENDULUM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.0005"/>
  <worldbody>
    <body name="neck" pos="0 0 1.5"><geom size=".05" mass="1"/></body>
    <body name="rod" pos="0 0 1">
      <joint name="swing" axis="0 1 0" range="-3 3" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass="2"/>
      <body name="tip" pos="0 0 -.4"><geom size=".03" mass=".5"/></body>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="swing" ctrlrange="-1 1"/></actuator>
</mujoco>
"""

PENDULUM_DESCRIPTION: dict[str, Any] = {
    "mjcf": "body.xml",
    "devices": {
        "headset": {"body": "neck", "weight": False},
        "controller_right": {"body": "tip", "weight": False},
    },
    "anatomy": {
        "stature_m": 2.0,
        "mass_kg": 80.0,
        "segments": {"rod": {"bodies": ["rod"], "start": "rod", "end": "tip"}},
    },
}


def write_body(folder: Path, mjcf: str, description: dict[str, Any]) -> Path:
    """Writes an MJCF and its description; returns the description's file."""
    (folder / "body.xml").write_text(mjcf)
    file = folder / "body.yaml"
    file.write_text(yaml.safe_dump(description))
    return file


_MADE: dict[str, Body] = {}


def body(name: str | Path = "mobl_arms_wrist", **options: Any) -> Body:
    """A body without drawn shapes; the same one for the same options, as bodies are immutable."""
    key = repr((str(name), sorted(options.items())))
    if key not in _MADE:
        _MADE[key] = load_body(name, **{"appearance": False} | options)
    return _MADE[key]


def placed(body: Body, angles: Any = None) -> mujoco.MjData:
    """A body in a posture of its independent joints; None: where the model has it."""
    data = mujoco.MjData(body.physics_model)
    if angles is not None:
        data.qpos[:] = body.coupled_qpos(np.asarray(angles))
    mujoco.mj_kinematics(body.physics_model, data)
    return data


def rngs(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in seeds]
