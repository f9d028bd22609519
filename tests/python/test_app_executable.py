"""The program sim2vr-app: a scripted round, the same bits as in process, one line per error."""

import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq

from python.cli.calls import call
from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import DevicePoses, InProcessApp, frame_time_ns
from sim2vr_harness.client.launch import options_beside, unity_arguments
from sim2vr_harness.evaluation.evaluate import Request, evaluate

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
    ("name", "app_arguments"), [("sim2vr-app", ()), ("whac-a-mole.x86_64", ("-condition", "easy"))]
)
def test_the_program_plays_as_a_unity_build_is_started(
    name: str, app_arguments: tuple[str, ...], tmp_path: Path, capsys: Any
) -> None:
    """By its name or as any other build, with the condition named for it or not."""
    executable = tmp_path / name
    executable.symlink_to(app_executable())
    words = ["evaluate", "--user", "still", "--app", str(executable)]
    for word in app_arguments:
        words += ["--app-arg", word]
    words += ["--condition", "easy", "--episodes", "1", "--out", str(tmp_path / "out")]
    status, _, err = call(capsys, *words)
    assert status == 0, err
    found = json.loads((tmp_path / "out/results.json").read_text())
    assert list(found) == ["easy"]
    # Nobody hits: every target of the condition comes and goes.
    expected = evaluate("still", Request(["easy"], episodes=1)).summaries["easy"]["misses"]
    assert found["easy"]["misses"] == expected


def test_what_is_passed_to_which_app() -> None:
    options = {"condition": "random", "adaptive": True, "life_seconds": 1.0}
    given = ["-condition", "easy"]
    assert unity_arguments(options, given, None) == [*given, "-adaptive"]
    assert options_beside("whacamole", options, given) == {"adaptive": True, "life_seconds": 1.0}
    level = {"level": "first", "end_on_miss": True, "energy": True}
    assert options_beside("beats", level, ["-condition", "full"]) == {"energy": True}


@contextmanager
def serving(
    *arguments: str, limit: int | None = None
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server with the null renderer, and where it listens; ``limit``: of its descriptors."""
    command = [str(app_executable()), "--port", "0", "--renderer", "null", *arguments]
    if limit is not None:
        command = ["sh", "-c", f'ulimit -n {limit}; exec "$@"', "sh", *command]
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


def test_shared_memory_goes_with_the_server() -> None:
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
        process.kill()
        process.wait(20)
        assert not memory.exists()


def test_wrong_arguments_are_named_in_one_sentence(tmp_path: Path) -> None:
    binary = tmp_path / "binary"
    binary.write_bytes(bytes(range(256)))
    wrong = {
        str(tmp_path): "a folder",
        str(binary): r"\u0000\u0001",
        str(tmp_path / "none"): "No such file",
    }
    for path, words in wrong.items():
        for arguments in (["--script", path], ["--replay", "--state-log", path]):
            result = run(*arguments, "--renderer", "null")
            assert (result.returncode, result.stderr.count("\n")) == (2, 1), (arguments, result)
            assert path in result.stderr and words in result.stderr, result.stderr
    for arguments in (["--game", "wackamole"], ["--options", "[1]"], ["--width", "0"]):
        result = run(*arguments, "--renderer", "null", "--record", "unused")
        assert (result.returncode, result.stderr.count("\n")) == (2, 1), (arguments, result)
        assert arguments[-1] in result.stderr, result.stderr
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        for arguments in (
            ["--log-file", str(tmp_path)],
            ["--record", str(binary)],
            ["--port", port],
        ):
            result = run("--port", "0", "--renderer", "null", *arguments)
            assert (result.returncode, result.stderr.count("\n")) == (2, 1), (arguments, result)
            assert arguments[-1] in result.stderr, result.stderr


def test_results_that_nobody_gets_are_an_error() -> None:
    command = [str(app_executable()), "--list-games"]
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert result.returncode == 1
    assert result.stderr.splitlines()[-1] == "sim2vr-app: the standard output cannot be written"


def cpu_s(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rests(pid: int, seconds: int = 20) -> bool:
    """Whether a process spends a second with less than 0.1 s of processor time, sooner or later.

    One that tries to accept again and again never does, on a busy machine either.
    """
    for _ in range(seconds):
        before = cpu_s(pid)
        time.sleep(1.0)
        if cpu_s(pid) - before < 0.1:
            return True
    return False


def test_a_server_without_descriptors_rests_and_goes_on() -> None:
    """Strangers take all of them; the owner plays on, and when they go the next ones get in."""
    limit = 48
    with serving("--keep", limit=limit) as (process, endpoint):
        address = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
        with connected(endpoint) as client:
            start_round(client)
            with ExitStack() as strangers:
                for _ in range(2 * limit):
                    strangers.enter_context(socket.create_connection(address, 20))
                assert process.stderr is not None
                while "no descriptor is left" not in process.stderr.readline():
                    pass
                assert rests(process.pid), "busy for as long as there is no descriptor"
                client.send_string('{"stateHash": true}')
                assert "stateHash" in json.loads(client.recv_string())
            client.send_string('{"quitApplication": true}')
            assert "error" not in json.loads(client.recv_string())
        with connected(endpoint) as client:
            start_round(client)
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
        assert process.stderr.read().count("no descriptor") == 0, "said once"
