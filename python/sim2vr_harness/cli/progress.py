"""How far a command is, on the terminal."""

from __future__ import annotations

from rich.console import Console

__all__ = ["Share"]


class Share:
    """A progress bar on the standard error stream; nothing outside a terminal."""

    def __init__(self, label: str) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        console = Console(stderr=True)
        self._bar = Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        self._task = self._bar.add_task(label, total=1.0)

    def show(self, share: float) -> None:
        """Show that this share of the work, 0 to 1, is done."""
        self._bar.update(self._task, completed=share)

    def __enter__(self) -> Share:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()
