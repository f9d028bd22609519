import re
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from python.users.bodies import OWN_ARM
from sim2vr_harness.base import notices
from sim2vr_harness.cli.main import main
from sim2vr_harness.users import Physique, load_body
from sim2vr_harness.users.bodies import registry
from sim2vr_harness.users.bodies.export import export_body


@pytest.mark.parametrize("name", ["mobl_arms_wrist", OWN_ARM])
@pytest.mark.parametrize("person", [{}, {"stature_m": 1.83, "handedness": "left"}])
def test_the_file_moves_as_the_body_does(
    name: str | Path, person: dict[str, Any], tmp_path: Path
) -> None:
    body = load_body(name, person=Physique(**person))
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


def test_the_command_with_a_torso(tmp_path: Path) -> None:
    file = tmp_path / "torso.xml"
    with pytest.raises(SystemExit) as end:
        main(["users", "export", "mobl_arms_bimanual", str(file), "--torso"])
    assert end.value.code == 0
    model = mujoco.MjModel.from_xml_path(str(file))
    assert (model.nu, model.joint("neck_flexion").id >= 0) == (70, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mobl_arms_wrst", "a.xml"], "user model: got 'mobl_arms_wrst'.*did you mean"),
        (["mobl_arms_wrist", "a.xml", "--segment", "hand"], "--segment: got 'hand', expected NAME"),
        (["mobl_arms_wrist", "a.xml", "--hand", "both"], "--hand: got 'both', expected 'right'"),
        (["mobl_arms_wrist", "a.xml", "--stature-m", "18"], "--stature-m: got 18.0, expected "),
        (["mobl_arms_wrist", "none/a.xml"], "file: got 'none/a.xml', expected a file in a folder"),
    ],
)
def test_errors_of_the_command(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["users", "export", *arguments])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert re.search(message, said), said


def test_loading_that_takes_long_is_noticed_once_by_the_command_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*arguments: Any) -> Any:
        time.sleep(0.3)
        return described_body(*arguments)

    described_body = registry.described_body
    monkeypatch.setattr(registry, "described_body", slow)
    monkeypatch.setattr(notices, "SLOW_S", 0.1)
    monkeypatch.setattr(notices, "_notice", None)
    load_body(OWN_ARM)
    assert capsys.readouterr().err == ""
    with pytest.raises(SystemExit):
        main(["users", "export", str(OWN_ARM), str(tmp_path / "body.xml")])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"Loading the body {OWN_ARM}")
    monkeypatch.setattr(notices, "SLOW_S", 5.0)
    with pytest.raises(SystemExit):
        main(["users", "export", str(OWN_ARM), str(tmp_path / "body.xml")])
    assert capsys.readouterr().err == ""
