"""Stopwatch: wall time and processor time of the parts of a stage."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass
class PartTime:
    """Time of a part of a stage.

    Attributes:
        seconds: of wall time.
        cpu_seconds: of all threads of this process.
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0


@dataclass
class Stopwatch:
    """Adds up the time of parts that alternate.

    Attributes:
        parts: their times, in the order of their first turns.
    """

    parts: dict[str, PartTime] = field(default_factory=dict)
    _now: str = "preparing"
    _began: float = field(default_factory=time.monotonic)
    _cpu_began: float = field(default_factory=time.process_time)

    def begin(self, part: str) -> None:
        """Count what follows as this part's; to be called as often as one likes."""
        if part == self._now:
            return
        self.stop()
        self._now = part

    def stop(self) -> None:
        """Count what has been."""
        now, cpu = time.monotonic(), time.process_time()
        part = self.parts.setdefault(self._now, PartTime())
        part.seconds += now - self._began
        part.cpu_seconds += cpu - self._cpu_began
        self._began, self._cpu_began = now, cpu
