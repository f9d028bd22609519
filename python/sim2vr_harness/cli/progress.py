"""Progress of a command on standard error."""

from __future__ import annotations

import time

import typer
from rich.console import Console

INTERVAL_S = 15.0
"""Seconds between two lines where there is no terminal."""


def say(text: str) -> None:
    """Print a line on standard error."""
    typer.echo(text, err=True)


class Share:
    """A progress bar on a terminal; elsewhere lines, one at once and then every 15 s."""

    def __init__(self, label: str) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        console = Console(stderr=True)
        self._bar = Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        self._task = self._bar.add_task(label, total=1.0)
        self._label, self._plain = label, not console.is_terminal
        self._began = time.monotonic()
        self._last_line: float | None = None

    def show(self, share: float) -> None:
        """Show that this share of the work, 0 to 1, is done."""
        self._bar.update(self._task, completed=share)
        now = time.monotonic()
        if self._plain and (self._last_line is None or now - self._last_line >= INTERVAL_S):
            say(self._line(share, now))
            self._last_line = now

    def _line(self, share: float, now: float) -> str:
        from sim2vr_harness.training.run.progress import duration

        if self._last_line is None or share <= 0.0:
            return f"{self._label} ..."
        left = (now - self._began) * (1.0 - share) / share
        return f"{self._label}: {share:.0%}, left {duration(left)}"

    def __enter__(self) -> Share:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()
