"""``--openxr`` and what belongs to it, with a stand-in for a program."""

import json
from pathlib import Path
from typing import Any

import pytest

from openxr_programs import manifest, program
from python.cli.calls import call
from sim2vr_harness.cli.app_options import AppOptions


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIM2VR_OPENXR_RUNTIME", str(manifest(tmp_path)))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_a_program_with_its_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    program(tmp_path, name="my game.py")
    script = program(tmp_path, name="play.py")
    found = AppOptions(openxr="my game.py").remote()
    assert (found["executable"], found["arguments"]) == (str(tmp_path / "my game.py"), [])
    found = AppOptions(
        openxr="sh play.py --level '1 2' {seed}", xvfb=True, virtual_clock=True
    ).remote()
    assert found["executable"].endswith("/sh")
    assert found["arguments"] == [str(script), "--level", "1 2", "{seed}"]
    assert found["transport_options"] == {"virtual_clock": True, "xvfb": True}
    assert (found["transport"], found["game"]) == ("openxr", "play")


def test_a_user_without_training_plays(tmp_path: Path, capsys: Any) -> None:
    """The scripted hand pulls the trigger, which the stand-in answers by a vibration and lines."""
    task = tmp_path / "task.yaml"
    task.write_text(
        "seconds: 3\n"
        "devices: [controller_right]\n"
        "inputs: [right.trigger]\n"
        "reward: {name: score, expression: 'printed(\"score: (\\d+)\")'}\n"
        "values: {buzzes: 'haptics(\"right\")'}\n"
    )
    words = ("evaluate", "--openxr", str(program(tmp_path)), "--task", str(task), "--episodes", "1")
    status, out, err = call(capsys, *words, "--user", "press 0.2 1.0 0.4", "--json")
    assert status == 0, err
    found = json.loads(out)["standard"]
    # The trigger is pulled for 0.2 s, four steps, each of which counts 10.
    assert (found["score"], found["buzzes"], found["steps_failed"]) == (40.0, 4.0, 0)
