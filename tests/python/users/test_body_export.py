from pathlib import Path

import mujoco
import numpy as np
import pytest

from python.users.bodies import OWN_ARM
from sim2vr_harness.cli.main import main
from sim2vr_harness.users import Physique, load_body
from sim2vr_harness.users.bodies.export import export_body


@pytest.mark.parametrize("name", ["mobl_arms_wrist", OWN_ARM])
def test_the_file_moves_as_the_body_does(name: str | Path, tmp_path: Path) -> None:
    body = load_body(name, person=Physique(stature_m=1.83, handedness="left"))
    assert export_body(body, tmp_path / "body.xml") == [tmp_path / "body.xml"]
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "body.xml"))
    first, second = mujoco.MjData(body.model), mujoco.MjData(again)
    rng = np.random.default_rng(1)
    for _ in range(10):
        first.ctrl[:] = second.ctrl[:] = rng.uniform(0, 1, again.nu)
        mujoco.mj_step(body.model, first, 25)
        mujoco.mj_step(again, second, 25)
        np.testing.assert_allclose(second.qpos, first.qpos, atol=1e-12)
        np.testing.assert_allclose(second.act, first.act, atol=1e-12)
    for device in body.devices:
        np.testing.assert_allclose(second.site(device).xpos, first.site(device).xpos, atol=1e-12)
    assert np.abs(first.qpos).max() > 0.1


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "worn.xml"
    options = ["--hand", "left", "--segment", "upper_arm=0.32", "--strength", "0.8"]
    with pytest.raises(SystemExit) as end:
        main(["users", "export", str(OWN_ARM), str(file), *options])
    assert end.value.code == 0
    assert capsys.readouterr().out.split() == ["Written:", str(file)]
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.body("controller_left").mass[0] == 0.129
    assert model.body("forearm").pos.tolist() == pytest.approx([0, 0, -0.32])
    assert model.actuator("biceps").gainprm[2] == pytest.approx(480.0)


def test_errors_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    for option, value in (("--segment", "hand"), ("--hand", "both"), ("--stature-m", "18")):
        with pytest.raises(SystemExit) as end:
            main(["users", "export", "mobl_arms_wrist", "a.xml", option, value])
        assert end.value.code == 2
        assert f"{option}: got " in capsys.readouterr().err
