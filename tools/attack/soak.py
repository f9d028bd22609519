"""Many exchanges with sim2vr-app over each transport: does the memory of either side grow?

Prints one JSON line per interval: exchanges so far, rate, resident memory of this process and of
the app's (MiB), open file descriptors. Every 1000 exchanges it also saves, loads and hashes the
state. Ends with status 1 when, after the first tenth, either side's memory has grown by more than
``--allow`` MiB.

Run: python tools/attack/soak.py --exchanges 100000
"""

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

INTERVALS = 20


def resident_mib(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def app_pid() -> int:
    """The app: this process's only child."""
    texts = [file.read_text() for file in Path("/proc/self/task").glob("*/children")]
    (pid,) = [int(child) for text in texts for child in text.split()]
    return pid


def poses(frame: int) -> DevicePoses:
    """A hand that circles in front of a resting head."""
    turn = 0.1 * frame
    head = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
    hand = [0.15 + 0.2 * np.sin(turn), 1.07 + 0.2 * np.cos(1.3 * turn), 0.4, 0.0, 0.0, 0.0, 1.0]
    return DevicePoses(head, np.array(hand))


def soak(app: AppClient, transport: str, exchanges: int) -> list[tuple[float, float]]:
    """Plays rounds; returns (own, app's) memory at the end of each interval, MiB."""
    pid, memory = app_pid(), []
    frame, over, seed = 0, True, 0
    began, interval = time.perf_counter(), max(1, exchanges // INTERVALS)
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
        if exchange % interval == 0:
            memory.append((resident_mib(os.getpid()), resident_mib(pid)))
            row = {
                "transport": transport,
                "exchanges": exchange,
                "rounds": seed,
                "exchanges_per_s": round(interval / (time.perf_counter() - began), 1),
                "client_mib": round(memory[-1][0], 1),
                "app_mib": round(memory[-1][1], 1),
                "client_descriptors": len(os.listdir("/proc/self/fd")),
                "app_descriptors": len(os.listdir(f"/proc/{pid}/fd")),
                "state_hash": f"{app.state_hash():016x}",
            }
            print(json.dumps(row), flush=True)
            began = time.perf_counter()
    return memory


def main() -> int:
    """Soak each transport; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--exchanges", type=int, default=100_000, help="per transport")
    parser.add_argument("--transport", nargs="+", default=["protocol1", "protocol2"])
    parser.add_argument("--allow", type=float, default=8.0, help="growth that is forgiven, MiB")
    given = parser.parse_args()
    flat = True
    for transport in given.transport:
        config = EnvConfig(app=AppConfig.model_validate({"transport": transport}))
        app = app_factory(config, 1)(config, 0, None)
        try:
            memory = soak(app, transport, given.exchanges)
        finally:
            app.close()
        start, end = memory[len(memory) // 10], memory[-1]
        growth = [round(after - before, 1) for before, after in zip(start, end, strict=True)]
        print(f"{transport}: grown by {growth[0]} MiB (client) and {growth[1]} MiB (app)")
        flat &= max(growth) <= given.allow
    return 0 if flat else 1


if __name__ == "__main__":
    sys.exit(main())
