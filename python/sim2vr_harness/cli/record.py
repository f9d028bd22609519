"""``sim2vr-harness session record``: record a round of a WebXR page on any headset."""

from __future__ import annotations

import secrets
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim2vr_harness.cli.options import writable_file

if TYPE_CHECKING:
    from sim2vr_harness.tools.record import RecordingServer

_Page = Annotated[
    str | None,
    typer.Option("--page", metavar="PAGE", help="A page in HTML, or a folder with index.html."),
]
_Out = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The session to write: .jsonl, .jsonl.gz, .json (IWER) or .csv.",
        show_default="PAGE_TIME.jsonl",
        callback=writable_file,
    ),
]
_Port = Annotated[
    int, typer.Option(min=0, max=65535, help="Port to listen on; 0: one that is free.")
]
_Lan = Annotated[
    bool,
    typer.Option(
        "--lan",
        help="Serve the local network over HTTPS with a self-signed certificate (needs openssl), "
        "not loopback.",
    ),
]
_Seed = Annotated[
    int | None,
    typer.Option(
        min=0, max=2**32 - 1, help="Seed of the page's random numbers.", show_default="random"
    ),
]
_Tag = Annotated[
    bool,
    typer.Option(
        "--script-tag", help="Print an element for the top of a page: it downloads the session."
    ),
]
_Bookmarklet = Annotated[
    bool, typer.Option("--bookmarklet", help="Print the same as a bookmark's address; no seed.")
]


def record(
    page: _Page = None,
    out: _Out = None,
    port: _Port = 8090,
    lan: _Lan = False,
    seed: _Seed = None,
    script_tag: _Tag = False,
    bookmarklet: _Bookmarklet = False,
) -> None:
    """Record a round of a WebXR page, played in a headset's browser.

    Serves the page's folder and prints the address to open. The recording ends with the page's VR
    session, or with Ctrl-C.

    Examples:
        sim2vr-harness session record --page game.html --out round.jsonl
        sim2vr-harness session record --script-tag
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.tools import record as recorder

    wanted = [page is not None, script_tag, bookmarklet]
    if sum(wanted) != 1:
        got = "nothing" if not any(wanted) else "more than one of them"
        raise InputError("session record", got, "--page, --script-tag or --bookmarklet")
    seed = secrets.randbits(32) if seed is None else seed
    if script_tag:
        typer.echo(recorder.script_tag(seed), nl=False)
    elif bookmarklet:
        typer.echo(recorder.bookmarklet())
    elif page is not None:
        _serve(page, out, port, seed, lan=lan)


def _serve(given: str, out: Path | None, port: int, seed: int, *, lan: bool) -> None:
    """Serve a page until its session has come, and write that."""
    from contextlib import closing

    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.base.signals import sigterm_interrupts
    from sim2vr_harness.sessions.formats import require_name
    from sim2vr_harness.tools.record import RecordingServer, recover

    page = Path(given).expanduser()
    if "://" in given:
        expected = "a file; --script-tag or --bookmarklet record a page that is elsewhere"
        raise InputError("--page", f"the address {given!r}", expected)
    if not (page / "index.html" if page.is_dir() else page).is_file():
        raise InputError("--page", f"{given!r}", "a page in HTML, or a folder with index.html")
    if out is None:
        name = page.absolute().name if page.is_dir() else page.stem
        out = Path(f"{name}_{time.strftime('%Y%m%d_%H%M%S')}.jsonl")
    require_name(out)
    for line in recover(out.absolute().parent):
        typer.echo(line, err=True)
    with (
        sigterm_interrupts(signal.SIGHUP, signal.SIGQUIT),
        closing(RecordingServer(page, seed, out, port=port, lan=lan)) as server,
    ):
        try:
            with server.running():
                _wait(server, seed)
            _write(server)
        except BaseException:
            if len(server.parts):
                kept = (
                    f"Kept: {server.parts.folder}; the next recording into its folder recovers it"
                )
                with suppress(OSError):
                    typer.echo(kept, err=True)
            raise


def _wait(server: RecordingServer, seed: int) -> None:
    """Say where the page is, and wait for the end of its session."""
    typer.echo(f"Open in the headset's browser: {server.address}")
    if server.fingerprint:
        typer.echo(
            "The browser warns of the self-signed certificate; its SHA-256 fingerprint is\n"
            f"{server.fingerprint}"
        )
    typer.echo(f"Seed: {seed}. The recording ends with the VR session, or with Ctrl-C.")
    try:
        server.wait()
    except KeyboardInterrupt:
        with suppress(OSError):  # the terminal may have gone
            typer.echo("", err=True)


def _write(server: RecordingServer) -> None:
    """Write the session, and say what is in it."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.sessions.privacy import personal_content

    session = server.parts.finish()
    if session is None:
        raise InputError("session record", "no frame of a VR session", "a page that enters VR")
    for note in session.notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"Written: {server.parts.out} ({len(session):,} frames, {session.duration_s:.1f} s)")
    for line in personal_content(session):
        typer.echo(f"personal: {line}")
