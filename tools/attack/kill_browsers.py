"""Kills programs that play pages or OpenXR programs: no process and no folder may be left.

``evaluate`` and a plain Python program play a page, or with ``--openxr`` an OpenXR program with an
X server of its own, whose lock and socket must go, too; each is ended by SIGKILL or SIGTERM at a
random moment, every second one with its GPU process or the program stopped (it hangs), every third
one just after one of its app's processes was killed. Prints one JSON row per kill: how long it took
to end, the processes left 5 s later, and the X sockets, folders and logs left after the next start.
The log of an app that was killed is kept on purpose. Ends with status 0 when nothing else was left.

Run: sh docs/examples/webxr/engines.sh && python tools/attack/kill_browsers.py --kills 50
     python tools/attack/kill_browsers.py --kills 50 --openxr "hello_xr -g OpenGL"
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim2vr_harness.client.temporary import outside_files

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "webxr"
LONGEST_END_S = 20.0
"""A program that takes longer to end, on a busy machine too, hangs."""
CDN = "https://cdn.jsdelivr.net/npm/"
PLAIN = """
import json, sys, numpy as np
from sim2vr_harness.client import AppPlace, AppsWanted, DevicePoses, frame_time_ns, transport_named
hand = np.array([0.15, 1.1, 0.35, 0.0, 0.0, 0.0, 1.0])
poses = DevicePoses(np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0]), None, hand)
wanted = AppsWanted(n=1, game="app", place=AppPlace(**json.loads(sys.argv[2])), depth=False)
with transport_named(sys.argv[1]).apps(wanted)(0, None) as app:
    app.reset(1, poses)
    for step in range(1, int(sys.argv[3])):
        app.step(frame_time_ns(step, 20), poses)
"""


@dataclass(frozen=True)
class App:
    """What is played.

    Attributes:
        transport: by which.
        place: fields of AppPlace.
        options: of ``evaluate``.
        marker: in the command line of the process that shows that it runs, and that is hung.
    """

    transport: str
    place: dict[str, Any]
    options: list[str]
    marker: str

    @classmethod
    def page(cls, page: Path) -> App:
        """A page of the examples."""
        engines = EXAMPLES / "engines"
        place = {"page": str(page), "map": {CDN: str(engines)}}
        options = ["--page", str(page), "--map", f"{CDN}={engines}"]
        return cls("webxr", place, options, "--type=gpu-process")

    @classmethod
    def openxr(cls, command: str) -> App:
        """An OpenXR program on an X server of its own."""
        program, *arguments = shlex.split(command)
        place = {"executable": program, "arguments": arguments, "options": {"xvfb": True}}
        return cls("openxr", place, ["--openxr", command, "--xvfb"], arguments[-1])


def command(program: str, app: App, folder: Path, steps: int) -> list[str]:
    """How a program is started that plays an app for a number of user steps."""
    if program == "python":
        words = [sys.executable, "-c", PLAIN, app.transport, json.dumps(app.place)]
        return [*words, str(steps)]
    task = folder / "task.yaml"
    task.write_text(f"seconds: {steps / 20}\n")
    words = [sys.executable, "-m", "sim2vr_harness.cli.main", "evaluate", "--user", "random"]
    words += [*app.options, "--task", str(task)]
    return [*words, "--episodes", "1", "--out", str(folder / "out"), "--overwrite"]


def same_file(file: Path, inode: int) -> bool:
    """Whether a file is there, and not one that another server has made anew."""
    with suppress(OSError):
        return file.lstat().st_ino == inode
    return False


def processes(folder: Path | None, groups: set[int]) -> dict[int, str]:
    """Command lines of the processes in the groups, or with a folder's name; no zombies."""
    found = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with suppress(OSError):
            fields = (entry / "stat").read_text().rpartition(") ")[2].split()
            words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            named = folder is not None and str(folder) in words
            if fields[0] != "Z" and (int(fields[2]) in groups or named):
                found[int(entry.name)] = words
    return found


def groups_of(folder: Path) -> set[int]:
    """Process groups of the apps whose folders are in a temporary folder."""
    numbers = [file.read_text() for file in folder.glob("sim2vr-*/*/group")]
    return {int(number) for number in numbers if number.endswith("\n")}


def wait_for_app(harness: subprocess.Popen[bytes], folder: Path, app: App) -> set[int]:
    """Wait until the app runs; returns the process groups."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and harness.poll() is None:
        groups = groups_of(folder)
        if any(app.marker in words for words in processes(None, groups).values()):
            return groups
        time.sleep(0.02)
    harness.kill()
    sys.exit("no app within 120 s")


def kill(number: int, program: str, app: App, folder: Path) -> bool:
    """One start and its kill; returns whether nothing was left."""
    environment = {**os.environ, "TMPDIR": str(folder)}
    harness = subprocess.Popen(
        command(program, app, folder, 1_000_000),
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    groups = wait_for_app(harness, folder, app)
    time.sleep(random.uniform(0.0, 4.0))
    of_app = processes(folder, groups)
    own = processes(None, groups)
    displays: dict[Path, int] = {}
    for place in folder.glob("sim2vr-*"):
        displays |= outside_files(place)
    hung = [pid for pid, words in of_app.items() if app.marker in words and pid in own]
    hung = hung if number % 2 == 0 else []
    one = random.sample(sorted(set(of_app) - {harness.pid}), 1) if number % 3 == 0 else []
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
    after_start = [] if left else left_after_a_start(app, folder, failed=bool(one))
    lasting = sorted(str(file) for file, inode in displays.items() if same_file(file, inode))
    row = {
        "kill": number,
        "program": program,
        "by": how.name,
        "hung": bool(hung),
        "killed_before": [of_app[pid][:60] for pid in one],
        "exit_status": harness.poll(),
        "seconds": round(seconds, 1),
        "processes_left": [words[:80] for words in left.values()],
        "displays": len(displays),
        "displays_left": lasting,
        "folders_left": after_start,
    }
    print(json.dumps(row), flush=True)
    harness.kill()
    harness.wait()
    for pid in left:  # of this kill only
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return not (left or lasting or row["folders_left"]) and row["exit_status"] is not None


def left_after_a_start(app: App, folder: Path, *, failed: bool) -> list[str]:
    """Play three steps undisturbed; returns what is in the temporary folder afterwards.

    Args:
        app: to play.
        folder: the temporary folder.
        failed: whether an app was killed before, whose log is kept.
    """
    environment = {**os.environ, "TMPDIR": str(folder)}
    subprocess.run(command("python", app, folder, 3), env=environment, check=True)
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
    parser.add_argument("--openxr", help="play this OpenXR program instead of a page")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    app = App.page(given.page.resolve()) if given.openxr is None else App.openxr(given.openxr)
    fine = 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.kills):
            program = ("evaluate", "python")[number // 4 % 2]
            fine += kill(number, program, app, Path(folder))
    print(json.dumps({"kills": given.kills, "nothing_left": fine}))
    return 0 if fine == given.kills else 1


if __name__ == "__main__":
    sys.exit(main())
