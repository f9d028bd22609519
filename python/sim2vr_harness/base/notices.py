"""Notices for people, where the program shows them; a library says nothing."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SLOW_S = 2.0
"""Work that takes longer gets a notice."""

_notice: Callable[[str], None] | None = None
_given: set[str] = set()


def set_notice(notice: Callable[[str], None] | None) -> None:
    """Have a function called with every notice; None for no notices."""
    global _notice
    _notice = notice
    _given.clear()


def notice_once(sentence: str) -> None:
    """Give notice, unless this program has given the same one."""
    if _notice is not None and sentence not in _given:
        _given.add(sentence)
        _notice(sentence)


@contextmanager
def noticed(sentence: str) -> Iterator[None]:
    """Give notice, once, if what is done inside takes longer than `SLOW_S`."""
    if _notice is None:
        yield
        return
    timer = threading.Timer(SLOW_S, _notice, [sentence])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
