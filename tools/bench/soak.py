"""Many exchanges with sim2vr-app over each protocol: does the memory of either side grow?

Prints one JSON line per interval and protocol: exchanges so far, rate, resident memory of this
process and of the app's (MiB), open file descriptors. Every 1000 exchanges it also saves, loads and
hashes the state. Ends with status 1 when, after the first tenth, either side's memory has grown by
more than ``--allow`` MiB.

Run: python tools/bench/soak.py --exchanges 100000
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from sim2vr_harness.client import AppClient, DevicePoses, frame_time_ns
from sim2vr_harness.envs import AppConfig, EnvConfig
from sim2vr_harness.envs.apps import app_factory


def resident_mib(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def descriptors(pid: int) -> int:
    """Open file descriptors of a process."""
    return len(os.listdir(f"/proc/{pid}/fd"))


def child_pid() -> int:
    """The app: this process's only child."""
    children = [
        pid
        for task in Path("/proc/self/task").iterdir()
        for pid in (task / "children").read_text().split()
    ]
    (pid,) = children
    return int(pid)


def poses(frame: int) -> DevicePoses:
    """A hand that circles in front of a resting head."""
    turn = 0.1 * frame
    head = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
    hand = [0.15 + 0.2 * np.sin(turn), 1.07 + 0.2 * np.cos(1.3 * turn), 0.4, 0.0, 0.0, 0.0, 1.0]
    return DevicePoses(head, np.array(hand))


def soak(app: AppClient, protocol: str, exchanges: int, rows: int) -> list[tuple[float, float]]:
    """Plays rounds; returns (own, app's) memory at the end of each interval, MiB."""
    pid, memory = child_pid(), []
    frame, over, seed = 0, True, 0
    began, last = time.perf_counter(), 0
    for exchange in range(1, exchanges + 1):
        if over:
            seed, frame = seed + 1, 0
            reply = app.reset(seed, poses(0))
        else:
            frame += 1
            reply = app.step(frame_time_ns(frame, 20), poses(frame))
        over = reply.finished
        if exchange % 1000 == 0 and not over:
            before = app.state_hash()
            app.load(app.save())
            assert app.state_hash() == before
        if exchange % max(1, exchanges // rows) == 0:
            now = time.perf_counter()
            memory.append((resident_mib(os.getpid()), resident_mib(pid)))
            row = {
                "protocol": protocol,
                "exchanges": exchange,
                "rounds": seed,
                "exchanges_per_s": round((exchange - last) / (now - began), 1),
                "client_mib": round(memory[-1][0], 1),
                "app_mib": round(memory[-1][1], 1),
                "client_descriptors": descriptors(os.getpid()),
                "app_descriptors": descriptors(pid),
                "state_hash": f"{app.state_hash():016x}",
            }
            print(json.dumps(row), flush=True)
            began, last = time.perf_counter(), exchange
    return memory


def main() -> None:
    """Soak both protocols."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--exchanges", type=int, default=100_000, help="per protocol")
    parser.add_argument("--protocol", type=int, choices=(1, 2), help="only this one")
    parser.add_argument("--renderer", default="automatic")
    parser.add_argument("--rows", type=int, default=20, help="lines of output per protocol")
    parser.add_argument("--allow", type=float, default=8.0, help="growth that is forgiven, MiB")
    given = parser.parse_args()
    flat = True
    for number in (1, 2) if given.protocol is None else (given.protocol,):
        settings = {"transport": f"protocol{number}", "renderer": given.renderer}
        config = EnvConfig(app=AppConfig.model_validate(settings))
        app = app_factory(config, 1)(config, 0, None)
        try:
            memory = soak(app, f"protocol{number}", given.exchanges, given.rows)
        finally:
            app.close()
        start, end = memory[len(memory) // 10], memory[-1]
        growth = [round(after - before, 1) for before, after in zip(start, end, strict=True)]
        print(f"protocol {number}: grown by {growth[0]} MiB (client) and {growth[1]} MiB (app)")
        flat &= max(growth) <= given.allow
    sys.exit(0 if flat else 1)


if __name__ == "__main__":
    main()
