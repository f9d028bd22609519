"""Strangers neither see nor touch what somebody watches."""

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs, urlsplit

import msgspec
import numpy as np
import pytest
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from processes import free_port, until
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import AppScene
from sim2vr_harness.tools.gate import Gate, Refused
from sim2vr_harness.tools.watch import browser
from sim2vr_harness.tools.watch.browser import Viewer
from sim2vr_harness.tools.watch.frames import Hands, Playlist, ViewerFrame

EVIL = "http://evil.example"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1, 0, 0, 0],
    "position": [0, 0, 0],
    "fov": 1.0,
    "near": 0.01,
    "far": 1000,
    "image_height": 450,
    "image_width": 700,
    "look_at": [0, 0, 1],
    "up_direction": [0, 0, 1],
}


def show() -> Playlist:
    """Play without end, with a right hand to move."""

    def moments() -> Iterator[ViewerFrame]:
        for k in range(1, 100_001):
            yield ViewerFrame(k / 20.0, AppScene((), ()), np.zeros((4, 6, 3), np.uint8), f"{k}")

    hand = np.array([0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    return Playlist("empty", 20.0, moments, hands=Hands({"right_controller": hand}))


@pytest.fixture
def theatre() -> Iterator[Viewer]:
    """A theatre that plays."""
    over = threading.Event()
    with contextlib.closing(Viewer(show(), port=free_port())) as made:
        runner = threading.Thread(target=made.run, args=(over.is_set,))
        runner.start()
        yield made
        alive = runner.is_alive()
        over.set()
        runner.join()
    assert alive, "run() ended"


def opened(theatre: Viewer, address: str | None = None, origin: str | None = None) -> Any:
    """A WebSocket, as viser's page opens it: to this machine, whatever the address says."""
    port = urlsplit(theatre.address).port
    link = socket.create_connection(("127.0.0.1", port))
    own: Any = f"http://127.0.0.1:{port}" if origin is None else origin
    protocol: Any = f"viser-v{viser.__version__}"
    return connect(
        address or websocket(theatre), sock=link, origin=own, subprotocols=[protocol], proxy=None
    )


def websocket(theatre: Viewer) -> str:
    """The address that the page connects to."""
    (address,) = parse_qs(urlsplit(theatre.address).query)["websocket"]
    return address


def refusal(theatre: Viewer, address: str | None = None, origin: str | None = None) -> str:
    """Why a WebSocket is closed before any message, or "" if messages come.

    What it presses at once has no effect either.
    """
    speed, before = theatre._speed, theatre.playback.speed
    other = next(each for each in speed.options if each != speed.value)
    with opened(theatre, address, origin) as client:
        with contextlib.suppress(ConnectionClosed):
            send(client, **CAMERA)
            send(client, type="GuiUpdateMessage", uuid=speed._impl.uuid, updates={"value": other})
        try:
            client.recv(timeout=30.0)
        except ConnectionClosed as closed:
            assert closed.rcvd is not None
            assert closed.rcvd.code == 1008
            time.sleep(0.2)
            assert theatre.playback.speed == before
            return closed.rcvd.reason
    assert until(lambda: theatre.playback.speed != before)
    return ""


def send(client: ClientConnection, **message: Any) -> None:
    client.send(msgspec.msgpack.encode(message))


def test_only_the_own_page_with_the_token_gets_in(theatre: Viewer) -> None:
    address, port = websocket(theatre), urlsplit(theatre.address).port
    token = urlsplit(address).path.strip("/")
    assert len(token) >= 32
    assert refusal(theatre) == ""
    assert refusal(theatre, f"ws://localhost:{port}/{token}", f"http://localhost:{port}") == ""
    for origin in (EVIL, f"http://127.0.0.1:{(port or 0) + 1}", "null"):
        assert refusal(theatre, origin=origin) == "Origin"
    assert refusal(theatre, address.replace("127.0.0.1", "evil.example")) == "Host"
    for path in (token[:-1], f"{token}x", "x" * len(token), f"x/{token}", f"?{token}", ""):
        assert refusal(theatre, address.replace(token, path)) == "Token"


@pytest.mark.parametrize(
    ("host", "name", "passes"),
    [
        ("127.0.0.1", "[::1]:80", True),
        ("127.0.0.1", "192.168.1.7:80", False),
        ("Box.local", "box.LOCAL:80", True),
        ("127.0.0.1", "localhost@evil.example", False),
        ("0.0.0.0", "10.0.0.9:80", True),
    ],
)
def test_a_host_is_a_loopback_name_or_where_the_server_listens(
    host: str, name: str, passes: bool
) -> None:
    gate = Gate(host)
    path, reached = f"/{gate.token}/a?b", "::ffff:10.0.0.9" if host == "0.0.0.0" else ""
    if passes:
        assert gate.admit(path, [name], [f"http://{name}"], reached) == "/a?b"
    else:
        with pytest.raises(Refused, match=r"^Host: got "):
            gate.admit(path, [name], [], reached)
    with pytest.raises(Refused):
        gate.admit(path, [name, name], [], reached)


def test_a_tunnel_is_let_in_by_the_option_only(
    theatre: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, server = Gate("127.0.0.1"), theatre._server
    url = "https://abc.share.example"
    with pytest.raises(Refused, match=r"^Host"):
        gate.admit(f"/{gate.token}", ["abc.share.example"], [url])
    monkeypatch.setattr(server, "request_share_url", lambda **_: url)
    shared = f"{url}/?websocket=wss://abc.share.example/{gate.token}"
    assert browser.share(server, gate) == shared
    assert gate.admit(f"/{gate.token}", ["abc.share.example"], [url]) == "/"
    monkeypatch.setattr(server, "request_share_url", lambda **_: None)
    with pytest.raises(InputError, match=r"^--share: got no tunnel"):
        browser.share(server, gate)
