"""Child processes: started, watched, quoted in errors, and never left behind."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from processes import emptied, group, until
from processes import gone as removed
from sim2vr_harness.client import AppDied, AppProcess, AppRefused, AppTimeout

SLEEPER = 'trap "" TERM\necho ready\nsleep 600 & wait'  # deaf to SIGTERM, with a child of its own


def script(folder: Path, text: str) -> Path:
    file = folder / "app.sh"
    file.write_text(f"#!/bin/sh\n# {folder}\n{text}\n")
    file.chmod(0o755)
    return file


def gone(pid: int, within_s: float = 10.0) -> bool:
    def ended() -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] == "Z"
        except OSError:
            return True

    return until(ended, within_s)


def test_a_stubborn_process_is_killed_with_its_children(tmp_path: Path) -> None:
    process = AppProcess([script(tmp_path, SLEEPER)])
    process.wait_for_output(re.compile("ready"), 10.0)
    assert process.running
    assert len(group(process.pid)) == 2
    log = process.log_file
    process.stop(grace_s=0.1)
    assert process.exit_status == -signal.SIGKILL
    assert emptied(process.pid)
    assert not log.exists()
    process.stop()  # idempotent
    process.kill()


DAEMON = """
import os, sys, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.setsid()
        with open(sys.argv[1] + ".new", "w") as file:
            file.write(str(os.getpid()))
        os.rename(sys.argv[1] + ".new", sys.argv[1])
        print("there", flush=True)
        time.sleep(600)
    os._exit(0)
time.sleep(float(sys.argv[2]))
"""
"""Leaves a grandchild in a session of its own, as daemons do."""


@pytest.mark.parametrize("stays_s", [0, 600])
def test_a_daemon_that_an_app_has_started_ends_with_it(tmp_path: Path, stays_s: int) -> None:
    noted = tmp_path / "pid"
    other = AppProcess([sys.executable, "-c", DAEMON, str(tmp_path / "other"), "600"])
    process = AppProcess([sys.executable, "-c", DAEMON, str(noted), str(stays_s)])
    assert until((tmp_path / "pid").exists) and until((tmp_path / "other").exists)
    pid, others = int(noted.read_text()), int((tmp_path / "other").read_text())
    assert os.getsid(pid) == pid
    process.kill()
    assert gone(pid)
    assert not gone(others, 0.0)  # of another app
    other.kill()
    assert gone(others)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("echo one >&2; exit 3", AppDied, r"app\.sh .*ended with exit status 3 .*log: LOG\none$"),
        ("echo 'it: got none' >&2; exit 2", AppRefused, r"refused its arguments: it: got none"),
        ("sleep 600", AppTimeout, r"was not ready within 0\.5 s"),
    ],
)
def test_a_start_that_fails_is_told_with_the_end_of_the_log(
    tmp_path: Path, text: str, error: type[Exception], words: str
) -> None:
    process = AppProcess([script(tmp_path, text)])
    with pytest.raises(error) as raised:
        process.wait_for_output(re.compile("listening"), 0.5)
    process.kill()
    assert re.search(words.replace("LOG", re.escape(str(process.log_file))), str(raised.value))
    assert process.log_file.exists() == (error is not AppRefused)
    process.log_file.unlink(missing_ok=True)


def test_what_is_no_program_is_refused(tmp_path: Path) -> None:
    for name, message in (("plain.txt", "may not be executed; run: chmod"), ("none", "is no file")):
        (tmp_path / "plain.txt").touch()
        with pytest.raises(AppRefused, match=message):
            AppProcess([tmp_path / name])


def test_a_process_outlives_the_thread_that_started_it(tmp_path: Path) -> None:
    made: list[AppProcess] = []
    thread = threading.Thread(
        target=lambda: made.append(AppProcess([script(tmp_path, "sleep 600")]))
    )
    thread.start()
    thread.join()
    time.sleep(0.2)
    assert made[0].running
    made[0].kill()


STARTER = """
import re, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
from sim2vr_harness.client.process import AppProcess
process = AppProcess([sys.argv[1]])
process.wait_for_output(re.compile("ready"), 10.0)
daemon = AppProcess([sys.executable, "-c", *sys.argv[2:]])
daemon.wait_for_output(re.compile("there"), 10.0)
print(process.pid, flush=True)
{end}
"""
ENDS: dict[str, tuple[str, Callable[[int], None] | None]] = {
    "exception": ("raise RuntimeError('x')", None),
    "Ctrl-C": ("time.sleep(600)", lambda pid: os.kill(pid, signal.SIGINT)),
    "SIGTERM": ("time.sleep(600)", lambda pid: os.kill(pid, signal.SIGTERM)),
    "SIGKILL": ("time.sleep(600)", lambda pid: os.kill(pid, signal.SIGKILL)),
}


@pytest.mark.parametrize("end", ENDS)
def test_no_process_is_left_however_its_starter_ends(tmp_path: Path, end: str) -> None:
    code, act = ENDS[end]
    noted = tmp_path / "daemon"
    words = [STARTER.format(end=code), script(tmp_path, SLEEPER), DAEMON, noted, "600"]
    starter = subprocess.Popen(
        [sys.executable, "-c", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert starter.stdout is not None
    pid = int(starter.stdout.readline())
    folders = list(tmp_path.glob(f"sim2vr-{starter.pid}-*"))
    if act is not None:  # else the starter may have ended already, and its folder with it
        (folder,) = folders
        assert list(folder.glob("*/group"))
        act(starter.pid)
    starter.communicate(timeout=30)
    assert gone(pid)
    assert emptied(pid, 5.0)
    assert gone(int(noted.read_text()))
    assert all(removed(folder) for folder in folders)
