import mujoco
import numpy as np
import pytest

from sim2vr_harness.perception import Proprioception
from sim2vr_harness.users import UserBatch, load_body

BODY = load_body("mobl_arms_wrist", appearance=False)


@pytest.fixture(scope="module")
def batch() -> UserBatch:
    made = UserBatch(BODY, 2, threads=1)
    for _ in range(3):
        made.step(np.full((2, 32), 0.2))
    return made


def test_order_and_scaling(batch: UserBatch) -> None:
    sense = Proprioception(BODY)
    seen = sense.observe(batch)
    assert sense.size == len(sense.names) == 56
    assert seen.shape == (2, 56)
    assert seen.dtype == np.float32
    assert all(sense.observation_space.contains(row) for row in seen)
    at = {name: seen[1, k] for k, name in enumerate(sense.names)}
    data = mujoco.MjData(BODY.model)
    data.qpos[:], data.qvel[:] = batch.qpos[1], batch.qvel[1]
    mujoco.mj_kinematics(BODY.model, data)
    # The elbow bends from 0 to 2.26893 rad.
    elbow = data.joint("elbow_flexion")
    assert at["elbow_flexion qpos"] == pytest.approx(elbow.qpos[0] / 2.26893 * 2 - 1, abs=1e-6)
    assert at["elbow_flexion qvel"] == pytest.approx(elbow.qvel[0], rel=1e-6)
    assert at["flexion qacc"] == pytest.approx(batch.qacc[1, BODY.qvel_independent[-1]], rel=1e-6)
    np.testing.assert_allclose(seen[1, 21:24], data.site("fingertip").xpos, atol=1e-6)
    np.testing.assert_allclose(seen[:, 24:], 2 * batch.act - 1, atol=1e-6)
    assert sense.names[:2] == ("elv_angle qpos", "shoulder_elv qpos")
    assert sense.names[24] == "DELT1 act"


def test_limits_map_to_minus_one_and_one() -> None:
    sense, batch = Proprioception(BODY), UserBatch(BODY, 2, threads=1)
    for row, bound in ((0, 0), (1, 1)):
        batch._physics.qpos[row, BODY.qpos_independent] = BODY.joint_ranges[:, bound]
    seen = sense.observe(batch)
    np.testing.assert_allclose(seen[0, :7], -1, atol=1e-6)
    np.testing.assert_allclose(seen[1, :7], 1, atol=1e-6)
