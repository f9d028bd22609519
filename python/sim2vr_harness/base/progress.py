"""Progress of work: of its parts, and for people, by rich's progress bars."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from rich.console import Console

OnProgress = Callable[[float], None]
"""Receives the proportion of the work that is done, 0 to 1."""

PLAIN_INTERVAL_S = 15.0
"""Seconds between two lines where there is no terminal."""
_UPDATE_S, _SPEED_S = 0.25, 600.0
"""Time between two updates of the library's bar, and over which it measures the speed."""


def progress_of_part(on_progress: OnProgress, number: int, count: int) -> OnProgress:
    """Return what receives the progress of part ``number``, from 0, of ``count`` equal parts."""
    return lambda done: on_progress((number + done) / count)


@dataclass(frozen=True)
class View:
    """Displayed state of the work at one moment.

    Attributes:
        done: progress, up to the total of the display.
        doing: present activity.
        details: further numbers, a line each below the bar.
    """

    done: float
    doing: str = ""
    details: tuple[str, ...] = ()


class ProgressDisplay:
    """A progress bar in a terminal, plain lines elsewhere. Use it in a ``with`` block.

    Args:
        name: of the work.
        total: what :attr:`View.done` counts up to.
        console: where to show it.
        interval_s: outside a terminal, time between two lines.
    """

    def __init__(
        self, name: str, total: float, console: Console, interval_s: float = PLAIN_INTERVAL_S
    ) -> None:
        from rich.console import Group
        from rich.live import Live
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
        from rich.text import Text

        self._name, self._console, self._interval_s = name, console, interval_s
        columns = (TextColumn("{task.description}"), BarColumn(36), TaskProgressColumn())
        times = TextColumn("elapsed {task.fields[elapsed]}   left {task.fields[left]}")
        self._bar = Progress(
            *columns, times, console=console, auto_refresh=False, speed_estimate_period=_SPEED_S
        )
        self._task = self._bar.add_task(name, total=max(total, 1e-9), elapsed="-", left="-")
        self._view: Callable[[], View] = lambda: View(0.0)
        self._last_line = self._last_update = time.monotonic()
        self._live: Live | None = None

        def panel() -> Any:
            view = self._view()
            self._advance(view)
            lines = [Text(line, style="dim") for line in (view.doing, *view.details) if line]
            return Group(self._bar, *lines)

        if console.is_terminal:
            self._live = Live(
                console=console, get_renderable=panel, refresh_per_second=4, transient=True
            )

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, view: Callable[[], View], *, force: bool = False) -> None:
        """Show this view from now on; it is asked when something is drawn.

        Args:
            view: what to show.
            force: print a plain line even if the last one is recent.
        """
        self._view = view
        now = time.monotonic()
        if now - self._last_update >= _UPDATE_S:
            self._last_update = now
            self._advance(view())
        if self._live is None and (force or now - self._last_line >= self._interval_s):
            self.say(self.line())

    def say(self, text: str) -> None:
        """Print a line that stays, above the bar if there is one; the next one is due later."""
        self._last_line = time.monotonic()
        self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def line(self) -> str:
        """Return the present view in one line."""
        view = self._view()
        self._advance(view)
        task = self._bar.tasks[0]
        parts = [f"{self._name} {task.percentage:.0f}%", view.doing, f"left {task.fields['left']}"]
        return " | ".join(part for part in (*parts, *view.details) if part)

    def _advance(self, view: View) -> None:
        task = self._bar.tasks[0]
        self._bar.update(
            self._task,
            completed=view.done,
            elapsed=duration(task.elapsed),
            left=duration(task.time_remaining),
        )


def duration(seconds: float | None) -> str:
    """Write a time span for people: ``12 s``, ``3 min 05 s``, ``2 h 10 min``, ``3 d 4 h``."""
    if seconds is None:
        return "-"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    if whole < 86400:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
    return f"{whole // 86400} d {whole % 86400 // 3600} h"
