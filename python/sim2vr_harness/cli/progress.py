"""Progress of a command on standard error."""

import typer

from sim2vr_harness.base.progress import ProgressDisplay, View


def say(text: str) -> None:
    """Print a line on standard error."""
    typer.echo(text, err=True)


class Share(ProgressDisplay):
    """A progress bar on a terminal; elsewhere lines, one at once and then every 15 s."""

    def __init__(self, label: str) -> None:
        from rich.console import Console

        super().__init__(label, 1.0, Console(stderr=True))
        self._label: str | None = label

    def show(self, share: float) -> None:
        """Show that this share of the work, 0 to 1, is done."""
        if self._label is not None and self._live is None:
            self.say(f"{self._label} ...")
        self._label = None
        self.update(lambda: View(share))
