"""Protocol 2 beyond what the contract suite covers: faults on both sides, images, the example."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq

from sim2vr_harness.base.paths import app_executable
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
from sim2vr_harness.client.protocol2 import HAPTIC_DTYPE, HEADER, MAGIC, REPLY, VERSION

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


def session(server: StartingApp, **settings: object) -> Protocol2Connection:
    return Protocol2Connection(server.channel(20.0, 20.0), **settings)  # type: ignore[arg-type]


def test_the_example_client_plays(server: StartingApp) -> None:
    channel = server.channel(5.0, 20.0)
    channel.close()
    done = subprocess.run(
        [sys.executable, EXAMPLE, channel.endpoint],
        capture_output=True,
        text=True,
        timeout=240,
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


def test_a_refused_record_leaves_the_others_alone(server: StartingApp) -> None:
    connection = session(server, apps=3)
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
    server: StartingApp, number: signal.Signals, error: type[Exception]
) -> None:
    connection = session(server, apps=2)
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


def test_a_second_client_is_told_so(server: StartingApp) -> None:
    connection = session(server)
    app = connection.app(0)
    app.reset(1, POSES)
    address = connection.channel.endpoint
    with pytest.raises(AppError, match=r"client"):
        Protocol2Connection(connect(address, 5.0))
    with pytest.raises(AppError, match=r"client"):
        Protocol1App(connect(address, 5.0))
    app.step(STEP, POSES)
    app.close()


# --- a server that talks nonsense --------------------------------------------------------------

HELLO_JSON = (
    b'{"server":"s","version":"0","game":"g","facts":null,"capabilities":["views"],"apps":1,'
    b'"width":2,"height":1,"eyes":1,"renderer_description":"r","shared_memory":null}'
)
RECORD = b"\0" * 40
IMAGE = b"\7" * 8


def with_number(offset: int, value: int) -> bytes:
    """The record with another number at an offset."""
    return RECORD[:offset] + struct.pack("<I", value) + RECORD[offset + 4 :]


PULSE_RECORD = with_number(28, 1)
DEEP = b"[" * 100_000
NAN_PULSE = HAPTIC_DTYPE.itemsize * b"\0"
NAN_PULSE = NAN_PULSE[:4] + struct.pack("<f", float("nan")) + NAN_PULSE[8:]
NAN_SOUND = struct.pack("<If3d", 0, 1.0, 0.0, float("nan"), 0.0)


def header(kind: int, sequence: int, count: int = 0, status: int = 0, flags: int = 0) -> bytes:
    return HEADER.pack(MAGIC, VERSION, kind | REPLY, sequence, count, status, flags)


def results(
    sequence: int,
    records: bytes = RECORD,
    *,
    values: bytes = b"",
    names: bytes = b"",
    images: bytes = IMAGE,
    haptics: bytes = b"",
    sounds: bytes = b"",
    flags: int = 0,
) -> list[bytes]:
    """The reply to a reset, one thing of it other than it should be."""
    first = header(2, sequence, len(records) // 40, flags=flags)
    return [first, records, values, names, images, b"", haptics, sounds]


def hello_reply(_sequence: int) -> list[bytes]:
    return [header(1, 1), HELLO_JSON]


def able_reply(_sequence: int) -> list[bytes]:
    return [header(1, 1), HELLO_JSON.replace(b'["views"]', b'["head_request","scene"]')]


MESH = b"\0" * 36 + b"\0\0\0\0\1\0\0\0\2\0\0\0"
"""Three corners and a triangle."""


def scene(**changes: object) -> bytes:
    """The JSON of a scene with one object, one thing of it other than it should be."""
    numbers = {"pose": [0.0] * 6 + [1.0], "scale": [1.0] * 3, "color": [1.0] * 4, "mesh": 0}
    one = {"id": 1, "path": "a", "layer": 0, "unlit": False, **numbers, **changes}
    mesh = {"name": "m", "vertices": 3, "triangles": 1}
    return json.dumps({"meshes": [mesh], "objects": [one]}).encode()


Answer = Callable[[int], list[bytes]]


@pytest.fixture
def liar(request: pytest.FixtureRequest) -> Iterator[str]:
    """The address of a server that gives prepared answers."""
    answers: list[Answer] = request.param
    server = zmq.Context.instance().socket(zmq.REP)
    server.linger = 0
    port = server.bind_to_random_port("tcp://127.0.0.1")

    def serve() -> None:
        for answer in answers:
            if not server.poll(5000):
                return
            frames = server.recv_multipart()
            server.send_multipart(answer(HEADER.unpack(frames[0])[3]))

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"127.0.0.1:{port}"
    thread.join()
    server.close()


HELLOS: dict[str, Answer] = {
    "expected a header of protocol 2": lambda n: [b"{}"],
    "sequence 2; expected": lambda n: [header(1, n + 1), HELLO_JSON],
    "hello: got .* JSON nested at most 100 deep": lambda n: [header(1, n), DEEP],
    "images of": lambda n: [header(1, n), HELLO_JSON.replace(b":2,", b":9,")],
    "messages of version 2 of protocol 2, expected 3: take app and": lambda n: [
        HEADER.pack(MAGIC, 2, 1 | REPLY, n, 0, 6, 0),
        b"version: got 3",
    ],
}
RESETS: dict[str, Answer] = {
    "0 frames after the header, expected 7": lambda n: [header(2, n, 1)],
    "records of apps": lambda n: results(n, RECORD * 2, images=IMAGE * 2),
    "of another number than the records say": lambda n: results(n, values=b"\0" * 8),
    "names: got .*, expected a JSON obj": lambda n: results(n, names=b"[]"),
    "not requested": lambda n: results(n, images=b"", flags=1),
    "reward or time feature that is not finite": lambda n: results(n, with_number(8, 0x7FC00000)),
    "IndexError": lambda n: results(n, PULSE_RECORD, haptics=b"\7" * 24),
    "status 77, expected 0 to 7": lambda n: results(n, with_number(16, 77)),
    "vibration .* not finite": lambda n: results(n, PULSE_RECORD, haptics=NAN_PULSE),
    "sound .* not finite": lambda n: results(n, with_number(32, 1), sounds=NAN_SOUND),
}
QUESTIONS: dict[str, Answer] = {
    "pitch_deg: got nan": lambda n: [header(9, n), b'{"pitch_deg":NaN}'],
    "scene: got .* nested at most 100 deep": lambda n: [header(10, n), DEEP, b""],
    "mesh 1 of 1": lambda n: [header(10, n), scene(mesh=1), MESH],
    "pose": lambda n: [header(10, n), scene(pose=[0.0] * 6), MESH],
    "past its 3": lambda n: [header(10, n), scene(), MESH[:-4] + b"\3\0\0\0"],
}
REPLIES = [
    *(([answer], message) for message, answer in HELLOS.items()),
    *(([hello_reply, answer], message) for message, answer in RESETS.items()),
    *(([able_reply, answer], message) for message, answer in QUESTIONS.items()),
]


@pytest.mark.parametrize(("liar", "message"), REPLIES, indirect=["liar"])
def test_malformed_replies_give_the_app_up(liar: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        app = Protocol2Connection(connect(liar, 5.0), width=2, height=1).app(0)
        if message in RESETS:
            app.reset(1, POSES)
        app.head_request(1) if "pitch" in message else app.scene()
    if message in RESETS:
        with pytest.raises(AppDied, match="was given up"):
            app.reset(1, POSES)


def test_a_closed_port_is_told_in_seconds() -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
        started = time.monotonic()
        with pytest.raises(AppTimeout, match=f"127.0.0.1:{port}, where no one listens"):
            Protocol2Connection(connect(f"127.0.0.1:{port}", 60.0))
    assert time.monotonic() - started < 10.0
