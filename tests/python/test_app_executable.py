"""The program sim2vr-app: a scripted round, the same bits as in process, one line per error."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import zmq

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
        (
            ["--width", "0", "--record", "unused"],
            "--width: got '0', expected a whole number from 1",
        ),
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


@contextmanager
def serving(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server with the null renderer, and where it listens."""
    command = [str(app_executable()), "--port", "0", "--renderer", "null", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("sim2vr-app: listening on tcp://127.0.0.1:"), line
            yield process, line.split()[-1]
        finally:
            process.kill()


@contextmanager
def connected(endpoint: str) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(zmq.REQ) as client:
        client.setsockopt(zmq.LINGER, 0)
        client.setsockopt(zmq.RCVTIMEO, 20_000)
        client.connect(endpoint)
        yield client


def start_round(client: zmq.Socket[bytes]) -> None:
    at_rest = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    for message in (
        {"timestep": 0.002, "sampleFrequency": 20, "timeScale": 5},
        {
            "headsetPosition": {"x": 0.0, "y": 1.17, "z": 0.0},
            "headsetRotation": at_rest,
            "rightControllerPosition": {"x": 0.2, "y": 0.9, "z": 0.2},
            "rightControllerRotation": at_rest,
            "nextTimestep": 0.05,
            "reset": True,
        },
    ):
        client.send_string(json.dumps(message))
        assert "error" not in json.loads(client.recv_string())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_the_server_with_its_files_closed(number: int, tmp_path: Path) -> None:
    with serving("--log-dir", str(tmp_path)) as (process, endpoint), connected(endpoint) as client:
        start_round(client)
        process.send_signal(number)
        assert process.wait(20) == 0
        assert process.stderr is not None
        assert "asked to end" in process.stderr.read()
    assert (tmp_path / "0000-medium/states.csv").read_text().endswith("\n")


def test_a_killed_client_ends_the_server(tmp_path: Path) -> None:
    with serving() as (process, endpoint):
        with connected(endpoint) as client:
            start_round(client)
        assert process.wait(20) == 3
        assert process.stderr is not None
        assert "the client's connection went away" in process.stderr.read()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_shared_memory_goes_with_the_server(number: int) -> None:
    def ask(client: zmq.Socket[bytes], kind: int, *frames: bytes) -> list[bytes]:
        header = b"S2VR" + bytes([3, 0, kind, 0]) + bytes(16)
        client.send_multipart([header, *frames])
        return client.recv_multipart()

    with serving() as (process, endpoint), connected(endpoint) as client:
        before = set(Path("/dev/shm").iterdir())
        shared = json.loads(ask(client, 1, b'{"shared_memory": true}')[1])["shared_memory"]
        memory = Path(shared["path"])
        assert memory.stat().st_size == 120 * 80 * 4
        # It has no name in any file system, so that nothing is left whenever the server ends.
        assert set(Path("/dev/shm").iterdir()) <= before
        os.kill(process.pid, number)
        process.wait(20)
        assert not memory.exists()


def test_a_port_in_use_is_one_line_and_exit_code_2() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = run("-simulated", "-port", str(port), "-condition", "medium")
    assert result.returncode == 2
    assert result.stderr.startswith("sim2vr-app: port: got")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
