"""Shell completion, and the nearest name of a mistyped one."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from python.cli.calls import call

PROGRAM = "import sys; from sim2vr_harness.cli.main import main; main(sys.argv[1:])"


def run(*arguments: str, **environment: str) -> str:
    command = [sys.executable, "-c", PROGRAM, *arguments]
    done = subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, text=True, check=True
    )
    return done.stdout


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("sim2vr-harness tr", ["train", "track"]),
        ("sim2vr-harness train --re", ["--resume"]),
        ("sim2vr-harness render snapshot --game s", ["sample"]),
        ("sim2vr-harness train po", ["pointing", "pointing_people"]),
    ],
)
def test_words_are_completed(line: str, expected: list[str]) -> None:
    out = run(
        COMP_WORDS=line,
        COMP_CWORD=str(len(line.split(" ")) - 1),
        _SIM2VR_HARNESS_COMPLETE="complete_bash",
    )
    assert out.split() == expected


@pytest.mark.parametrize(
    ("arguments", "nearest"),
    [
        ("evaluat", "evaluate"),
        ("games beat", "beats"),
        ("evaluate pointing_peple", "pointing_people"),
        ("plot curves runs/sampel", "runs/sample"),
    ],
)
def test_the_nearest_name_is_pointed_out(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, nearest: str
) -> None:
    for name in ("sample", "other"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "config.yaml").touch()
    monkeypatch.chdir(tmp_path)
    status, _, err = call(capsys, *arguments.split())
    assert status == 2
    assert f"did you mean {nearest!r}?" in err
    assert err.count("\n") == 1
