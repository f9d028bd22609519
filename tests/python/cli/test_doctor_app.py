"""``doctor --app``: an app's trial, with the app at its best and at its worst."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.cli.main import main

FAKE_APP = Path(__file__).parents[1] / "client" / "fake_app.py"


@pytest.fixture
def fake_app(tmp_path: Path) -> Path:
    """Stand-in for a Unity build."""
    file = tmp_path / "build.x86_64"
    file.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{FAKE_APP}" -round 60 "$@"\n')
    file.chmod(0o755)
    return file


def doctor(app: Path, *arguments: str, options: tuple[str, ...] = ()) -> int:
    """Exit status of the command."""
    given = [word for argument in arguments for word in ("--app-arg", argument)]
    out = str(app.parent / "picture.png") if app.name == "build.x86_64" else "picture.png"
    with pytest.raises(SystemExit) as ended:
        main(["doctor", "--app", str(app), "--out", out, *given, *options])
    return int(ended.value.code or 0)


def test_a_unity_build_is_tried(fake_app: Path, capsys: pytest.CaptureFixture[str]) -> None:
    messages = fake_app.parent / "messages"
    assert doctor(fake_app, "-record", str(messages), options=("--json",)) == 0
    report = json.loads(capsys.readouterr().out)
    (trial,) = report["trials"]
    assert (trial["protocol"], trial["steps"], trial["picture_changes"]) == (1, 10, True)
    assert [warning.split()[0] for warning in trial["warnings"]] == ["depth"]  # it draws none
    assert trial["steps_per_s"] > 1.0
    # The stand-in pays the x of the hand: 0.25 m less 0.03 m a step.
    assert trial["reward"] == pytest.approx(2.5 - 0.03 * 55)
    assert len(messages.read_text().splitlines()) == 1 + 1 + 10 + 1  # handshake, reset, steps, quit
    picture = np.asarray(Image.open(report["picture"]))
    assert picture.shape == (80, 240, 3)
    np.testing.assert_array_equal(picture[0, :120, 0], np.arange(120))
    assert (picture[:, 120:] == 40).all()  # depth of a hand 0.4 m away, by the stand-in's rule


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("-fault", "hang@0"), 1, "gave no answer to the handshake within 3 s"),
        (("-fault", "size@1"), 2, "sends images of 90 x 60, expected the app's size"),
        (("-refuse",), 2, "refused its arguments"),
    ],
)
def test_a_failure_is_one_sentence(
    fake_app: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    status: int,
    words: str,
) -> None:
    assert doctor(fake_app, *arguments, options=("--timeout", "3")) == status
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert words in printed.err
    assert not (fake_app.parent / "picture.png").exists()


def test_our_server_is_tried_over_both_protocols(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert doctor(app_executable(), options=("--json",)) == 0
    report = json.loads(capsys.readouterr().out)
    assert [trial["protocol"] for trial in report["trials"]] == [1, 2]
    assert [trial["steps"] for trial in report["trials"]] == [10, 10]
    assert [trial["warnings"] for trial in report["trials"]] == [[], []]
    assert (tmp_path / "picture.png").exists()
