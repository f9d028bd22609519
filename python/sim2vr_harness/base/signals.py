"""Handlers that let Ctrl-C and SIGTERM stop a training, or wait until it has saved."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


@contextmanager
def sigterm_interrupts(*more: signal.Signals) -> Iterator[None]:
    """Let SIGTERM stop a training as Ctrl-C does, so that batch systems lose nothing.

    Args:
        more: Signals that do so, too, unless they are ignored.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    heard = [number for number in more if signal.getsignal(number) is not signal.SIG_IGN]
    with _handled((signal.SIGTERM, *heard), interrupt):
        yield


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Keep an impatient second Ctrl-C or SIGTERM from cutting off the saving."""
    with _handled((signal.SIGINT, signal.SIGTERM), signal.SIG_IGN):
        yield


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM come behind the block.

    Torch calls back into Python while it writes; an exception that a signal raises there becomes
    another error, or ends the process.
    """
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    numbers = [
        number
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number) is not signal.SIG_IGN
    ]
    try:
        with _handled(tuple(numbers), note):
            yield
    finally:
        for number in dict.fromkeys(came):
            os.kill(os.getpid(), number)


@contextmanager
def _handled(
    numbers: tuple[int, ...], handler: Callable[..., Any] | signal.Handlers
) -> Iterator[None]:
    """Handle signals in another way meanwhile; in a thread, where none arrives, nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, handler) for number in numbers]
    try:
        yield
    finally:
        for number, old in zip(numbers, before, strict=True):
            signal.signal(number, old)
