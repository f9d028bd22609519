"""The program sim2vr-app: a scripted round, the same bits as in process, one line per error."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.client import DevicePoses, InProcessApp, frame_time_ns
from sim2vr_harness.paths import app_executable

SCRIPT = Path(__file__).resolve().parents[2] / "docs/examples/strikes.json"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(app_executable()), *arguments], capture_output=True, text=True, check=False
    )


def test_scripted_player_scores_and_leaves_pictures_and_logs(tmp_path: Path) -> None:
    result = run(
        *("--condition", "medium", "--seconds", "8", "--script", str(SCRIPT)),
        *("--record", str(tmp_path / "frames"), "--width", "60", "--height", "40"),
        *("--log-dir", str(tmp_path / "logs")),
    )
    assert result.returncode == 0, result.stderr
    assert "frames 160" in result.stdout
    assert "renderer: " in result.stderr
    log = dict(line.split() for line in result.stdout.splitlines()[1:])
    # 53 strikes, one cell after the other, against some 20 targets of 1.1 s in 9 cells.
    assert float(log["Points"]) >= 5
    assert len(list((tmp_path / "frames").glob("*.png"))) == 161
    events = next((tmp_path / "logs").rglob("events.csv")).read_text()
    assert events.count("target_hit") == float(log["Points"])


def test_the_program_and_the_module_play_the_same_bits() -> None:
    result = run("--condition", "hard", "--seed", "5", "--seconds", "10", "--renderer", "null")
    assert result.returncode == 0, result.stderr
    # The program's resting player.
    poses = DevicePoses(
        np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0]),
        np.array([0.18, 0.9, 0.25, 0.0, 0.0, 0.0, 1.0]),
    )
    with InProcessApp("whacamole", {"condition": "hard"}, renderer="null") as app:
        app.reset(5, poses)
        for frame in range(1, 201):
            app.step(frame_time_ns(frame, 20), poses)
        assert f"state hash {app.state_hash():x}" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--condition", "meduim"], "did you mean 'medium'"),
        (["--game", "wackamole"], "did you mean 'whacamole'"),
        (["--script", "nosuch.json"], "--script: got 'nosuch.json', expected a readable JSON"),
        (["--options", "[1]"], "options: got '[1]', expected a JSON object"),
        (["--view", "spektator"], "did you mean 'spectator'"),
        (["--renderer", "vulkan"], "renderer"),
        (["--width", "0", "--record", "unused"], "image size: got 0 x 80"),
        (["--nosuch"], "--nosuch"),
    ],
)
def test_wrong_arguments_are_one_line_and_exit_code_2(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*arguments, "--log-level", "off", "--seconds", "0.1")
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stdout == ""


def test_version_and_games() -> None:
    assert run("--version").stdout.startswith("sim2vr-app ")
    assert "whacamole\t" in run("--list-games").stdout
