"""How episodes begin where that is asked for."""

from contextlib import closing
from typing import Any

import numpy as np
import pydantic
import pytest

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.users import Body, ResetOptions, UserBatch, load_body

MOTORS = "mobl_arms_bimanual_motor"


def _body(name: Any = MOTORS, torso: bool = False, **reset: Any) -> Body:
    options = ResetOptions.model_validate(reset)
    return load_body(name, appearance=False, torso=torso, reset=options, skull_rotation_deg=0.0)


def _batch(body: Body, n: int = 3) -> UserBatch:
    return UserBatch(body, n, threads=1, effort="zero")


@pytest.mark.parametrize(("name", "torso"), [(MOTORS, False), ("mobl_arms_bimanual", True)])
def test_ready_points_both_sabers_ahead(name: str, torso: bool) -> None:
    """Within 30 degrees of straight ahead, hands shoulder-wide in front of the chest."""
    batch = _batch(_body(name, torso, posture="ready"))
    for hand, side in (("controller_right", -1.0), ("controller_left", 1.0)):
        at, (w, x, y, z) = batch.device_poses(hand)[0], batch.device_poses(hand)[1].T
        assert (1 - 2 * (y * y + z * z) > 0.85).all()  # the device's x axis, along the world's
        assert (2 * (x * z - w * y) > 0.2).all()  # a little up
        np.testing.assert_allclose(at, np.tile([0.40, 0.22 * side, 0.91], (3, 1)), atol=0.12)


def test_motors_that_hold_aim_at_their_joints() -> None:
    body = _body(posture="ready", hold=True)
    batch = _batch(body)
    low, high = body.physics_model.actuator_ctrlrange.T
    angles = batch.qpos[:, body.qpos_independent]
    inside = np.clip(angles, low, high)
    np.testing.assert_allclose(low + batch.motor * (high - low), inside, atol=1e-12)
    before = batch.device_poses("controller_right")[0]
    for _ in range(20):
        batch.step(np.zeros((3, 14)))
    sunk = batch.device_poses("controller_right")[0] - before
    assert np.abs(sunk[:, :2]).max() < 0.1
    assert ((sunk[:, 2] < 0.0) & (sunk[:, 2] > -0.15)).all()  # the reference's servos are soft
    # The others' targets, drawn alike, are anywhere.
    free = _batch(_body(posture="ready"))
    np.testing.assert_array_equal(free.qpos, _batch(_body(posture="ready", hold=True)).qpos)
    assert free.motor.std() > 0.2


def test_ranges() -> None:
    names = ("elbow_flexion_r", "shoulder_elv_l")
    body = _body(angles={names[0]: 1.2}, position_range=0.0, velocity_range=0.0)
    batch = _batch(body)
    q = dict(zip(body.independent_joints, batch.qpos[1, body.qpos_independent], strict=True))
    assert (q[names[0]], q[names[1]]) == (1.2, 0.0)
    assert not batch.qvel.any()
    muscles = _batch(_body("mobl_arms_wrist", activation_range=(0.1, 0.2)))
    assert muscles.act.min() >= 0.1
    assert 0.18 < muscles.act.max() <= 0.2
    raised = _body(angles={"shoulder_elv_r": 1.5}, position_range=0.0)
    follower = raised.physics_model.joint("acromioclavicular_r3_r").qposadr[0]
    assert _batch(raised).qpos[0, follower] == pytest.approx(1.5 * 0.396, abs=1e-3)


def test_the_configuration_says_it() -> None:
    user = {"model": MOTORS, "effort": {"model": "neural"}, "skull_rotation_deg": 0.0}
    user["reset"] = {"posture": "ready", "hold": True, "position_range": 0.0}
    config = EnvConfig.model_validate({"app": {"renderer": "null"}, "user": user, "cores": 1})
    with closing(Simulation(config, 1)) as users:
        users.reset(seeds=[1])
        elbow = users.body.independent_joints.index("elbow_flexion_r")
        assert users.users.qpos[0, users.body.qpos_independent[elbow]] == 1.76


@pytest.mark.parametrize(
    ("reset", "message"),
    [
        ({"posture": "redy"}, r"reset.posture: got 'redy', .*did you mean 'ready'"),
        ({"angles": {"elbow_flexion_r": 3.0}}, r"elbow_flexion_r: got 3, .* limits, 0 to 2.269"),
        ({"activation_range": [0.6, 0.2]}, r"got \[0.6, 0.2\], expected the lower one first"),
    ],
)
def test_errors(reset: dict[str, Any], message: str) -> None:
    with pytest.raises((ValueError, pydantic.ValidationError), match=message):
        _body(**reset)
