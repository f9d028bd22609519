"""Limits of texts that an app has the harness keep, and of the memory of its processes."""

import os
from collections import deque
from collections.abc import Iterator
from pathlib import Path

MOST_MEMORY_BYTES = 2 << 30
"""Memory of an app with all its processes; a page of the examples takes a tenth of it."""
MOST_KEPT = 20
MOST_CHARACTERS = 300
MOST_LISTED = 5


class Kept:
    """Texts, of which the first and the last few are kept, shortened; the others are counted."""

    def __init__(self) -> None:
        self._first: list[str] = []
        self._last: deque[str] = deque(maxlen=MOST_KEPT)
        self._count = 0

    def add(self, text: str) -> None:
        """Add a text at the end."""
        self._count += 1
        kept = self._last if len(self._first) == MOST_KEPT else self._first
        kept.append(text[:MOST_CHARACTERS])

    def clear(self) -> None:
        """Forget all texts."""
        self._first.clear()
        self._last.clear()
        self._count = 0

    def __len__(self) -> int:
        """Return the number of texts that were added, kept or not."""
        return self._count

    def __iter__(self) -> Iterator[str]:
        """Iterate over those that were kept."""
        return iter([*self._first, *self._last])

    @property
    def first(self) -> str:
        """The first; IndexError when there is none."""
        return self._first[0]

    def listed(self) -> str:
        """Return the first few different ones, sorted, and how many more texts there are."""
        different = list(dict.fromkeys(self))
        shown = different[:MOST_LISTED]
        more = len(different) - len(shown) + self._count - len([*self])
        return ", ".join(sorted(shown)) + (f" and {more} more" if more else "")

    @property
    def last(self) -> str:
        """The last; IndexError when there is none."""
        return [*self._first, *self._last][-1]


def memory_of_group(group: int) -> int:
    """Return the bytes of memory that the processes of a group have for themselves.

    Args:
        group: its process group.
    """
    total = 0
    for place in os.scandir("/proc"):
        if not place.name.isdecimal():
            continue
        try:
            if os.getpgid(int(place.name)) != group:
                continue
            for line in Path(place.path, "status").read_bytes().splitlines():
                if line.startswith((b"RssAnon:", b"RssShmem:")):
                    total += 1024 * int(line.split()[1])
        except OSError:  # it has ended
            continue
    return total
