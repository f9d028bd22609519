"""Programs that the tests play: unmodified ones, and some that speak as the runtime inside them."""

import json
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from parts import missing
from sim2vr_harness.client import (
    AppPlace,
    AppRefused,
    AppsWanted,
    DevicePoses,
    OpenXRApp,
    transport_named,
)
from sim2vr_harness.client.openxr.runtime_files import find_runtime

SPEAKER = r"""
import json, mmap, os, socket, struct, sys, time

sock = socket.socket(fileno=int(os.environ["SIM2VR_OPENXR_SOCKET"]))

def send(kind, body=b"", files=()):
    message = struct.pack("<IB", len(body) + 1, kind) + body
    sent = socket.send_fds(sock, [message], files) if files else 0
    sock.sendall(message[sent:])

def take(count):
    got = b""
    while len(got) < count:
        part = sock.recv(count - len(got))
        if not part:
            sys.exit(0)
        got += part
    return got

def receive():
    length, kind = struct.unpack("<IB", take(5))
    return kind, take(length - 1)

def say(kind, files=(), **what):
    send(kind, json.dumps(what).encode(), files)

def hello():
    say(1, protocol=2, runtime_version="0", application="fake", application_version=1, engine="",
        engine_version=0, api_version="1.1.49", extensions=[], pid=os.getpid())
    kind, body = receive()
    assert kind == 2, kind
    return json.loads(body)

def session(config, graphics="egl", depth=True):
    size = config["eyes"] * config["height"] * config["width"] * 4
    file = os.memfd_create("sim2vr-fake")
    os.ftruncate(file, size)
    memory = mmap.mmap(file, size)
    say(3, [file], graphics=graphics, depth_layers=depth, image_bytes=size)
    os.close(file)  # the harness has it from the socket
    kind, body = receive()
    if kind == 9:
        sys.exit(3)
    assert kind == 4, kind
    return memory

FRAME = struct.Struct("<q7dBB7d7d13d13d")

def step():
    kind, body = receive()
    if kind == 7:
        say(8, reason="", call="xrDestroySession")
        sys.exit(0)
    assert kind == 5, kind
    count, = struct.unpack_from("<I", body)
    assert len(body) == 4 + count * FRAME.size + 1
    frames = [FRAME.unpack_from(body, 4 + k * FRAME.size) for k in range(count)]
    return frames, body[-1]

def answer(frames, image, events=(), has_depth=True, layers=1):
    text = json.dumps({"events": list(events), "should_render": True, "layers": layers}).encode()
    send(6, struct.pack("<IBBI", len(frames), image, has_depth and image, len(text)) + text)
"""
"""The channel; the same in every program."""

PLAY = r"""
config = hello()
memory = session(config)
shown = hits = 0
while True:
    frames, image = step()
    shown += len(frames)
    time_ns, head, tracked = frames[-1][0], frames[-1][1:8], frames[-1][8:10]
    right, trigger = frames[-1][17:24], frames[-1][37]
    events = []
    if trigger > 0.5:
        hits += 1
        events = [dict(kind="haptic", hand="right", amplitude=0.5, frequency_hz=0,
                       duration_ns=20_000_000, time_ns=time_ns),
                  dict(kind="label", text=f"hits {hits}", time_ns=time_ns)]
        print(f"score: {10 * hits}", flush=True)
        print("target at 0.1 1.25 -0.5", flush=True)
    if image:
        for eye in range(config["eyes"]):
            part = bytes([shown % 256, int(100 * right[1]) % 256, eye, 128])
            size = config["height"] * config["width"]
            memory[eye * size * 4 : (eye + 1) * size * 4] = part * size
    answer(frames, image, events)
"""
"""Counts frames in red, the right hand's height in cm in green, the eye in blue."""


def program(folder: Path, body: str = PLAY, name: str = "fake.py") -> Path:
    """Write a program that does ``body``."""
    file = folder / name
    file.write_text(f"#!{sys.executable}\n{SPEAKER}\n{body}")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    return file


def manifest(folder: Path) -> Path:
    """A manifest of a runtime that none of these programs loads."""
    (folder / "libnone.so").touch()
    file = folder / "runtime.json"
    file.write_text(json.dumps({"runtime": {"library_path": "./libnone.so"}}))
    return file


def open_program(file: Path | str, *arguments: str, **settings: Any) -> OpenXRApp:
    """The app of a program; ``options`` are the transport's, others those of AppsWanted."""
    place = AppPlace(
        executable=str(file),
        arguments=arguments,
        timeout_s=settings.pop("timeout_s", 10.0),
        start_timeout_s=settings.pop("start_timeout_s", 20.0),
        options=settings.pop("options", {}),
    )
    wanted = AppsWanted(n=1, game="program", place=place, **{"width": 8, "height": 4} | settings)
    app = transport_named("openxr").apps(wanted)(0, None)
    assert isinstance(app, OpenXRApp)
    return app


def hands(height_m: float = 1.1, trigger: float = 0.0) -> DevicePoses:
    """A user with a right hand, at rest or with the trigger pulled."""
    inputs = np.zeros(13)
    inputs[0] = trigger
    head = np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0])
    hand = np.array([0.2, height_m, 0.4, 0.0, 0.0, 0.0, 1.0])
    return DevicePoses(head, hand, right_inputs=inputs)


# --- unmodified programs ---------------------------------------------------------------------

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples" / "openxr"
PYTHON = os.environ.get("SIM2VR_OPENXR_PYTHON", sys.executable)


@dataclass(frozen=True)
class Played:
    """A program, and how it is started."""

    command: tuple[str, ...]
    needs: str = ""
    depth: bool = False
    options: Mapping[str, object] = field(default_factory=dict)


QT = {"xvfb": True, "virtual_clock": True}
TOUCH, LAMPS = (str(EXAMPLES / name / f"{name}.py") for name in ("touch", "lamps"))
PROGRAMS = {
    "hello_xr, Vulkan2": Played(("hello_xr", "-g", "Vulkan2")),
    "hello_xr, Vulkan": Played(("hello_xr", "-g", "Vulkan")),
    "hello_xr, OpenGL": Played(("hello_xr", "-g", "OpenGL"), options={"xvfb": True}),
    "pyopenxr": Played((PYTHON, TOUCH, "--seed", "3"), "xr", True),
    "Qt": Played((PYTHON, LAMPS, "--seed", "3"), "PySide6", True, QT),
}


def has(module: str) -> bool:
    """Whether the programs' interpreter has a package."""
    asked = subprocess.run([PYTHON, "-c", f"import {module}"], capture_output=True, check=False)
    return asked.returncode == 0


def playable(found: Played) -> Played:
    """Skip where the program, or what it needs, is not installed."""
    try:
        find_runtime()
    except AppRefused as error:
        missing("runtime", str(error))
    if shutil.which(found.command[0]) is None:
        missing("openxr", f"no {found.command[0]} (apt-get install libopenxr-utils)")
    if found.options.get("xvfb") and shutil.which("Xvfb") is None:
        missing("openxr", "no Xvfb")
    if found.needs and not has(found.needs):
        missing("openxr", f"no {found.needs} in the Python of SIM2VR_OPENXR_PYTHON")
    return found


def opened(played: Played, **settings: object) -> OpenXRApp:
    settings = {"width": 60, "height": 40, "eyes": 2, "timeout_s": 60.0} | settings
    settings |= {"start_timeout_s": 60.0, "depth": played.depth, "options": played.options}
    return open_program(*played.command, **settings)
