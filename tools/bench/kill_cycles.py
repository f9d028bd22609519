"""Kills the apps of a running training, again and again: nothing may hang or be left behind.

A short training runs in a child process; this one looks for its apps and ends one of them in every
cycle: killed (SIGKILL), crashed (SIGSEGV) or stopped (SIGSTOP: it hangs). Ends with status 0 when
the training went on after the last cycle, ended when it was asked to, and left no process.
Failures of apps that were only starting are not told: another start follows.

Run: python tools/bench/kill_cycles.py --cycles 50
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TRAINING = """
import sys
from pathlib import Path
from sim2vr_harness.training import trainer
from sim2vr_harness.training.config import load_config
config = load_config("whacamole_constrained", sys.argv[3:])
trainer.train(config, Path(sys.argv[1]), timesteps=int(sys.argv[2]))
"""
ENDS = (signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP)


def children(pid: int) -> list[int]:
    """Child processes of all threads of a process."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            found += [int(child) for child in (task / "children").read_text().split()]
        except OSError:
            continue
    return found


def state(pid: int) -> str:
    """One letter: R, S, T (stopped), Z (zombie); empty when there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0]
    except OSError:
        return ""


def steps_taken(run: Path) -> int:
    """User steps that the training has logged."""
    try:
        return int(json.loads((run / "metrics.jsonl").read_text().splitlines()[-1])["step"])
    except (OSError, IndexError):
        return 0


def start(run: Path, stop: int, protocol: int) -> subprocess.Popen[bytes]:
    """A training of 2 users in 2 apps, small enough for many iterations."""
    settings = [
        *("ppo.n_envs=2", "ppo.n_steps=100", "ppo.batch_size=100", "ppo.n_epochs=1"),
        *("policy.net_arch=[16]", "device=cpu", "checkpoint.every_steps=2000"),
        *(f"env.app.transport=protocol{protocol}", "env.app.processes=2"),
        *("env.app.timeout_s=1.0", "env.app.start_timeout_s=5.0"),
        "env.app.options.round_seconds=5.0",
    ]
    command = [sys.executable, "-c", TRAINING, str(run), str(stop), *settings]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def cycles(training: subprocess.Popen[bytes], wanted: int, seen: set[int]) -> int:
    """Ends an app in each cycle and waits until another one has taken its place."""
    rng, done = random.Random(0), 0
    while done < wanted and training.poll() is None:
        apps = [pid for pid in children(training.pid) if state(pid) in ("R", "S", "D")]
        seen |= set(apps)
        if len(apps) < 2:
            time.sleep(0.02)
            continue
        time.sleep(rng.uniform(0.0, 0.3))
        victim = rng.choice(apps)
        try:
            os.kill(victim, ENDS[done % len(ENDS)])
        except ProcessLookupError:
            continue
        deadline = time.monotonic() + 120.0
        while state(victim) != "" and training.poll() is None:
            if time.monotonic() > deadline:
                sys.exit(f"process {victim} was not cleared away within 120 s")
            time.sleep(0.02)
        done += 1
        if done % 10 == 0:
            print(f"{done} apps ended", flush=True)
    return done


def main() -> None:
    """Run the cycles for each protocol."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=50)
    parser.add_argument("--protocol", type=int, choices=(1, 2), help="only this one")
    given = parser.parse_args()
    for protocol in (1, 2) if given.protocol is None else (given.protocol,):
        with tempfile.TemporaryDirectory() as folder:
            check(Path(folder) / "run", given.cycles, protocol)


def check(run: Path, wanted: int, protocol: int) -> None:
    """One training with its cycles; exits with status 1 when something is wrong."""
    began = time.monotonic()
    training = start(run, 10_000_000, protocol)
    seen: set[int] = set()
    try:
        done = cycles(training, wanted, seen)
        steps_then = steps_taken(run)
        deadline = time.monotonic() + 120.0
        while steps_taken(run) < steps_then + 600:  # three more iterations, undisturbed
            if training.poll() is not None or time.monotonic() > deadline:
                sys.exit("the training does not go on after the last cycle")
            time.sleep(0.1)
        seen |= set(children(training.pid))
        training.send_signal(signal.SIGTERM)  # SIGINT is ignored where this runs in the background
        status = training.wait(120)
    finally:
        training.kill()
        training.wait()
    time.sleep(0.5)
    left = [pid for pid in seen if state(pid) != ""]
    session = json.loads((run / "run.json").read_text())["sessions"][-1]
    told = len(session.get("app_failures", []))
    row = {
        "protocol": protocol,
        "cycles": done,
        "failures_told": told,
        "steps": steps_taken(run),
        "seconds": round(time.monotonic() - began, 1),
        "exit_status": status,
        "session": session["status"],
        "left_behind": left,
    }
    print(json.dumps(row), flush=True)
    if left or status != 0 or done < wanted:
        sys.exit(1)


if __name__ == "__main__":
    main()
