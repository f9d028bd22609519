"""Strangers neither see nor touch what somebody watches."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import AppScene
from sim2vr_harness.tools.gate import Gate, Refused
from sim2vr_harness.tools.watch.frames import Hands, Playlist, ViewerFrame

viser = pytest.importorskip("viser")
msgspec = pytest.importorskip("msgspec")

from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import ClientConnection, connect  # noqa: E402

from sim2vr_harness.tools.watch import server as guarded  # noqa: E402
from sim2vr_harness.tools.watch.browser import Viewer  # noqa: E402
from sim2vr_harness.tools.watch.offers import MAX_BYTES, Malformed, Offers  # noqa: E402

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


def free_port() -> int:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


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


def got(theatre: Viewer, path: str | None = None, **headers: str) -> tuple[int, bytes, Any]:
    """Status, body and headers of a page."""
    parts = urlsplit(theatre.address)
    link = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=30.0)
    with contextlib.closing(link):
        link.request("GET", path or parts.path, headers={"Host": parts.netloc} | headers)
        answer = link.getresponse()
        return answer.status, answer.read(), answer.headers


def opened(theatre: Viewer, address: str | None = None, origin: str | None = None) -> Any:
    """A WebSocket, as viser's page opens it: to this machine, whatever the address says."""
    parts = urlsplit(theatre.address)
    link = socket.create_connection(("127.0.0.1", parts.port))
    own: Any = f"http://{parts.netloc}" if origin is None else origin
    address = address or theatre.address.rstrip("/")
    protocol: Any = f"viser-v{viser.__version__}"
    return connect(
        address.replace("http:", "ws:"), sock=link, origin=own, subprotocols=[protocol], proxy=None
    )


def status(theatre: Viewer, address: str | None = None, origin: str | None = None) -> int:
    """The status with which a WebSocket is refused; 101: it opens."""
    try:
        opened(theatre, address, origin).close()
    except InvalidStatus as refused:
        return refused.response.status_code
    return 101


def send(client: ClientConnection, **message: Any) -> None:
    client.send(msgspec.msgpack.encode(message))


def until(true: Any, seconds: float = 30.0) -> bool:
    deadline = time.monotonic() + seconds
    while not true() and time.monotonic() < deadline:
        time.sleep(0.02)
    return bool(true())


def test_only_the_own_page_with_the_token_gets_in(theatre: Viewer) -> None:
    token = urlsplit(theatre.address).path.strip("/")
    port = urlsplit(theatre.address).port
    assert len(token) >= 32
    found, page, headers = got(theatre)
    assert (found, headers["Referrer-Policy"]) == (200, "no-referrer")
    assert b"<title>Viser</title>" in page
    assert got(theatre, Host=f"localhost:{port}")[0] == 200
    assert status(theatre) == 101

    for why, refused in {
        "Origin": got(theatre, Origin=EVIL),
        "Host": got(theatre, Host=f"evil.example:{port}"),
        "Token": got(theatre, "/"),
    }.items():
        assert refused[0] == 403
        assert refused[1].startswith(why.encode())
    for path in (f"/{token[:-1]}/", f"/{token}x/", "/index.html", f"/x/{token}/", f"/?{token}"):
        assert got(theatre, path)[0] == 403, path
    address = theatre.address.rstrip("/")
    assert status(theatre, origin=EVIL) == 403
    assert status(theatre, origin=f"http://127.0.0.1:{(port or 0) + 1}") == 403
    assert status(theatre, origin="null") == 403
    assert status(theatre, address.replace("127.0.0.1", "evil.example")) == 403
    assert status(theatre, address.replace(token, "")) == 403
    assert status(theatre, address.replace(token, "x" * len(token))) == 403


@pytest.mark.parametrize(
    ("host", "name", "passes"),
    [
        ("127.0.0.1", "[::1]:80", True),
        ("127.0.0.1", "192.168.1.7:80", False),
        ("192.168.1.7", "192.168.1.7:80", True),
        ("Box.local", "box.LOCAL:80", True),
        ("127.0.0.1", "localhost.evil.example", False),
        ("127.0.0.1", "localhost@evil.example", False),
        ("127.0.0.1", "", False),
        ("0.0.0.0", "10.0.0.9:80", True),
        ("::", "evil.example", False),
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


def test_a_tunnel_opens_by_the_option_only(
    theatre: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    server = theatre._server
    monkeypatch.setattr(server, "request_share_url", lambda **_: calls.append("share"))
    handled = server._websock_server._incoming_handlers
    assert not {kind.__name__ for kind in handled} & {"ShareUrlRequest", "ShareUrlDisconnect"}
    speed = next(uuid for uuid, ok in theatre._offers._values.items() if ok("2x"))
    with opened(theatre) as client:
        send(client, **CAMERA)
        send(client, type="ShareUrlRequest")
        send(client, type="GuiUpdateMessage", uuid=speed, updates={"value": "2x"})
        assert until(lambda: theatre.playback.speed == 2.0)
    assert calls == []

    gate = Gate("127.0.0.1")
    url = "https://abc.share.example"
    monkeypatch.setattr(server, "request_share_url", lambda **_: url)
    assert guarded.share(server, gate) == f"{url}/{gate.token}/"
    assert gate.admit(f"/{gate.token}", ["abc.share.example"], [url]) == "/"
    monkeypatch.setattr(server, "request_share_url", lambda **_: None)
    with pytest.raises(InputError, match=r"^--share: got no tunnel"):
        guarded.share(server, gate)


def test_values_that_are_not_offered_change_nothing(theatre: Viewer) -> None:
    values = theatre._offers._values
    speed = next(uuid for uuid, ok in values.items() if ok("2x"))
    slider = theatre._slider._impl.uuid
    (name,) = theatre._offers._arrows
    assert theatre._show.hands is not None
    hand = theatre._show.hands.poses["right_controller"]
    before = hand.copy()
    nan, turn = float("nan"), [1.0, 0.0, 0.0, 0.0]
    drag = {"type": "TransformControlsUpdateMessage", "name": name, "owner": ""}
    with opened(theatre) as client:
        send(client, **CAMERA)
        for value in ("nanx", "inf", "1000x", nan, 1e308, None, [1], {"a": 1}, "x" * 1000):
            send(client, type="GuiUpdateMessage", uuid=speed, updates={"value": value})
            time.sleep(0.05)  # time goes by at this speed, if it is taken
        at = theatre.playback.at
        assert until(lambda: theatre.playback.at > at + 1), "time stands still"
        assert theatre.playback.speed == 1.0
        for value in (nan, float("inf"), -1.0, 1e5, "x", True):
            send(client, type="GuiUpdateMessage", uuid=slider, updates={"value": value})
        send(client, type="GuiUpdateMessage", uuid=speed, updates={"removed": True})
        send(client, type="GuiUpdateMessage", uuid="none", updates={"value": "2x"})
        send(client, type="CommandTriggerMessage", uuid="none")
        send(client, **drag, position=[nan, 0.0, 0.0], wxyz=turn)
        send(client, **drag, position=[0.0, 0.0, 0.0], wxyz=[0.0] * 4)
        send(client, type="Nonsense")
        send(client, **(CAMERA | {"extra": 1}))
        # The last, which is offered, is handled after all before.
        send(client, type="GuiUpdateMessage", uuid=speed, updates={"value": "4x"})
        assert until(lambda: theatre.playback.speed == 4.0)
        at = theatre.playback.at
        assert until(lambda: theatre.playback.at > at), "time stands still"
        np.testing.assert_array_equal(theatre._show.hands.poses["right_controller"], before)
        send(client, **drag, position=[0.1, 0.0, 1.0], wxyz=turn)
        assert until(
            lambda: not np.array_equal(theatre._show.hands.poses["right_controller"], before)
        )


def test_a_malformed_message_closes_its_client_only(theatre: Viewer) -> None:
    with opened(theatre) as good:
        send(good, **CAMERA)
        for raw in (b"", b"\xc1", b"\xdf\xff\xff\xff\xff", "text", b"\x91" * (MAX_BYTES + 1)):
            with opened(theatre) as bad:
                bad.send(raw)
                with pytest.raises(ConnectionClosed) as closed:
                    while True:
                        bad.recv(timeout=30.0)
                assert closed.value.rcvd is not None
                assert closed.value.rcvd.code in (1007, 1009)
        at = theatre.playback.at
        assert until(lambda: theatre.playback.at > at)
        assert good.recv(timeout=30.0)


def test_what_was_checked_is_what_is_handled() -> None:
    # A map with two types: readers differ in which of them they take.
    first, second = msgspec.msgpack.encode(CAMERA), {"type": "ShareUrlRequest"}
    twice = bytes([first[0] + 1]) + first[1:] + msgspec.msgpack.encode(second)[1:]
    taken = Offers().take(twice)
    assert taken is None or msgspec.msgpack.decode(taken)["type"] == "ViewerCameraMessage"
    with pytest.raises(Malformed):
        Offers().take(b"\xa5ab")


def test_the_number_of_clients_is_limited(theatre: Viewer) -> None:
    with contextlib.ExitStack() as all_:
        clients = [all_.enter_context(opened(theatre)) for _ in range(guarded.MAX_CLIENTS)]
        with pytest.raises(InvalidStatus) as refused:
            opened(theatre)
        assert refused.value.response.status_code == 503
        assert refused.value.response.body.startswith(b"16 pages are open, expected fewer")
        clients[0].close()
        assert until(lambda: status(theatre) == 101)
        assert clients[-1].recv(timeout=30.0)


def test_a_viser_that_starts_otherwise_is_not_used() -> None:
    class Other:
        __version__ = "9.0"
        stopped = False

        def ViserServer(self, **_: Any) -> Any:
            return self

        def stop(self) -> None:
            self.stopped = True

    other = Other()
    with pytest.raises(InputError, match=r"^watch: got viser 9\.0, expected viser 1.1"):
        guarded.open_server(other, Gate("127.0.0.1"), Offers(), "127.0.0.1", 1)
    assert other.stopped
