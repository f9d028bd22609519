"""``sim2vr-harness watch``: a look at play, in the browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import (
    ActionMode,
    ChangedEnvironment,
    OnePerson,
    TrustedApp,
    argument,
    option,
)
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import (
    AnyUser,
    who_plays,
)

if TYPE_CHECKING:
    from sim2vr_harness.tools.watch.frames import Playlist


@dataclass(frozen=True, kw_only=True)
class WatchRequest(ActionMode, AnyUser, ChangedEnvironment, OnePerson, TrustedApp, PageOptions):
    """What to watch, and where."""

    run: str | None = argument(
        "RUN|LOG|SESSION",
        "A trained user, a configuration or body, the folder of a logged or recorded round, or a "
        "session.",
        None,
        names="users",
    )
    try_: bool = option("Play yourself, with mouse and keyboard.", False)
    game: str | None = option("The game.", metavar="NAME", shown="the user's", names="games")
    condition: str | None = option("The game's condition.", metavar="NAME", shown="the user's")
    seed: int | None = option(
        "Seed of the round.", shown="1, or the session's", least=0, most=2**31 - 1
    )
    beside: Path | None = option(
        "Show a recorded session to the left of the user.", metavar="SESSION"
    )
    host: str = option("Address to listen on.", "127.0.0.1")
    port: int = option("Port of the page.", 8080, least=1, most=65535)
    share: bool = option(
        "Open a public tunnel (share.viser.studio): anyone with the printed address, over the "
        "internet, sees the page and presses its buttons.",
        False,
    )


def watch(request: WatchRequest) -> None:
    """Watch a user play in the browser, or play yourself.

    The page shows body, game and headset view.

    Examples:
        sim2vr-harness watch --try --game beats
        sim2vr-harness watch pretrained:whacamole_people --beside round.jsonl
    """
    from sim2vr_harness.base.optional import needed

    remote = request.remote()
    if request.beside is not None and request.try_:
        raise InputError("--beside", "it together with --try", "one of them")
    if request.share and request.host != "127.0.0.1":
        raise InputError("--share", "it together with --host", "one of them")
    run, baseline = who_plays(request.run, request.user)
    needed("viser", "watch", "watch")
    if run is None and not request.try_ and not remote:
        raise InputError("RUN", "nothing", "a user, a log or a recording; or --try, or an app")
    show = _chosen(request, run, baseline, remote)
    # Serve the page until Ctrl-C.
    from contextlib import closing

    from sim2vr_harness.tools.watch.browser import Viewer

    with closing(Viewer(show, request.host, request.port, shared=request.share)) as viewer:
        typer.echo(f"{show.title}: {viewer.address} (Ctrl-C ends)")
        if viewer.public_address is not None:
            typer.echo(f"Open to anyone with this address: {viewer.public_address}")
        viewer.run()


def _chosen(
    request: WatchRequest, run: str | None, baseline: str | None, remote: dict[str, Any]
) -> Playlist:
    """Return what to watch: a session, a user, or both."""
    from sim2vr_harness.sessions import find_sessions, read_session
    from sim2vr_harness.sessions.whacamole import is_recorded_round
    from sim2vr_harness.tools.watch.selection import choose
    from sim2vr_harness.tools.watch.sessions import beside as shown_beside
    from sim2vr_harness.tools.watch.sessions import session_show

    game, seed, condition = request.game, request.seed, request.condition
    beside = request.beside
    alone = None if run is None or Path(run).is_dir() else Path(run)
    if alone is not None and find_sessions(alone) == [alone]:
        session = read_session(alone)
        if not is_recorded_round(session):
            return session_show(session, alone.name, game=game, app=remote)
    shown = None if beside is None else read_session(beside)
    if shown is not None:
        seed = shown.seed if seed is None else seed
        same = shown.app.kind == "game" and not remote and game in (None, shown.app.name)
        condition = condition or (shown.app.condition if same else "") or None
    show = choose(
        run,
        seed=1 if seed is None else seed,
        game=game,
        condition=condition,
        app=remote,
        played=request.try_,
        person=request.person,
        deterministic=request.deterministic,
        trust_app=request.trust_app,
        untrained=baseline,
        overrides=request.overrides,
    )
    if shown is None or beside is None:
        return show
    return shown_beside(show, session_show(shown, beside.name, game=game, app=remote))
