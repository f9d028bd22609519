"""Processor time and memory of this process and its descendants (Linux)."""

import os
import time
from pathlib import Path


def cpu_seconds() -> float:
    """Processor time that this process and its living descendants have used, all threads, s."""
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
    """Peak of this process's resident memory, MB; None where the system does not say.

    From the process's own status: ``getrusage`` would count the memory of the process that it was
    forked from, too.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    return next((int(x.split()[1]) / 1024 for x in lines if x.startswith("VmHWM:")), None)


def _descendants() -> list[str]:
    """Identifiers of the processes below this one."""
    found: list[str] = []
    waiting = [str(os.getpid())]
    while waiting:
        for file in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            try:
                children = file.read_text(encoding="utf-8").split()
            except OSError:
                continue
            found += children
            waiting += children
    return found
