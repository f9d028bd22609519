"""Processes of this machine, for tests of what must not outlive others, and ports."""

import socket
import time
from collections.abc import Callable
from pathlib import Path

__all__ = ["emptied", "free_port", "gone", "group", "of_type", "until"]


def group(pid: int) -> list[int]:
    """Processes of the group, zombies left out."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(") ")[2].split()
            except OSError:
                continue
            if int(fields[2]) == pid and fields[0] != "Z":
                found.append(int(entry.name))
    return found


def until(true: Callable[[], object], within_s: float = 60.0) -> bool:
    """Whether something becomes true in time."""
    deadline = time.monotonic() + within_s
    while not (found := true()) and time.monotonic() < deadline:
        time.sleep(0.02)
    return bool(found)


def emptied(number: int, within_s: float = 10.0) -> bool:
    """Whether all processes of a group are gone; init takes its time to bury the orphans."""
    return until(lambda: not group(number), within_s)


def of_type(pid: int, kind: str) -> int:
    """Process of a browser's group that does one thing: ``renderer``, ``gpu-process``."""
    for number in group(pid):
        command = Path(f"/proc/{number}/cmdline").read_bytes().replace(b"\0", b" ")
        if f"--type={kind}".encode() in command:
            return number
    raise AssertionError(f"no {kind} in {group(pid)}")


def gone(file: Path, within_s: float = 5.0) -> bool:
    """Whether a file or folder is gone; the watcher of a killed process takes its time."""
    return until(lambda: not file.exists(), within_s)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
