"""Moments about joints against those that MuJoCo works out itself."""

import mujoco
import numpy as np

from sim2vr_harness.tools.track.files import joint_moments, named_joints

PENDULUM = """
<mujoco>
  <worldbody>
    <site name="fixed" pos="0.3 0 0"/>
    <body name="arm">
      <joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.4"/>
      <site name="moving" pos="0 0 -0.4"/>
    </body>
  </worldbody>
  <tendon><spatial name="cord"><site site="fixed"/><site site="moving"/></spatial></tendon>
  <actuator><general name="pull" tendon="cord" gainprm="1"/></actuator>
</mujoco>
"""


def test_a_cord_has_the_moment_of_its_lever() -> None:
    """A cord from (.3, 0, 0) to (0, 0, -.4) lies .3 x .4 / .5 = .24 m from the hinge."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    found = joint_moments(model, np.zeros((2, 1)), np.array([[-10.0], [0.0]]))
    assert named_joints(model) == [("hinge", 0)]
    np.testing.assert_allclose(np.abs(found), [[2.4], [0.0]], atol=1e-9)
