"""Attacks a running ``watch --try`` as web pages could: nothing may be seen, moved or ended.

An observer, which has the address that ``watch`` printed, pauses the play and then listens:
whatever another client changes would reach it. The attacks: pages of another origin, foreign hosts
(DNS rebinding), no or a wrong token, 200 clients at once, and clients with the token that send
malformed messages and values that are not offered. Ends with status 0 when the observer heard
nothing, ``watch`` still runs, and the observer's own button still works.

Run: python tools/attack/watch_clients.py
"""

from __future__ import annotations

import argparse
import contextlib
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

CLIENTS = 200
NAN, INF = float("nan"), float("inf")
TURN = [1.0, 0.0, 0.0, 0.0]
CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": TURN,
    "position": [0, 0, 0],
    "fov": 1.0,
    "near": 0.01,
    "far": 1000,
    "image_height": 450,
    "image_width": 700,
    "look_at": [0, 0, 1],
    "up_direction": [0, 0, 1],
}


def messages(raw: str | bytes) -> list[dict[str, Any]]:
    """The messages of one window that viser sent."""
    assert isinstance(raw, bytes)
    packed = raw[16 : 16 + int.from_bytes(raw[8:16], "little")]
    size = int.from_bytes(raw[:8], "little")
    inner = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    found: list[dict[str, Any]] = msgspec.msgpack.decode(inner)["messages"]
    return found


def heard(client: ClientConnection, quiet_s: float) -> list[dict[str, Any]]:
    """Everything that comes until nothing has come for a while."""
    found = []
    with contextlib.suppress(TimeoutError):
        while True:
            found += messages(client.recv(timeout=quiet_s))
    return found


class Target:
    """A ``watch`` at an address, and ways to reach it."""

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        self.port, self.own = parts.port, f"http://{parts.netloc}"
        self.path = parts.path.rstrip("/")

    def open(
        self, origin: str | None = None, host: str = "127.0.0.1", path: str | None = None
    ) -> ClientConnection:
        """A WebSocket of a page; with a foreign host as after DNS rebinding."""
        link = socket.create_connection(("127.0.0.1", self.port), timeout=30.0)
        own: Any = self.own if origin is None else origin
        protocol: Any = f"viser-v{viser.__version__}"
        uri = f"ws://{host}:{self.port}{self.path if path is None else path}"
        return connect(uri, sock=link, origin=own, subprotocols=[protocol], proxy=None)

    def get(self, path: str, **headers: str) -> int:
        """Status of a page."""
        lines = {"Host": f"127.0.0.1:{self.port}", **headers}
        with socket.create_connection(("127.0.0.1", self.port), timeout=30.0) as link:
            head = "".join(f"{name}: {value}\r\n" for name, value in lines.items())
            link.sendall(f"GET {path} HTTP/1.1\r\n{head}\r\n".encode())
            return int(link.recv(4096).split()[1])

    def status(self, **page: Any) -> int:
        """The status of a WebSocket that is refused; 101: it opened."""
        try:
            self.open(**page).close()
        except InvalidStatus as refused:
            return refused.response.status_code
        return 101


def strangers(target: Target) -> dict[str, list[int]]:
    """Statuses of everything that a page without the address can do."""
    evil, foreign = "http://evil.example", f"evil.example:{target.port}"
    wrong = f"/{'x' * (len(target.path) - 1)}"
    return {
        "another origin": [
            target.get(f"{target.path}/", Origin=evil),
            *(target.status(origin=each) for each in (evil, "null", "http://127.0.0.1:1")),
        ],
        "foreign host": [
            target.get(f"{target.path}/", Host=foreign),
            target.status(host="evil.example"),
            target.status(host="evil.example", origin=f"http://{foreign}"),
        ],
        "no token": [target.get("/"), target.get("/index.html"), target.status(path="/")],
        "wrong token": [target.get(f"{wrong}/"), target.status(path=wrong)],
        f"{CLIENTS} without token": [target.status(path="/") for _ in range(CLIENTS)],
    }


def crowd(target: Target) -> Counter[int]:
    """Statuses of many clients with the token, all of which stay."""
    found: Counter[int] = Counter()
    with contextlib.ExitStack() as all_:
        for _ in range(CLIENTS):
            try:
                all_.enter_context(target.open()).send(msgspec.msgpack.encode(CAMERA))
                found[101] += 1
            except InvalidStatus as refused:
                found[refused.response.status_code] += 1
    return found


def wrong_messages(ids: list[str], arrows: list[str]) -> Iterator[bytes | str]:
    """What no page sends, for everything that this page has."""
    yield from ("text", b"", b"\xc1", b"\xdf\xff\xff\xff\xff", b"\x91" * 60_000, b"x" * 10_000_000)
    wrong: list[dict[str, Any]] = [{}, {"type": 3}, {"type": "Nonsense"}]
    wrong += [{"type": name} for name in ("ShareUrlRequest", "ShareUrlDisconnect", "Message")]
    wrong += [CAMERA | change for change in ({"fov": NAN}, {"wxyz": [INF] * 4}, {"extra": 1})]
    values: tuple[Any, ...] = (
        NAN,
        INF,
        -INF,
        1e300,
        2**63,
        -1,
        None,
        [],
        {},
        True,
        "nanx",
        "x" * 50_000,
    )
    for each in (*ids, "unknown"):
        update = {"type": "GuiUpdateMessage", "uuid": each}
        wrong += [update | {"updates": {"value": value}} for value in values]
        fields = ("removed", "update_cb", "props", "nothing")
        wrong += [update | {"updates": {name: True}} for name in fields]
        wrong += [{"type": "GuiFormDirtyMessage", "uuid": each}]
    wrong += [{"type": "CommandTriggerMessage", "uuid": each} for each in ("unknown", 3, None)]
    for name in (*arrows, "/unknown"):
        drag = {"type": "TransformControlsUpdateMessage", "name": name, "owner": ""}
        wrong += [drag | {"wxyz": TURN, "position": [bad, 0, 0]} for bad in (NAN, INF, 1e300, "x")]
        wrong += [drag | {"wxyz": bad, "position": [0, 0, 0]} for bad in ([0] * 4, [1], [NAN] * 4)]
    yield from map(msgspec.msgpack.encode, wrong)


def misbehave(target: Target, ids: list[str], arrows: list[str]) -> Counter[str]:
    """Send each wrong message from a client of its own; how these went on."""
    found: Counter[str] = Counter()
    for raw in wrong_messages(ids, arrows):
        with target.open() as client, contextlib.suppress(TimeoutError):
            try:
                client.send(raw)
                while True:
                    client.recv(timeout=0.1)
            except ConnectionClosed as closed:
                found[f"closed ({closed.rcvd.code if closed.rcvd else 'no code'})"] += 1
                continue
        found["ignored"] += 1
    return found


def first_page(observer: ClientConnection) -> list[dict[str, Any]]:
    """Everything that a page is made of."""
    found: list[dict[str, Any]] = []
    while not any(each["type"] == "ReplayDoneMessage" for each in found):
        found += messages(observer.recv(timeout=60.0))
    return found


def attack(target: Target, observer: ClientConnection) -> list[str]:
    """All attacks; returns what they achieved."""
    achieved = []
    observer.send(msgspec.msgpack.encode(CAMERA))
    page = first_page(observer)
    inputs = [each for each in page if str(each["type"]).startswith("Gui") and "props" in each]
    ids = [each["uuid"] for each in inputs]
    arrows = [each["name"] for each in page if each["type"] == "TransformControlsMessage"]
    (play,) = [each["uuid"] for each in inputs if each["type"] == "GuiButtonGroupMessage"]

    def press(button: str) -> list[dict[str, Any]]:
        update = {"type": "GuiUpdateMessage", "uuid": play, "updates": {"value": button}}
        observer.send(msgspec.msgpack.encode(update))
        return heard(observer, 2.0)

    press("pause")
    for name, statuses in strangers(target).items():
        print(f"{name}: {dict(Counter(statuses))}", flush=True)
        achieved += [f"{name} got in"] if set(statuses) != {403} else []
    many = crowd(target)
    print(f"{CLIENTS} with token: {dict(many)}", flush=True)
    achieved += ["too many clients got in"] if many[101] > 16 else []
    time.sleep(1.0)
    print(f"wrong messages: {dict(misbehave(target, ids, arrows))}", flush=True)
    seen = heard(observer, 2.0)
    print(f"heard by the observer: {len(seen)} messages", flush=True)
    achieved += [f"something moved: {each['type']}" for each in seen]
    return achieved + ([] if press("step") else ["the observer's button has no effect any more"])


def main() -> int:
    """Start ``watch``, attack it; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--game", default="sample", help="that watch plays")
    parser.add_argument("--port", default="8090", help="of watch, or the next that is free")
    given = parser.parse_args()
    program = str(Path(sys.executable).with_name("sim2vr-harness"))
    command = [program, "watch", "--try", "--game", given.game, "--port", given.port]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watch:
        try:
            assert watch.stdout is not None
            line = next(line for line in watch.stdout if "http://" in line)
            target = Target(next(word for word in line.split() if word.startswith("http://")))
            with contextlib.closing(target.open()) as observer:
                achieved = attack(target, observer)
            achieved += ["watch ended"] if watch.poll() is not None else []
        finally:
            watch.terminate()
    print("\n".join(achieved) or "Nothing was seen, nothing moved, nothing ended.")
    return 1 if achieved else 0


if __name__ == "__main__":
    sys.exit(main())
