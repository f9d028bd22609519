"""Ends the apps of a running training, again and again: nothing may hang or be left behind.

A short training runs in a child process; in every cycle one of its apps is killed (SIGKILL),
crashed (SIGSEGV) or stopped (SIGSTOP: it hangs). Ends with status 0 when the training went on after
the last cycle, ended when it was asked to, and left no process.

Run: python tools/attack/kill_cycles.py --cycles 50
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

TRAINING = """
import sys
from pathlib import Path
from sim2vr_harness.training.run import trainer
from sim2vr_harness.runs.config import load_config
trainer.train(load_config("whacamole_constrained", sys.argv[2:]), Path(sys.argv[1]))
"""
SETTINGS = (
    *("ppo.n_envs=2", "ppo.n_steps=100", "ppo.batch_size=100", "ppo.n_epochs=1"),
    *("policy.net_arch=[16]", "device=cpu", "checkpoint.every_steps=2000"),
    *("env.app.processes=2", "env.app.timeout_s=1.0", "env.app.start_timeout_s=5.0"),
    "env.app.options.round_seconds=5.0",
)
ENDS = (signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP)


def children(pid: int) -> list[int]:
    """Child processes of all threads of a process."""
    texts = [file.read_text() for file in Path(f"/proc/{pid}/task").glob("*/children")]
    return [int(child) for text in texts for child in text.split()]


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


def wait_until(what: str, holds: Callable[[], bool], limit_s: float = 120.0) -> None:
    """Ends this program with a sentence when ``holds()`` stays false."""
    deadline = time.monotonic() + limit_s
    while not holds():
        if time.monotonic() > deadline:
            sys.exit(f"not within {limit_s:g} s: {what}")
        time.sleep(0.02)


def end_one(training: subprocess.Popen[bytes], how: signal.Signals, seen: set[int]) -> None:
    """Ends one of the two apps and waits until it is cleared away."""
    apps: list[int] = []

    def both_run() -> bool:
        apps[:] = [pid for pid in children(training.pid) if state(pid) in ("R", "S", "D")]
        seen.update(apps)
        return len(apps) > 1 or training.poll() is not None

    wait_until("two apps run", both_run)
    time.sleep(random.uniform(0.0, 0.3))
    victim = random.choice(apps)
    os.kill(victim, how)
    wait_until(f"process {victim} is cleared away", lambda: state(victim) == "")


def check(run: Path, cycles: int, transport: str) -> bool:
    """One training with its cycles; returns whether all was well."""
    command = [
        sys.executable,
        "-c",
        TRAINING,
        str(run),
        *SETTINGS,
        f"env.app.transport={transport}",
    ]
    training = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    seen: set[int] = set()
    try:
        for cycle in range(cycles):
            end_one(training, ENDS[cycle % len(ENDS)], seen)
        enough = steps_taken(run) + 600  # three more iterations, undisturbed
        wait_until("three more iterations", lambda: steps_taken(run) >= enough)
        seen |= set(children(training.pid))
        training.send_signal(signal.SIGTERM)
        status = training.wait(120)
    finally:
        training.kill()
        training.wait()
    time.sleep(0.5)
    left = [pid for pid in seen if state(pid) != ""]
    session = json.loads((run / "run.json").read_text())["sessions"][-1]
    row = {
        "transport": transport,
        "cycles": cycles,
        "failures_reported": len(session.get("app_failures", [])),
        "steps": steps_taken(run),
        "exit_status": status,
        "session": session["status"],
        "left_behind": left,
    }
    print(json.dumps(row), flush=True)
    return not left and status in (0, 130)


def main() -> int:
    """Run the cycles over each transport; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cycles", type=int, default=50)
    parser.add_argument("--transport", nargs="+", default=["protocol1", "protocol2"])
    given = parser.parse_args()
    random.seed(0)
    with tempfile.TemporaryDirectory() as folder:
        fine = [check(Path(folder) / name, given.cycles, name) for name in given.transport]
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
