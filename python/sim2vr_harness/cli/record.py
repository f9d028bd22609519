"""``sim2vr-harness session record``: record a round of a WebXR page on any headset."""

from __future__ import annotations

import secrets
import signal
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim2vr_harness.base.requests import option

if TYPE_CHECKING:
    from sim2vr_harness.tools.record import RecordingServer


@dataclass(frozen=True, kw_only=True)
class RecordRequest:
    """Which page to record."""

    page: str | None = option("A page in HTML, or a folder with index.html.", metavar="PAGE")
    out: Path | None = option(
        "The session to write: .jsonl, .jsonl.gz, .json (IWER) or .csv.",
        metavar="FILE",
        shown="PAGE_TIME.jsonl",
        place="file to write",
    )
    port: int = option("Port to listen on; 0: one that is free.", 8090, least=0, most=65535)
    lan: bool = option(
        "Serve the local network by HTTPS with a self-signed certificate (needs openssl).",
        False,
    )
    seed: int | None = option(
        "Seed of the page's random numbers.", shown="random", least=0, most=2**32 - 1
    )
    script_tag: bool = option(
        "Print an element for the top of a page: it downloads the session.", False
    )
    bookmarklet: bool = option("Print the same as a bookmarklet, which sets no seed.", False)


def record(request: RecordRequest) -> None:
    """Record a round of a WebXR page, played in a headset's browser.

    Serves the page's folder and prints the address to open. The recording ends with the page's VR
    session, or with Ctrl-C.

    Examples:
        sim2vr-harness session record --page game.html --out round.jsonl
        sim2vr-harness session record --script-tag
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.tools import record as recorder

    wanted = [request.page is not None, request.script_tag, request.bookmarklet]
    if sum(wanted) != 1:
        got = "nothing" if not any(wanted) else "more than one of them"
        raise InputError("session record", got, "--page, --script-tag or --bookmarklet")
    seed = secrets.randbits(32) if request.seed is None else request.seed
    if request.script_tag:
        typer.echo(recorder.script_tag(seed), nl=False)
    elif request.bookmarklet:
        typer.echo(recorder.bookmarklet())
    elif request.page is not None:
        _serve(request.page, request.out, request.port, seed, lan=request.lan)


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
