"""A second source of bodies: MyoSuite's arm, from the package myo-sim."""

from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim2vr_harness.base.notices import set_notice
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.users import Body, load_body


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body("myoarm_r", appearance=False)


def test_loading_it_is_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """MuJoCo's warnings of how the package builds it go to the terminal and into a file."""
    monkeypatch.chdir(tmp_path)
    set_notice(None)  # commands that other tests run in this process set one
    load_body("myoarm_r", appearance=False)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_it_is_an_arm_with_32_muscles(body: Body) -> None:
    wrist = load_body("mobl_arms_wrist", appearance=False)
    assert body.muscles == wrist.muscles
    assert [name.removesuffix("_r") for name in body.independent_joints] == list(
        wrist.independent_joints
    )
    # Hand-derived: MyoSuite's DELT1 and INFSP (twice the wrist model's).
    assert body.peak_forces[0] == pytest.approx(1051.85)
    assert body.peak_forces[4] == pytest.approx(2150.71)
    data = mujoco.MjData(body.physics_model)
    mujoco.mj_kinematics(body.physics_model, data)
    # Turned to look along x: the right shoulder is to the right of the head, which looks ahead.
    head, hand = data.site("headset"), data.site("controller_right")
    np.testing.assert_allclose(head.xmat.reshape(3, 3)[:, 0], [0.985, 0, -0.174], atol=1e-3)
    assert hand.xpos[1] < -0.1 < head.xpos[1] < 0.1
    assert 0.6 < head.xpos[2] - hand.xpos[2] < 1.0


def test_it_plays_a_round_with_random_muscles() -> None:
    app = {"game": "whacamole", "options": {"condition": "medium", "round_seconds": 5.0}}
    config = EnvConfig.model_validate({"app": app, "user": "myoarm_r", "cores": 1})
    with closing(Simulation(config, 1)) as users:
        users.reset(seeds=[1])
        rng = np.random.default_rng(0)
        while not users.over.any():
            outcome = users.step(rng.uniform(-1, 1, (1, 32)))
        assert outcome.ends[0]["termination"] == "finished"
        assert "warnings" not in outcome.ends[0]
        assert users.observation()["proprioception"].shape == (1, 56)
        assert np.isfinite(users.observation()["proprioception"]).all()
