"""Hostile messages, strangers and signals against sim2vr-app: does it answer, and end, every time?

Four attacks after another, each on servers of its own, with numbers that a seed fixes:

- ``protocol1`` and ``protocol2``: an owner's messages with one number or word replaced by an
  extreme one, in any order. Each must be answered; then a usual round must give the usual hash.
- ``strangers``: half greetings, noise and whole messages from many connections while the owner
  plays; the owner's round must give the usual hash.
- ``signals``: SIGTERM or SIGINT after a random delay into waiting, hello, a reset or a long step,
  with an owner that reads its answers or does not. The server must end within ``--end`` seconds
  with status 0.

Prints one JSON line per attack with counts; ends with status 1 when something broke.

Run: python tools/attack/server_messages.py --messages 20000 --signals 200
"""

import argparse
import copy
import json
import random
import signal
import socket
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import zmq

from sim2vr_harness.base.paths import app_executable

ANSWER_MS = 30_000
NUMBERS = ["NaN", "Infinity", "-1e400", "1e308", "5e-324", "-0.0", "9223372036854775807"]
NUMBERS += ["18446744073709551616", "1" + "0" * 400, "-1", "0.5", "1e-5"]
WORDS: list[Any] = [
    None,
    True,
    "",
    "a\0b\x1b[31m\n",
    "\ud800",
    [],
    {},
    [[]],
    "x" * 100_000,
    {"x": {"x": 1}},
]
DOUBLES = [float("nan"), float("inf"), -1e308, 5e-324, -0.0, 1e18, 0.5, 1.0000001]
WORDS32 = [0, 1, 2, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 10_000, 10_001]


def state(n: int, *, reset: bool = False) -> dict[str, Any]:
    """A state of protocol 1 whose hand strikes now and then."""
    turned = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {
        "headsetPosition": {"x": 0.0, "y": 1.17, "z": 0.0},
        "headsetRotation": dict(turned),
        "rightControllerPosition": {"x": 0.15, "y": 1.03, "z": 0.35 if n % 4 == 3 else 0.2},
        "rightControllerRotation": dict(turned),
        "currentTimestep": 0.05 * n,
        "nextTimestep": 0.05 * (n + 1),
        "reset": reset,
        "isFinished": False,
    } | ({"seed": 7, "options": {"condition": "hard"}} if reset else {})


HANDSHAKE = {"timestep": 0.002, "sampleFrequency": 20, "timeScale": 5, "clock": "round"}
HELLO = {
    "apps": 2,
    "game": "whacamole",
    "options": {"condition": "hard"},
    "width": 60,
    "height": 40,
}
POSES = struct.pack("<2I", 5, 0) + struct.pack(
    "<47d", *(0, 1.17, 0, 0, 0, 0, 1), *[0] * 7, *(0.15, 1.03, 0.2, 0, 0, 0, 1), *[0] * 26
)


def header(kind: int, count: int = 0) -> bytes:
    """Of a message of protocol 2."""
    return b"S2VR" + struct.pack("<2H4I", 3, kind, 7, count, 0, 0)


def step(apps: int, frames: int, first: int = 1, period_ns: int = 50_000_000) -> list[bytes]:
    """A step of protocol 2."""
    records = b"".join(struct.pack("<2IiI", app, frames, -1, 0) for app in range(apps))
    times = [struct.pack("<q", (first + k) * period_ns) for k in range(frames)]
    return [header(3, apps), records, b"".join(t + POSES for t in times) * apps]


def reset(apps: int) -> list[bytes]:
    """A reset of protocol 2."""
    return [
        header(2, apps),
        b"".join(struct.pack("<2Iq", a, 7, 0) + POSES for a in range(apps)),
        b"",
    ]


class Owner:
    """A client that puts the delimiter itself, so that order is up to it."""

    def __init__(self, endpoint: str) -> None:
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.DEALER)
        self.socket.linger = 0
        self.socket.rcvtimeo = ANSWER_MS
        self.socket.connect(endpoint)

    def ask(self, frames: list[bytes]) -> list[bytes]:
        """The answer; zmq.Again if none comes."""
        self.socket.send_multipart([b"", *frames])
        return self.socket.recv_multipart()[1:]

    def ask1(self, message: Any) -> dict[str, Any]:
        """The answer to a message of protocol 1, text or an object."""
        text = message if isinstance(message, str) else json.dumps(message)
        return dict(json.loads(self.ask([text.encode("utf-8", "surrogatepass")])[0]))

    def round1(self) -> str:
        """Hash of a usual round of protocol 1."""
        self.ask1(state(0, reset=True))
        for n in range(1, 20):
            self.ask1(state(n))
        return str(self.ask1(state(20) | {"stateHash": True}).get("stateHash"))

    def close(self) -> None:
        """Goes away."""
        self.socket.close()
        self.context.term()


@contextmanager
def serving(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server, killed at the end, and where it listens."""
    command = [str(app_executable()), "--port", "0", "--renderer", "null", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().split()[-1]
        finally:
            process.kill()


def spoiled(message: Any, chance: random.Random) -> str:
    """JSON text of a message with one of its values replaced."""
    message = copy.deepcopy(message)
    places = []

    def visit(found: Any) -> None:
        if isinstance(found, dict):
            for key in found:
                places.append((found, key))
                visit(found[key])

    visit(message)
    owner, key = chance.choice(places)
    if chance.random() < 0.7:
        owner[key] = "\x01"
        return json.dumps(message).replace('"\\u0001"', chance.choice(NUMBERS))
    owner[key] = chance.choice(WORDS)
    return json.dumps(message)


def protocol1(messages: int, chance: random.Random) -> Counter[str]:
    """Spoils what an owner of protocol 1 sends."""
    counts: Counter[str] = Counter()
    with serving() as (process, endpoint):
        owner = Owner(endpoint)
        while "error" in owner.ask1(spoiled(HANDSHAKE, chance)):
            counts["handshakes refused"] += 1
        owner.close()
        process.wait(30)
    with serving() as (process, endpoint):
        owner = Owner(endpoint)
        owner.ask1(HANDSHAKE)
        usual, n = owner.round1(), 20
        for _ in range(messages):
            n = 0 if chance.random() < 0.02 else n + 1
            wanted: dict[str, Any] = state(n, reset=n == 0)
            if chance.random() < 0.3:
                frames = [state(n) | {"time_ns": n * 50_000_000}] * chance.randint(1, 3)
                wanted |= {"timeNs": n * 50_000_000, "frames": frames, "stateHash": True}
            if chance.random() < 0.1:
                wanted |= {"render": {"view": "headset", "width": 8, "height": 8}, "save": True}
                wanted |= {"headRequest": {"seed": 1, "options": {}}, "load": None}
            text = spoiled(wanted, chance)
            if chance.random() < 0.05:
                text = text[: chance.randrange(len(text))]
            answer = owner.ask1(text)
            counts[answer.get("error", {}).get("code", "taken")] += 1
        assert owner.round1() == usual, "a round is another one after hostile messages"
        assert process.poll() is None
        owner.close()
    return counts


def spoiled2(frames: list[bytes], chance: random.Random) -> list[bytes]:
    """A message of protocol 2 with numbers, frames or lengths changed."""
    frames = list(frames)
    i = chance.randrange(len(frames))
    data = bytearray(frames[i])
    kind = chance.random()
    if kind < 0.4 and len(data) >= 8:
        struct.pack_into("<d", data, 8 * chance.randrange(len(data) // 8), chance.choice(DOUBLES))
    elif kind < 0.7 and len(data) >= 4:
        struct.pack_into("<I", data, 4 * chance.randrange(len(data) // 4), chance.choice(WORDS32))
    elif kind < 0.8:
        del data[chance.randrange(len(data) + 1) :]
    elif kind < 0.9:
        data += bytes(chance.randrange(500))
    else:
        frames.append(bytes(chance.randrange(9)))
        chance.shuffle(frames)
        return frames
    frames[i] = bytes(data)
    return frames


def protocol2(messages: int, chance: random.Random) -> Counter[str]:
    """Spoils what an owner of protocol 2 sends."""

    def usual_round(owner: Owner) -> bytes:
        owner.ask([header(1), json.dumps(HELLO).encode()])
        owner.ask(reset(2))
        for n in range(1, 20):
            owner.ask(step(2, 1, n))
        return owner.ask([header(7), struct.pack("<I", 1)])[1]

    counts: Counter[str] = Counter()
    with serving("--threads", "2") as (process, endpoint):
        owner = Owner(endpoint)
        usual = usual_round(owner)
        for n in range(messages):
            whole = chance.choice(
                [
                    reset(2),
                    *[step(2, chance.randint(1, 3), n)] * 4,
                    [header(4), b'{"app": 0, "view": "recorder", "width": 8, "height": 8}'],
                    [header(5), struct.pack("<I", 1)],
                    [header(6), struct.pack("<I", 1), b"sim2vr app state"],
                    [header(7), struct.pack("<I", 0)],
                    [header(9), b'{"app": 0, "seed": 1, "options": {}}'],
                    [header(1), spoiled(HELLO, chance).encode("utf-8", "surrogatepass")],
                ]
            )
            frames = spoiled2(whole, chance)
            if frames[0][:4] == b"S2VR" and frames[0][6:8] == b"\x08\0":
                continue  # a quit
            answer = owner.ask(frames)
            if answer[0][:4] != b"S2VR":
                counts["answered in protocol 1"] += 1
            else:
                counts[f"status {struct.unpack_from('<I', answer[0], 16)[0]}"] += 1
        assert usual_round(owner) == usual, "a round is another one after hostile messages"
        assert process.poll() is None
        owner.close()
    return counts


def strangers(messages: int, chance: random.Random) -> Counter[str]:
    """Lets many others in while the owner plays."""
    greeting = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16 + 32)
    ready = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03REQ"
    counts: Counter[str] = Counter()
    with serving() as (process, endpoint), ExitStack() as open_sockets:
        address = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
        owner = Owner(endpoint)
        owner.ask1(HANDSHAKE)
        usual = owner.round1()
        for n in range(messages):
            raw = socket.create_connection(address, 20)
            open_sockets.push(raw)
            text = json.dumps(state(n)).encode()
            body = struct.pack("B", 1) + b"\0" + struct.pack(">BQ", 2, len(text)) + text
            whole = greeting + ready + body * chance.randint(1, 40)
            part = whole if chance.random() < 0.3 else whole[: chance.randrange(len(whole))]
            if chance.random() < 0.2:
                part = chance.randbytes(200)
            raw.sendall(part)
            counts["strangers"] += 1
            if chance.random() < 0.7:
                raw.close()
            if n % 100 == 99:
                assert owner.round1() == usual, "strangers changed a round"
                counts["rounds of the owner"] += 1
                open_sockets.close()
        assert process.poll() is None
        owner.close()
    return counts


def signals(number: int, chance: random.Random, end_s: float) -> Counter[str]:
    """Asks servers to end in whatever they do."""
    heavy = {"apps": 64, "fixed_delta_time_s": 1e-5, "maximum_delta_time_s": 1.0}
    counts: Counter[str] = Counter()
    for _ in range(number):
        doing = chance.choice(["waiting", "hello", "reset", "step", "protocol 1"])
        with serving("--threads", str(chance.choice([1, 2]))) as (process, endpoint):
            owner = Owner(endpoint)
            first = [header(1), json.dumps(heavy).encode()]
            if doing == "hello":
                owner.socket.send_multipart([b"", *first])
            elif doing == "protocol 1":
                owner.ask1(HANDSHAKE)
                owner.socket.send_multipart([b"", json.dumps(state(0, reset=True)).encode()])
            elif doing != "waiting":
                owner.ask(first)
                if doing == "step":
                    owner.ask(reset(64))
                    owner.socket.send_multipart([b"", *step(64, 60, period_ns=1_000_000_000)])
                else:
                    for _ in range(20):
                        owner.socket.send_multipart([b"", *reset(64)])
            time.sleep(chance.choice([0.0, 0.001, 0.02, 0.2]))
            asked = time.monotonic()
            process.send_signal(chance.choice([signal.SIGTERM, signal.SIGINT]))
            status = process.wait(120)
            took = time.monotonic() - asked
            counts[doing] += 1
            counts["slowest_ms"] = max(counts["slowest_ms"], round(1000 * took))
            assert status == 0, f"status {status} while {doing}"
            assert took < end_s, f"{took:.1f} s to end while {doing}"
            owner.close()
    return counts


def main() -> int:
    """Runs the attacks; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--messages", type=int, default=20_000, help="of each protocol")
    parser.add_argument("--strangers", type=int, default=2_000, help="connections")
    parser.add_argument("--signals", type=int, default=200, help="servers to end")
    parser.add_argument("--end", type=float, default=5.0, help="longest time to end, s")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    attacks: dict[str, Callable[[random.Random], Counter[str]]] = {
        "protocol1": lambda chance: protocol1(asked.messages, chance),
        "protocol2": lambda chance: protocol2(asked.messages, chance),
        "strangers": lambda chance: strangers(asked.strangers, chance),
        "signals": lambda chance: signals(asked.signals, chance, asked.end),
    }
    broken = 0
    for name, attack in attacks.items():
        try:
            counts: dict[str, Any] = dict(attack(random.Random(f"{asked.seed} {name}")))
        except (AssertionError, zmq.Again, OSError) as error:
            counts, broken = {"broke": f"{type(error).__name__}: {error}"}, broken + 1
        print(json.dumps({"attack": name, **counts}), flush=True)
    return min(broken, 1)


if __name__ == "__main__":
    sys.exit(main())
