"""What this process and those below it take: processor time and memory, as the system tells."""

from __future__ import annotations

import os
import time
from pathlib import Path

__all__ = ["cpu_seconds", "descendants_memory_mb", "peak_memory_mb"]


def cpu_seconds() -> float:
    """Processor time that this process and its living descendants have used, all threads."""
    ticks_per_s = os.sysconf("SC_CLK_TCK")
    total_s = time.process_time()
    for pid in _descendants():
        try:
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(") ")[2]
        except OSError:  # ended meanwhile
            continue
        user, system = fields.split()[11:13]
        total_s += (int(user) + int(system)) / ticks_per_s
    return total_s


def peak_memory_mb() -> float | None:
    """Peak of this process's resident memory; None where the system does not tell.

    From the process's own status: ``getrusage`` would count the memory of the process that it was
    forked from, too.
    """
    try:
        with open("/proc/self/status", encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("VmHWM:"):
                    return int(line.split()[1]) / 1024
    except OSError:
        pass
    return None


def descendants_memory_mb() -> float | None:
    """Memory of the processes below this one; pages they share are divided among them.

    None where the system does not tell, or there are none.
    """
    total_kb, found = 0, False
    for pid in _descendants():
        try:
            rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8")
        except OSError:  # ended meanwhile
            continue
        found = True
        lines = [line.split() for line in rollup.splitlines()]
        total_kb += sum(int(line[1]) for line in lines if line[0] == "Pss:")
    return total_kb / 1024 if found else None


def _descendants() -> list[str]:
    """Identifiers of the processes below this one."""
    found: list[str] = []
    waiting = [str(os.getpid())]
    while waiting:
        children: list[str] = []
        for file in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            try:
                children += file.read_text(encoding="utf-8").split()
            except OSError:
                continue
        found += children
        waiting += children
    return found
