"""Stands in for a Unity app with the SIM2VR asset: speaks protocol 1, the reference's fields only.

``-simulated -port N -logFile FILE`` as Unity builds take them. What it is to get wrong comes as
``-fault KIND@K``: in the K-th exchange (the handshake is number 0), and, with ``-once FILE``, only
in the first process that gets there. ``-record FILE`` keeps every message, one line each.
"""

import io
import json
import os
import signal
import struct
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import zmq
from PIL import Image

WIDTH, HEIGHT = 120, 80


def values(arguments: list[str]) -> dict[str, str]:
    found = {}
    for name, value in zip(arguments, [*arguments[1:], ""], strict=True):
        if name.startswith("-"):
            found[name] = value
    return found


class Game:
    """Earns the x of the right hand in every step; its picture is the time and the hand."""

    def __init__(self, round_s: float) -> None:
        self.round_s = round_s
        self.start_s = 0.0
        self.steps = 0

    def answer(self, state: dict) -> dict:
        if state.get("reset"):
            self.start_s, self.steps = state["currentTimestep"], 0
        else:
            self.steps += 1
        elapsed = state["currentTimestep"] - self.start_s
        hand = state["rightControllerPosition"]
        return {
            # The round is over in the first frame beyond its length; binary32 times as in Unity.
            "isFinished": elapsed > self.round_s + 1e-4 or bool(state.get("isFinished")),
            "reward": 99.0 if state.get("reset") else hand["x"],
            "image": list(self.picture(elapsed, hand)),
            "timeFeature": min(1.0, 2.0 * elapsed / self.round_s - 1.0),
            "logDict": json.dumps({"Points": self.steps, "Elapsed": elapsed}),
        }

    def picture(self, elapsed: float, hand: dict) -> bytes:
        pixels = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
        pixels[..., 0] = np.arange(WIDTH)
        pixels[..., 1] = np.arange(HEIGHT)[:, None]
        pixels[..., 2] = int(20 * elapsed) % 256
        pixels[..., 3] = int(100 * abs(hand["z"])) % 256
        return png(pixels)


def png(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def huge_png() -> bytes:
    """The header of a picture that would fill 2 GB."""
    size = struct.pack(">IIBBBBB", 22000, 22000, 8, 6, 0, 0, 0)
    chunks = b""
    for kind, data in ((b"IHDR", size), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")):
        chunks += struct.pack(">I", len(data)) + kind + data
        chunks += struct.pack(">I", zlib.crc32(kind + data))
    return b"\x89PNG\r\n\x1a\n" + chunks


def misbehave(kind: str, socket: zmq.Socket, reply: dict) -> bytes:
    """Does what is asked for; returns the reply where there is one."""
    sys.stderr.write(f"fault: {kind}\n")
    if kind in ("hang", "leave"):
        if kind == "leave":  # the connection goes, the process stays
            socket.close(linger=0)
        time.sleep(3600)
    elif kind == "die":
        sys.stderr.write("NullReferenceException: Object reference not set\n")
        sys.exit(1)
    elif kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    elif kind == "infinite":
        text = json.dumps(reply)
        return text.replace('"timeFeature": ', '"timeFeature": 1e400, "was": ').encode()
    elif kind == "missing":
        del reply["timeFeature"]
    texts = {"garbage": b"\xff\x00 not JSON", "deep-reply": b'{"reward":' + b"[" * 100_000}
    changes = {
        "reward": {"reward": "much"},
        "nan": {"reward": float("nan")},
        "overflow": {"reward": 1e39},  # beyond binary32
        "deep": {"logDict": "[" * 100_000},
        "bomb": {"image": list(huge_png())},  # 22,000 x 22,000 pixels in 100 bytes
        "image": {"image": [1, 2, 300]},
        "size": {"image": list(png(np.zeros((60, 90, 4), np.uint8)))},
        "deaf": {"isFinished": False},  # does not take the end of a round
    }
    return texts.get(kind) or json.dumps(reply | changes.get(kind, {})).encode()


def claimed(file: Path) -> bool:
    """Makes the file; False when another of these programs was first."""
    try:
        file.open("x").close()
    except FileExistsError:
        return False
    return True


def main() -> None:
    given = values(sys.argv[1:])
    if "-refuse" in given:
        sys.stderr.write("condition: got nothing, expected one\n")
        sys.exit(2)
    if "-slow" in given:
        time.sleep(float(given["-slow"]))
    fault, _, number = given.get("-fault", "none@-1").partition("@")
    game = Game(float(given.get("-round", "0.5")))
    socket = zmq.Context.instance().socket(zmq.REP)
    socket.bind(f"tcp://127.0.0.1:{given['-port']}")
    sys.stderr.write(f"the stand-in is there: {sys.argv[1:]}\n")
    exchange = 0
    while True:
        message = json.loads(socket.recv())
        if "-record" in given:
            with open(given["-record"], "a") as file:
                file.write(json.dumps(message) + "\n")
        if message.get("quitApplication"):
            return
        if exchange == 0:
            reply = {"isFinished": False, "reward": 0.0, "image": [], "timeFeature": -1.0,
                     "logDict": "null"}  # fmt: skip
        else:
            reply = game.answer(message)
        answer = json.dumps(reply).encode()
        once = Path(given["-once"]) if "-once" in given else None
        if exchange == int(number) and (once is None or claimed(once)):
            answer = misbehave(fault, socket, reply)
        exchange += 1
        socket.send(answer)


if __name__ == "__main__":
    main()
