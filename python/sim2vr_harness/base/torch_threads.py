"""Context manager for torch's number of threads."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median

import torch

_TRIALS = 3
"""Pieces of work that are timed with each number of threads."""
_HOPELESS = 1.5
"""Ratio of a candidate's fastest time to the best one above which it is not timed again."""


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch use ``count`` threads within the block.

    One thread is best between simulation steps: a small batch gains nothing from more, and torch's
    waiting threads take the cores from the physics (on two busy cores, 4 times the user steps).
    """
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class FastestThreads:
    """Finds the number of torch's threads by timing the first pieces of the work itself.

    Candidates take turns, so that all of them meet the same neighbours. How many threads are
    fastest depends on what else the machine does: measure anew from time to time.

    Args:
        counts: candidates, at least one; results must not depend on which of them is used.
        clock: returns s.
    """

    def __init__(
        self, counts: Sequence[int], clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self._counts, self._clock = tuple(counts), clock
        self.measure()

    def measure(self) -> None:
        """Forget what was found; the next turns are timed again."""
        self._seconds: dict[int, list[float]] = {count: [] for count in self._counts}

    @property
    def best(self) -> int:
        """The fastest candidate so far, by the median; the first one before anything is timed."""
        timed = {count: median(each) for count, each in self._seconds.items() if each}
        return min(timed, key=lambda count: timed[count]) if timed else self._counts[0]

    @contextmanager
    def turn(self) -> Iterator[int]:
        """Use a candidate that has to be timed still, or the best one, within the block."""
        due = min(filter(self._promises, self._counts), key=lambda n: len(self._seconds[n]))
        measures = len(self._counts) > 1 and len(self._seconds[due]) < _TRIALS
        count = due if measures else self.best
        with torch_threads(count):
            began = self._clock() if measures else 0.0
            yield count
            if measures:
                self._seconds[count].append(self._clock() - began)

    def _promises(self, count: int) -> bool:
        """Return whether a candidate may still be the fastest."""
        fastest = {n: min(each) for n, each in self._seconds.items() if each}
        return fastest.get(count, 0.0) <= _HOPELESS * min(fastest.values(), default=0.0)
