"""Processes of this machine, for tests of what must not outlive others."""

import time
from pathlib import Path

__all__ = ["emptied", "gone", "group", "of_type"]


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


def emptied(number: int, within_s: float = 10.0) -> bool:
    """Whether all processes of a group are gone; init takes its time to bury the orphans."""
    deadline = time.monotonic() + within_s
    while group(number):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def of_type(pid: int, kind: str) -> int:
    """Process of a browser's group that does one thing: ``renderer``, ``gpu-process``."""
    for number in group(pid):
        command = Path(f"/proc/{number}/cmdline").read_bytes().replace(b"\0", b" ")
        if f"--type={kind}".encode() in command:
            return number
    raise AssertionError(f"no {kind} in {group(pid)}")


def gone(file: Path, within_s: float = 5.0) -> bool:
    """Whether a file or folder is gone; the watcher of a killed process takes its time."""
    deadline = time.monotonic() + within_s
    while file.exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True
