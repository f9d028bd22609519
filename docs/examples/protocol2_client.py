"""Play a second of Whac-A-Mole over protocol 2 (docs/reference/protocol.md), standing still.

Usage: sim2vr-app --port 5555 &  python protocol2_client.py tcp://127.0.0.1:5555
"""

import json
import struct
import sys

import numpy as np
import zmq

HELLO, RESET, STEP, HASH, QUIT = 1, 2, 3, 7, 8
HEADER = struct.Struct("<4sHHIIII")  # magic, version, type, sequence, count, status, flags
RESULT = struct.Struct("<IIffIIIIII")  # app, finished, reward, time feature, status, log count, ...

socket = zmq.Context.instance().socket(zmq.REQ)
socket.linger = 0
socket.rcvtimeo = 10_000  # ms; zmq.Again when the app does not answer
socket.connect(sys.argv[1])
sequence = 0


def request(kind: int, *frames: bytes, count: int = 0) -> list[bytes]:
    """Sends a message and returns the reply's frames without the header."""
    global sequence
    sequence += 1
    socket.send_multipart([HEADER.pack(b"S2VR", 3, kind, sequence, count, 0, 0), *frames])
    header, *reply = socket.recv_multipart()
    _, _, answered, number, _, status, _ = HEADER.unpack(header)
    if status != 0:
        raise RuntimeError(reply[0].decode())
    assert (answered, number) == (kind | 0x8000, sequence)
    return reply


def result(reply: list[bytes]) -> tuple[float, bool, np.ndarray, list[float]]:
    """Reward, whether the round is over, image and log values of the only app."""
    _, finished, reward, _, status, log_count, *_ = RESULT.unpack(reply[0])
    if status != 0:
        raise RuntimeError(json.loads(reply[4])[0])
    image = np.frombuffer(reply[3], np.uint8).reshape(height, width, 4)
    return reward, bool(finished), image, list(np.frombuffer(reply[1], "<f8", log_count))


head = [0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0]  # position x y z (m), rotation x y z w
hand = [0.2, 0.9, 0.3, 0.0, 0.0, 0.0, 1.0]
rest = [0.0] * 26  # triggers, buttons and the like of both controllers
poses = struct.pack("<II47d", 1 | 4, 0, *head, *[0.0] * 7, *hand, *rest)  # head, right hand
about = json.loads(request(HELLO, json.dumps({"client": "example"}).encode())[0])
width, height = about["width"], about["height"]
options = json.dumps([{"condition": "medium"}]).encode()
_, _, image, _ = result(request(RESET, struct.pack("<IIq", 0, 7, 0) + poses, options, count=1))
for step in range(1, 21):
    frame = struct.pack("<q", 50_000_000 * step) + poses  # time on the app's clock, ns
    reply = request(STEP, struct.pack("<IIiI", 0, 1, -1, 0), frame, count=1)
    reward, finished, image, log = result(reply)
state_hash = struct.unpack("<Q", request(HASH, struct.pack("<I", 0))[0])[0]
print(f"{about['server']}: reward {reward:.6f}, image {image.shape}, state {state_hash:016x}")
request(QUIT)
