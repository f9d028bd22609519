"""Progress of work that consists of parts."""

from __future__ import annotations

from collections.abc import Callable

OnProgress = Callable[[float], None]
"""Receives the proportion of the work that is done, 0 to 1."""


def progress_of_part(on_progress: OnProgress, number: int, count: int) -> OnProgress:
    """Return what receives the progress of part ``number``, from 0, of ``count`` equal parts."""
    return lambda done: on_progress((number + done) / count)
