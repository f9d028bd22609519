"""Parts of an audit in several processes; their number changes no result."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from typing import TypeVar

from sim2vr_harness.base.cores import available

T = TypeVar("T")

_do: Callable[[int], object] = int
"""What the processes do; they are forked with it, as bodies cannot be sent."""


def _part(number: int) -> object:
    return _do(number)


def _quiet() -> None:
    """Leave signals to the first process, which ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Parts:
    """Runs a function for some numbers.

    Args:
        processes: How many at most; 0: one per core.
    """

    def __init__(self, processes: int = 0) -> None:
        self._processes = processes or available()

    def run(self, function: Callable[[int], T], numbers: Sequence[int]) -> list[T]:
        """Return what the function returns for each of the numbers, in order."""
        count = min(self._processes, len(numbers))
        if count < 2:
            return [function(number) for number in numbers]
        global _do
        _do = function
        with multiprocessing.get_context("fork").Pool(count, _quiet) as pool:
            found: list[T] = pool.map(_part, numbers, chunksize=1)  # type: ignore[arg-type]
            pool.close()
            pool.join()
        return found
