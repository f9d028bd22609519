"""Measure an unmodified OpenXR program: steps per second, start, equal pictures.

Starts the program once per run, plays the same devices each time, and prints a JSON row: steps per
second and seconds until the first picture of every run, processor time of the program per step,
and a hash of all pictures. Equal hashes mean that the program is deterministic.

Run: python tools/bench/openxr.py --steps 2000 --runs 5 -- hello_xr -g Vulkan2
Ends with status 1 if hashes differ or a run is slower than --fail-below steps per second; with 2
if the program cannot be played.
"""

import argparse
import hashlib
import json
import os
import struct
import sys
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim2vr_harness.client import DevicePoses
from sim2vr_harness.client.base import UInt8Array
from sim2vr_harness.client.devices import INPUT_COUNT
from sim2vr_harness.client.errors import AppError, AppRefused
from sim2vr_harness.client.openxr.app import OPENXR
from sim2vr_harness.client.transport import AppPlace, AppsWanted

TRIGGER = 0
"""Column of the trigger in a row of inputs."""
FRAME_RATE_HZ = 72


@dataclass(frozen=True)
class Run:
    """One start of the program."""

    steps_per_s: float
    start_s: float
    program_ms_per_step: float
    pictures: str


def poses_of(step: int) -> DevicePoses:
    """Devices that turn and move a little, and press the right trigger now and then."""
    half = 0.15 * np.sin(0.05 * step)
    inputs = np.zeros(INPUT_COUNT)
    inputs[TRIGGER] = 1.0 if step % 50 < 10 else 0.0
    lift = 0.05 * np.sin(0.1 * step)
    return DevicePoses(
        head=np.array([0.0, 1.6, 0.0, 0.0, np.sin(half), 0.0, np.cos(half)]),
        left_controller=np.array([-0.2, 1.3 + lift, 0.4, 0.0, 0.0, 0.0, 1.0]),
        right_controller=np.array([0.2, 1.3 - lift, 0.4, 0.0, 0.0, 0.0, 1.0]),
        right_inputs=inputs,
    )


def program_s() -> float:
    """Processor time of this process's children, as long as they live."""
    ticks = 0
    for thread in Path("/proc/self/task").iterdir():
        for child in (thread / "children").read_text().split():
            fields = Path("/proc", child, "stat").read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def play(wanted: AppsWanted, steps: int, picture: Path | None) -> Run:
    """Start the program of every user and play; steps of all count, pictures of the first."""
    source = OPENXR.apps(wanted)
    apps = [source(user, None) for user in range(wanted.n)]
    try:
        began = time.perf_counter()
        for app in apps:
            app.reset(0, poses_of(0))
        start_s = (time.perf_counter() - began) / wanted.n
        pictures = hashlib.sha256()
        poses = [poses_of(step) for step in range(1, steps + 1)]
        period_ns = 1_000_000_000 // FRAME_RATE_HZ
        busy_s, began = program_s(), time.perf_counter()
        for step, devices in enumerate(poses, 1):
            for app in apps:
                app.start_step(np.array([step * period_ns]), DevicePoses.stack([devices]))
            for app in apps:
                app.finish_step()
            pictures.update(apps[0].image.tobytes())
        seconds, busy_s = time.perf_counter() - began, program_s() - busy_s
        if picture is not None:
            write_png(picture, apps[0].image)
    finally:
        for app in apps:
            app.close()
    done = steps * wanted.n
    return Run(done / seconds, start_s, 1e3 * busy_s / done, pictures.hexdigest()[:16])


def write_png(file: Path, image: UInt8Array) -> None:
    """Write the eyes side by side, and below them their depth (white: far)."""
    eyes = image if image.ndim == 4 else image[None]
    rows = np.concatenate(list(eyes), axis=1)
    rows = np.concatenate([rows[..., :3], np.repeat(rows[..., 3:], 3, axis=2)])
    raw = b"".join(b"\0" + row.tobytes() for row in rows)
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", rows.shape[1], rows.shape[0], 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(raw)),
        (b"IEND", b""),
    ]
    data = b"\x89PNG\r\n\x1a\n"
    for kind, body in parts:
        data += struct.pack(">I", len(body)) + kind + body
        data += struct.pack(">I", zlib.crc32(kind + body))
    file.write_bytes(data)


def arguments_of(words: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", nargs="+", help="program and its arguments, after --")
    parser.add_argument("--steps", type=int, default=2000, help="steps of a run (default 2000)")
    parser.add_argument("--runs", type=int, default=5, help="starts of the program (default 5)")
    parser.add_argument("--users", type=int, default=1, help="how many play at once (default 1)")
    parser.add_argument("--width", type=int, default=120)
    parser.add_argument("--height", type=int, default=80)
    parser.add_argument("--eyes", type=int, choices=(1, 2), default=2)
    parser.add_argument("--depth", action="store_true", help="the user sees depth")
    parser.add_argument("--xvfb", action="store_true", help="on an X server without a screen")
    parser.add_argument("--virtual-clock", action="store_true", help="its clocks are virtual")
    parser.add_argument(
        "--option", action="append", default=[], metavar="NAME=VALUE", help="of the transport"
    )
    parser.add_argument("--png", type=Path, help="file for the last picture of the first run")
    parser.add_argument("--fail-below", type=float, default=0.0, help="steps per second")
    parsed = parser.parse_args(words)
    for option in parsed.option:
        if "=" not in option:
            parser.error(f"--option: got {option!r}, expected NAME=VALUE")
    for name in ("steps", "runs", "users"):
        if getattr(parsed, name) < 1:
            parser.error(f"--{name}: got {getattr(parsed, name)}, expected at least 1")
    return parsed


def main(words: Sequence[str] | None = None) -> int:
    """Play, print the row, and return the exit status."""
    parsed = arguments_of(words)
    switches = {"xvfb": parsed.xvfb, "virtual_clock": parsed.virtual_clock}
    options = {"ahead": "false"} | {name: "true" for name, on in switches.items() if on}
    options |= dict(option.split("=", 1) for option in parsed.option)
    wanted = AppsWanted(
        n=parsed.users,
        game="",
        width=parsed.width,
        height=parsed.height,
        eyes=parsed.eyes,
        depth=parsed.depth,
        place=AppPlace(
            executable=parsed.program[0], arguments=tuple(parsed.program[1:]), options=options
        ),
    )
    try:
        runs = [play(wanted, parsed.steps, None if k else parsed.png) for k in range(parsed.runs)]
    except (AppError, AppRefused) as error:
        print(error, file=sys.stderr)
        return 2
    rates = [run.steps_per_s for run in runs]
    equal = len({run.pictures for run in runs}) == 1
    row = {
        "program": " ".join([Path(parsed.program[0]).name, *parsed.program[1:]]),
        "image": [parsed.eyes, parsed.height, parsed.width],
        "users": parsed.users,
        "steps": parsed.steps,
        "steps_per_s": [round(rate) for rate in rates],
        "start_s": [round(run.start_s, 2) for run in runs],
        "program_ms_per_step": round(float(np.mean([r.program_ms_per_step for r in runs])), 3),
        "load": round(os.getloadavg()[0], 1),
        "equal_pictures": equal,
        "pictures": sorted({run.pictures for run in runs}),
    }
    print(json.dumps(row))
    return 0 if equal and min(rates) >= parsed.fail_below else 1


if __name__ == "__main__":
    sys.exit(main())
