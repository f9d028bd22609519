"""Protocol 2 beyond what the contract suite covers: faults on both sides, images, the example."""

from __future__ import annotations

import ast
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq

from sim2vr_harness.client import (
    AppDied,
    AppError,
    AppRefused,
    AppTimeout,
    DevicePoses,
    InProcessApp,
    Protocol1App,
    Protocol2Connection,
    ProtocolError,
    StartingApp,
    connect,
    start_sim2vr_app,
)
from sim2vr_harness.client.protocol2 import HEADER, MAGIC, REPLY, VERSION
from sim2vr_harness.paths import app_executable

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = ROOT / "docs/examples/protocol2_client.py"
POSES = DevicePoses(
    head=np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0]),
    right_controller=np.array([0.2, 0.9, 0.3, 0.0, 0.0, 0.0, 1.0]),
)
ONE = DevicePoses(POSES.head[None], POSES.right_controller[None])  # type: ignore[index]
STEP = 50_000_000


@pytest.fixture
def server() -> Iterator[StartingApp]:
    starting = start_sim2vr_app(app_executable(), ["--renderer", "null"])
    yield starting
    starting.process.kill()
    starting.process.log_file.unlink(missing_ok=True)


@pytest.fixture(params=["local socket", "ZeroMQ"])
def carrier(request: pytest.FixtureRequest) -> str:
    return request.param


def session(
    server: StartingApp, carrier: str = "local socket", **settings: object
) -> Protocol2Connection:
    channel = server.channel(20.0, 20.0, local=carrier == "local socket")
    return Protocol2Connection(channel, **settings)  # type: ignore[arg-type]


def test_the_example_client_is_short_and_plays(server: StartingApp) -> None:
    source = EXAMPLE.read_text()
    assert len(source.splitlines()) <= 60
    imports = {
        name.name
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in node.names
    }
    assert imports == {"json", "struct", "sys", "numpy", "zmq"}
    channel = server.channel(5.0, 20.0)
    channel.close()
    done = subprocess.run(
        [sys.executable, EXAMPLE, channel.endpoint],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    with InProcessApp("whacamole", {"condition": "medium"}, renderer="null") as app:
        app.reset(7, POSES)
        for step in range(1, 21):
            reply = app.step(STEP * step, POSES)
        assert done.stdout == (
            f"sim2vr-app: reward {reply.reward:.6f}, image (80, 120, 4), "
            f"state {app.state_hash():016x}\n"
        )
    assert server.process.wait(10.0)
    assert server.process.exit_status == 0


@pytest.mark.parametrize("shared", [True, False])
def test_images_and_what_is_left_of_them(shared: bool) -> None:
    starting = start_sim2vr_app(app_executable(), [])
    connection = session(starting, apps=2, shared_memory=shared, width=60, height=40)
    apps = [connection.app(i) for i in range(2)]
    for app in apps:
        app.reset(1, POSES)
    # Taken away as soon as it was mapped; its name holds the server's number.
    assert not [name for name in os.listdir("/dev/shm") if str(starting.process.pid) in name]
    images = [app.image for app in apps]
    assert all(image.shape == (40, 60, 4) and image.std() > 5 for image in images)
    assert not images[0].flags.writeable
    assert np.shares_memory(images[0], apps[0].image)
    apps[0].step(STEP, POSES)
    assert np.shares_memory(images[0], apps[0].image) == shared
    copy = images[1].copy()
    for app in apps:
        app.close()
    np.testing.assert_array_equal(images[1], copy)
    assert not starting.process.running


def test_a_refused_record_leaves_the_others_alone(server: StartingApp, carrier: str) -> None:
    connection = session(server, carrier, apps=3)
    apps = [connection.app(i) for i in range(3)]
    for app in apps[:2]:
        app.reset(1, POSES)
    bad = DevicePoses(np.full((1, 7), np.nan), ONE.right_controller)
    before = apps[1].state_hash()
    for app, poses in zip(apps, (ONE, bad, ONE), strict=True):
        app.start_step(np.array([STEP]), poses)
    assert not apps[0].finish_step().finished
    with pytest.raises(AppRefused, match=r"head.*got.*expected"):
        apps[1].finish_step()
    with pytest.raises(AppError, match="call reset first"):
        apps[2].finish_step()
    assert apps[1].state_hash() == before
    # Not everybody has to take part in a message.
    apps[1].start_step(np.array([STEP]), ONE)
    assert apps[1].finish_step().log
    with pytest.raises(AppError, match="no step was started"):
        apps[1].finish_step()
    apps[0].start_step(np.array([2 * STEP]), ONE)
    with pytest.raises(AppError, match="has not been finished"):
        apps[0].start_step(np.array([2 * STEP]), ONE)
    assert apps[1].state_hash() != before  # settles what is on its way or waits
    assert apps[0].finish_step().log
    connection.close()


@pytest.mark.parametrize(
    ("number", "error"), [(signal.SIGKILL, AppDied), (signal.SIGSTOP, AppTimeout)]
)
def test_a_server_that_dies_or_hangs_in_mid_step(
    server: StartingApp, carrier: str, number: signal.Signals, error: type[Exception]
) -> None:
    connection = session(server, carrier, apps=2)
    apps = [connection.app(i) for i in range(2)]
    for app in apps:
        app.reset(1, POSES)
    if error is AppTimeout:
        connection.channel.timeout_s = 0.5
    os.kill(server.process.pid, signal.SIGSTOP)
    for app in apps:  # on its way when the server goes
        app.start_step(np.array([STEP]), ONE)
    os.kill(server.process.pid, number)
    for app in apps:
        with pytest.raises(error):
            app.finish_step()
    with pytest.raises(AppDied, match="was given up"):
        apps[0].reset(1, POSES)
    connection.close()
    assert not server.process.running


def test_a_second_client_is_told_so(server: StartingApp, carrier: str) -> None:
    connection = session(server, carrier)
    app = connection.app(0)
    app.reset(1, POSES)
    address = connection.channel.endpoint.removeprefix("tcp://")
    with pytest.raises(AppError, match=r"client"):
        Protocol2Connection(connect(address, 5.0))
    with pytest.raises(AppError, match=r"client"):
        Protocol1App(connect(address, 5.0))
    app.step(STEP, POSES)
    app.close()


CLIENT = """
import sys, numpy as np
from sim2vr_harness.client import Protocol2Connection, DevicePoses, connect
app = Protocol2Connection(connect(sys.argv[1], 20.0)).app(0)
head = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
app.reset(1, DevicePoses(head, head))
print("playing", flush=True)
for step in range(1, 10**9):
    app.step(step * 1000, DevicePoses(head, head))
"""


def test_a_client_that_vanishes_in_mid_step_ends_the_server(server: StartingApp) -> None:
    channel = server.channel(5.0, 20.0)
    channel.close()
    client = subprocess.Popen(
        [sys.executable, "-c", CLIENT, channel.endpoint.removeprefix("tcp://")],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert client.stdout is not None
    assert client.stdout.readline() == "playing\n"
    time.sleep(0.1)
    client.kill()
    client.communicate()
    assert server.process.wait(20.0)
    assert server.process.exit_status == 3
    assert re.search("client", server.process.log_tail(2))


# --- a server that talks nonsense --------------------------------------------------------------

HELLO_JSON = (
    b'{"server":"s","version":"0","protocol":2,"game":"g","apps":1,"width":2,"height":1,'
    b'"renderer_description":"r","shared_memory":null}'
)
RECORD = b"\0" * 32
LOG_RECORD = RECORD[:20] + b"\1" + RECORD[21:]  # a log value under unknown names
BAD_RECORD = RECORD[:16] + b"\1" + RECORD[17:]  # refused, without a text
IMAGE = b"\7" * 8


def header(kind: int, sequence: int, count: int = 0, status: int = 0, flags: int = 0) -> bytes:
    return HEADER.pack(MAGIC, VERSION, kind | REPLY, sequence, count, status, flags)


def hello_reply(_sequence: int) -> list[bytes]:
    return [header(1, 1), HELLO_JSON]


Answer = Callable[[int], list[bytes]]


@pytest.fixture
def liar(request: pytest.FixtureRequest) -> Iterator[str]:
    """The address of a server that gives prepared answers."""
    answers: list[Answer] = request.param
    socket = zmq.Context.instance().socket(zmq.REP)
    socket.linger = 0
    port = socket.bind_to_random_port("tcp://127.0.0.1")

    def serve() -> None:
        for answer in answers:
            if not socket.poll(5000):
                return
            frames = socket.recv_multipart()
            socket.send_multipart(answer(HEADER.unpack(frames[0])[3]))

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"127.0.0.1:{port}"
    thread.join()
    socket.close()


@pytest.mark.parametrize(
    ("liar", "message"),
    [
        ([lambda n: [b"{}"]], "expected a header of protocol 2"),
        ([lambda n: [header(1, n)[:20], HELLO_JSON]], "expected a header of protocol 2"),
        ([lambda n: [header(2, n), HELLO_JSON]], "type 0x8002.*expected 2, 0x8001"),
        ([lambda n: [header(1, n + 1), HELLO_JSON]], "sequence 2; expected"),
        ([lambda n: [header(1, n)]], "hello: IndexError"),
        ([lambda n: [header(1, n), b"{"]], "hello: JSONDecodeError"),
        ([lambda n: [header(1, n), b"{}"]], "hello: KeyError"),
        ([lambda n: [header(1, n), HELLO_JSON.replace(b":2,", b":9,")]], "images of"),
        ([lambda n: [header(1, n, status=6), b"no version 2"]], "no version 2"),
    ],
    indirect=["liar"],
)  # fmt: skip
def test_malformed_hello(liar: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        Protocol2Connection(connect(liar, 5.0), width=2, height=1)


@pytest.mark.parametrize(
    ("liar", "message"),
    [
        ([hello_reply, answer], message)
        for answer, message in (
            (lambda n: [header(2, n, 1)], "IndexError"),
            (lambda n: [header(2, n, 1), RECORD[:31], b"", b"", IMAGE, b""], "ValueError"),
            (lambda n: [header(2, n, 2), RECORD * 2, b"", b"", IMAGE * 2, b""], "records of apps"),
            (lambda n: [header(2, n, 1), b"\1" + RECORD[1:], b"", b"", IMAGE, b""], "records of"),
            (lambda n: [header(2, n, 1), RECORD, b"\0", b"", IMAGE, b""], "ValueError"),
            (lambda n: [header(2, n, 1), RECORD, b"", b"[]", IMAGE, b""], "AttributeError"),
            (lambda n: [header(2, n, 1), RECORD, b"", b"", IMAGE[1:], b""], "ValueError"),
            (lambda n: [header(2, n, 1, flags=1), RECORD, b"", b"", b"", b""], "not asked for"),
            (lambda n: [header(2, n, 1), LOG_RECORD, b"", b"", IMAGE, b""], "KeyError"),
            (lambda n: [header(2, n, 1), BAD_RECORD, b"", b"", IMAGE, b""], "IndexError"),
        )
    ],
    indirect=["liar"],
)  # fmt: skip
def test_malformed_results(liar: str, message: str) -> None:
    app = Protocol2Connection(connect(liar, 5.0), width=2, height=1).app(0)
    with pytest.raises(ProtocolError, match=message):
        app.reset(1, POSES)
    with pytest.raises(AppDied, match="was given up"):
        app.reset(1, POSES)
    app.close()
