"""Kills programs that play pages, again and again: no browser and no folder may be left.

``evaluate --page`` and a plain Python program play a page; each is ended by SIGKILL or SIGTERM at a
random moment, every second one with its GPU process stopped (it hangs), every third one just after
one of its browser's processes was killed. Prints one JSON row per kill: how long the program took
to end, the processes left 5 s later, and the folders and logs left after the next start. The log of
a browser that was killed is kept on purpose. Ends with status 0 when nothing else was left.

Run: sh docs/examples/webxr/engines.sh && python tools/attack/kill_browsers.py --kills 50
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
from contextlib import suppress
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "webxr"
LONGEST_END_S = 20.0
"""A program that takes longer to end, on a busy machine too, hangs."""
CDN = "https://cdn.jsdelivr.net/npm/"
PLAIN = """
import sys, numpy as np
from sim2vr_harness.client import AppPlace, AppsWanted, DevicePoses, WebXRApp, frame_time_ns
hand = np.array([0.15, 1.1, 0.35, 0.0, 0.0, 0.0, 1.0])
poses = DevicePoses(np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0]), None, hand)
place = AppPlace(page=sys.argv[1], map={sys.argv[2]: sys.argv[3]})
with WebXRApp(AppsWanted(n=1, game="page", place=place)) as app:
    app.reset(1, poses)
    for step in range(1, int(sys.argv[4])):
        app.step(frame_time_ns(step, 20), poses)
"""


def command(program: str, page: Path, folder: Path, steps: int) -> list[str]:
    """How a program is started that plays a page for a number of user steps."""
    engines = EXAMPLES / "engines"
    if program == "python":
        return [sys.executable, "-c", PLAIN, str(page), CDN, str(engines), str(steps)]
    task = folder / "task.yaml"
    task.write_text(f"seconds: {steps / 20}\n")
    words = [sys.executable, "-m", "sim2vr_harness.cli.main", "evaluate", "--user", "random"]
    words += ["--page", str(page), "--map", f"{CDN}={engines}", "--task", str(task)]
    return [*words, "--episodes", "1", "--out", str(folder / "out"), "--overwrite"]


def processes(folder: Path, groups: set[int]) -> dict[int, str]:
    """Command lines of the processes in the groups, or with the folder's name; no zombies."""
    found = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with suppress(OSError):
            fields = (entry / "stat").read_text().rpartition(") ")[2].split()
            words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            if fields[0] != "Z" and (int(fields[2]) in groups or str(folder) in words):
                found[int(entry.name)] = words
    return found


def groups_of(folder: Path) -> set[int]:
    """Process groups of the apps whose folders are in a temporary folder."""
    numbers = [file.read_text() for file in folder.glob("sim2vr-*/*/group")]
    return {int(number) for number in numbers if number.endswith("\n")}


def wait_for_browser(harness: subprocess.Popen[bytes], folder: Path) -> set[int]:
    """Wait until a browser has its GPU process; returns the process groups."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and harness.poll() is None:
        groups = groups_of(folder)
        if any("--type=gpu-process" in words for words in processes(folder, groups).values()):
            return groups
        time.sleep(0.02)
    harness.kill()
    sys.exit("no browser within 120 s")


def kill(number: int, program: str, page: Path, folder: Path) -> bool:
    """One start and its kill; returns whether nothing was left."""
    environment = {**os.environ, "TMPDIR": str(folder)}
    harness = subprocess.Popen(
        command(program, page, folder, 1_000_000),
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    groups = wait_for_browser(harness, folder)
    time.sleep(random.uniform(0.0, 4.0))
    of_browser = processes(folder, groups)
    hung = [pid for pid, words in of_browser.items() if "--type=gpu-process" in words]
    hung = hung if number % 2 == 0 else []
    one = random.sample(sorted(set(of_browser) - {harness.pid}), 1) if number % 3 == 0 else []
    for pid, how in [*((pid, signal.SIGSTOP) for pid in hung), *((p, signal.SIGKILL) for p in one)]:
        with suppress(ProcessLookupError):
            os.kill(pid, how)
    time.sleep(random.uniform(0.0, 0.3))
    how = (signal.SIGKILL, signal.SIGTERM)[number // 2 % 2]
    groups |= groups_of(folder)
    harness.send_signal(how)
    sent = time.monotonic()
    with suppress(subprocess.TimeoutExpired):
        harness.wait(LONGEST_END_S)
    seconds = time.monotonic() - sent
    time.sleep(5.0)
    left = processes(folder, groups)
    row = {
        "kill": number,
        "program": program,
        "by": how.name,
        "hung": bool(hung),
        "killed_before": [of_browser[pid][:60] for pid in one],
        "exit_status": harness.poll(),
        "seconds": round(seconds, 1),
        "processes_left": [words[:80] for words in left.values()],
        "folders_left": [] if left else left_after_a_start(page, folder, failed=bool(one)),
    }
    print(json.dumps(row), flush=True)
    harness.kill()
    harness.wait()
    for pid in left:  # of this kill only
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return not left and not row["folders_left"] and row["exit_status"] is not None


def left_after_a_start(page: Path, folder: Path, *, failed: bool) -> list[str]:
    """Play three steps undisturbed; returns what is in the temporary folder afterwards.

    Args:
        page: to play.
        folder: the temporary folder.
        failed: whether a browser was killed before, whose log is kept.
    """
    environment = {**os.environ, "TMPDIR": str(folder)}
    subprocess.run(command("python", page, folder, 3), env=environment, check=True)
    time.sleep(0.5)
    logs = [*folder.glob("sim2vr-app-logs-*/*")]
    names = [file.name for file in logs if not failed]
    for file in logs:
        file.unlink()
    made = [file.name for file in folder.glob("sim2vr-*") if "-app-logs-" not in file.name]
    return made + names


def main() -> int:
    """Kill as often as asked; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--page", type=Path, default=EXAMPLES / "buttons")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    fine = 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.kills):
            program = ("evaluate", "python")[number // 4 % 2]
            fine += kill(number, program, given.page.resolve(), Path(folder))
    print(json.dumps({"kills": given.kills, "nothing_left": fine}))
    return 0 if fine == given.kills else 1


if __name__ == "__main__":
    sys.exit(main())
