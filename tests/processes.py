"""Processes of this machine, for tests of what must not outlive others."""

from __future__ import annotations

import time
from pathlib import Path

__all__ = ["emptied", "group"]


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
