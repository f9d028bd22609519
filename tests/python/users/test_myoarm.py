"""A second source of bodies: MyoSuite's arm, from the package myo-sim."""

from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from sim2vr_harness.base.notices import set_notice
from sim2vr_harness.envs import Sim2VREnv
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.users import Body, Physique, list_efforts, load_body, make_effort
from sim2vr_harness.users.bodies.export import export_body

CONFIG = {"app": {"game": "whacamole", "options": {"condition": "medium"}}, "user": "myoarm_r"}


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
    for name in list_efforts():
        make_effort(name, 2, body)


def test_it_plays_a_round_with_random_muscles() -> None:
    with closing(Simulation(EnvConfig.model_validate({**CONFIG, "cores": 2}), 2)) as users:
        users.reset(seeds=[1, 2])
        rng = np.random.default_rng(0)
        for _ in range(1201):
            outcome = users.step(rng.uniform(-1, 1, (2, 32)))
            if outcome.terminated.any():
                break
        assert [end["termination"] for end in outcome.ends.values()] == ["finished"] * 2
        assert all("warnings" not in end for end in outcome.ends.values())
        assert users.observation()["proprioception"].shape == (2, 56)
        assert np.isfinite(users.observation()["proprioception"]).all()


def test_gymnasium_accepts_it() -> None:
    with closing(Sim2VREnv(config=EnvConfig.model_validate(CONFIG))) as env:
        check_env(env, skip_render_check=True)


def test_left_handed_and_exported(body: Body, tmp_path: Path) -> None:
    left = load_body("myoarm_r", person=Physique(handedness="left"), appearance=False)
    data = [mujoco.MjData(one.physics_model) for one in (body, left)]
    rng = np.random.default_rng(3)
    for _ in range(20):
        data[0].ctrl[:] = data[1].ctrl[:] = rng.uniform(0, 1, 32)
        for one, states in zip((body, left), data, strict=True):
            mujoco.mj_step(one.physics_model, states, 25)
        np.testing.assert_allclose(data[1].qpos, data[0].qpos, atol=1e-9)
    hands = [data[0].site("controller_right").xpos, data[1].site("controller_left").xpos]
    np.testing.assert_allclose(hands[1], hands[0] * [1, -1, 1], atol=1e-9)
    written = export_body(load_body("myoarm_r"), tmp_path / "arm.xml")
    assert len(written) > 10  # meshes too
    again = mujoco.MjModel.from_xml_path(str(written[0]))
    other = mujoco.MjData(again)
    fresh = mujoco.MjData(body.physics_model)
    fresh.ctrl[:] = other.ctrl[:] = 0.4
    mujoco.mj_step(again, other, 250)
    mujoco.mj_step(body.physics_model, fresh, 250)
    np.testing.assert_allclose(other.qpos, fresh.qpos, atol=1e-9)
