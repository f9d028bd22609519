"""``sim2vr-harness``: train, evaluate and look at simulated users.

Commands only read options and print; what they do lives in the rooms that they call, and those
are imported when a command runs, so that ``--help`` is quick.
"""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from sim2vr_harness import __version__
from sim2vr_harness.base.cores import settle_torch
from sim2vr_harness.base.notices import set_notice
from sim2vr_harness.cli import (
    audit,
    compare,
    doctor,
    evaluate,
    export,
    games,
    page,
    replay,
    session,
    study,
    track,
    train,
    users,
    watch,
)
from sim2vr_harness.cli import render as pictures
from sim2vr_harness.cli import report as report_command
from sim2vr_harness.cli.command import DESIGNS, LOOK, RECORDED, SETUP, USERS, CommandGroup
from sim2vr_harness.cli.errors import INTERRUPTED, report
from sim2vr_harness.cli.games import HelpWithGames

app = CommandGroup(
    """Test VR applications with simulated users.

    Examples:
        sim2vr-harness audit --game whacamole --condition low --people 100
        sim2vr-harness study --game panel --user "press lit by ray" --vary button_m=0.04,0.08
    """,
    name="sim2vr-harness",
    add_completion=True,
    pretty_exceptions_enable=False,
)

plot = CommandGroup(
    """Draw learning curves as PNG files.

    Examples:
        sim2vr-harness plot curves runs/sample
        sim2vr-harness plot curves runs/sample runs/other --out curves.png
    """
)

render = CommandGroup(
    """Render pictures of a game, or a film that compares users.

    Examples:
        sim2vr-harness render snapshot --game beats
        sim2vr-harness render film runs/sample runs/other
    """
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sim2vr-harness {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version and exit."
        ),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks of errors.")] = False,
) -> None:
    """Test VR applications with simulated users."""


app.add("audit", audit.audit, DESIGNS)
app.add("study", study.study, DESIGNS)
app.add("report", report_command.report, DESIGNS)
app.add("evaluate", evaluate.evaluate, USERS, cls=HelpWithGames)
app.add("train", train.train, USERS)
app.add("export", export.export, USERS)
app.add("compare", compare.compare, RECORDED)
app.add_typer(session.app, name="session", rich_help_panel=RECORDED)
app.add("replay", replay.replay, RECORDED)
app.add("track", track.track, RECORDED)
app.add("watch", watch.watch, LOOK)
render.add("snapshot", pictures.snapshot)
render.add("film", pictures.film)
app.add_typer(render, name="render", rich_help_panel=LOOK)
plot.add("curves", pictures.curves)
app.add_typer(plot, name="plot", rich_help_panel=LOOK)
app.add("doctor", doctor.doctor, SETUP)
app.add("games", games.games, SETUP)
app.add_typer(users.app, name="users", rich_help_panel=SETUP)
app.add_typer(page.app, name="page", rich_help_panel=SETUP)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    settle_torch()  # before anything loads torch
    set_notice(partial(typer.echo, err=True))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names of files need not be UTF-8
            stream.reconfigure(errors="backslashreplace")
    given = sys.argv[1:] if arguments is None else arguments
    debug = "--debug" in given
    given = [argument for argument in given if argument != "--debug"] or ["--help"]
    command = partial(app, given, prog_name="sim2vr-harness", standalone_mode=False)
    with _sigterm_as_ctrl_c():
        status = report(command, given, debug)
    if status == INTERRUPTED and arguments is None:
        # Exit without freeing modules, which takes Torch's more than a second of a core.
        atexit._run_exitfuncs()
        for once_stream in (sys.stdout, sys.stderr):
            with suppress(OSError):
                once_stream.flush()
        os._exit(status)
    sys.exit(status)


@contextmanager
def _sigterm_as_ctrl_c() -> Iterator[None]:
    """Let every command clean up on SIGTERM; an ignored one stays so."""
    before = signal.getsignal(signal.SIGTERM)
    if before is signal.SIG_DFL and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    ignores, sys.unraisablehook = sys.unraisablehook, partial(_ignored, sys.unraisablehook)
    try:
        yield
    finally:
        sys.unraisablehook = ignores
        if signal.getsignal(signal.SIGTERM) is signal.default_int_handler:
            signal.signal(signal.SIGTERM, before)


def _ignored(report_it: Callable[[Any], object], ignored: Any) -> None:
    """Interrupt once more where an interrupt came in a finalizer, whose errors are lost."""
    if isinstance(ignored.exc_value, KeyboardInterrupt):
        # Not from here: the hook would be interrupted, and its errors are lost, too.
        main = threading.main_thread().ident
        threading.Timer(0.05, signal.pthread_kill, [main, signal.SIGTERM]).start()
    else:
        report_it(ignored)


if __name__ == "__main__":
    main()
