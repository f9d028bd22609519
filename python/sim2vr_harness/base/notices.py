"""Notices that work takes long, for programs that ask for them; a library says nothing."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["SLOW_S", "noticed", "set_notice"]

SLOW_S = 2.0
"""Work that takes longer gets a notice."""

_notice: Callable[[str], None] | None = None


def set_notice(notice: Callable[[str], None] | None) -> None:
    """Have a function called with a sentence once work takes long; None for no notices."""
    global _notice
    _notice = notice


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
