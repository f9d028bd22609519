"""``sim2vr-harness watch``: a look at play, in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim2vr_harness.cli.app_options import with_page_options
from sim2vr_harness.cli.options import (
    DeterministicOption,
    EnvSetOption,
    TrustOption,
    UserOption,
    game_option,
    known_users,
    who_plays,
)

if TYPE_CHECKING:
    from sim2vr_harness.tools.watch.frames import Playlist

_Run = Annotated[
    str | None,
    typer.Argument(
        autocompletion=known_users,
        metavar="RUN|LOG|SESSION",
        help="A trained user, a configuration or body, the folder of a logged or recorded round, "
        "or a session.",
    ),
]
_Try = Annotated[bool, typer.Option("--try", help="Play yourself, with mouse and keyboard.")]
_Game = Annotated[
    str | None,
    game_option("The game.", "the user's"),
]
_Condition = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="The game's condition.", show_default="the user's"),
]
_Beside = Annotated[
    Path | None,
    typer.Option(metavar="SESSION", help="Show a recorded session to the left of the user."),
]
_Seed = Annotated[
    int | None,
    typer.Option(
        min=0, max=2**31 - 1, help="Seed of the round.", show_default="1, or the session's"
    ),
]
_Shared = Annotated[
    bool,
    typer.Option(
        "--share",
        help="Open a public tunnel (share.viser.studio): anyone with the printed address, over "
        "the internet, sees the page and presses its buttons.",
    ),
]


@with_page_options
def watch(
    run: _Run = None,
    try_: _Try = False,
    game: _Game = None,
    condition: _Condition = None,
    seed: _Seed = None,
    beside: _Beside = None,
    deterministic: DeterministicOption = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page.")] = 8080,
    shared: _Shared = False,
    user: UserOption = None,
    overrides: EnvSetOption = None,
    trust_app: TrustOption = False,
    *,
    remote: dict[str, Any],
) -> None:
    """Watch a user play in the browser, or play yourself.

    The page shows body, game and headset view.

    Examples:
        sim2vr-harness watch --try --game beats
        sim2vr-harness watch pretrained:whacamole_people --beside round.jsonl
    """
    from sim2vr_harness.base.optional import needed

    _check(try_, beside, shared=shared, host=host)
    run, baseline = who_plays(run, user)
    needed("viser", "watch", "watch")
    _require_user(run, try_, remote)
    # fmt: off
    show = _chosen(
        run, beside, game=game, condition=condition, seed=seed, remote=remote, person=try_,
        deterministic=deterministic, trust_app=trust_app, untrained=baseline,
        overrides=overrides or (),
    )
    # fmt: on
    _serve(show, host, port, shared)


def _check(try_: bool, beside: Path | None, *, shared: bool, host: str) -> None:
    """Refuse options that do not go together."""
    from sim2vr_harness.base.errors import InputError

    if beside is not None and try_:
        raise InputError("--beside", "it together with --try", "one of them")
    if shared and host != "127.0.0.1":
        raise InputError("--share", "it together with --host", "one of them")


def _require_user(run: str | None, try_: bool, remote: dict[str, Any]) -> None:
    from sim2vr_harness.base.errors import InputError

    if run is None and not try_ and not remote:
        raise InputError("RUN", "nothing", "a user, a log or a recording; or --try, or an app")


def _chosen(
    run: str | None,
    beside: Path | None,
    *,
    game: str | None,
    condition: str | None,
    seed: int | None,
    remote: dict[str, Any],
    **how: Any,
) -> Playlist:
    """Return what to watch: a session, a user, or both."""
    from sim2vr_harness.sessions import find_sessions, read_session
    from sim2vr_harness.sessions.whacamole import is_recorded_round
    from sim2vr_harness.tools.watch.selection import choose
    from sim2vr_harness.tools.watch.sessions import beside as shown_beside
    from sim2vr_harness.tools.watch.sessions import session_show

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
    how |= {"game": game, "condition": condition, "app": remote}
    show = choose(run, seed=1 if seed is None else seed, **how)
    if shown is None or beside is None:
        return show
    return shown_beside(show, session_show(shown, beside.name, game=game, app=remote))


def _serve(show: Playlist, host: str, port: int, shared: bool) -> None:
    """Serve the page until Ctrl-C."""
    from contextlib import closing

    from sim2vr_harness.tools.watch.browser import Viewer

    with closing(Viewer(show, host, port, shared=shared)) as viewer:
        typer.echo(f"{show.title}: {viewer.address} (Ctrl-C ends)")
        if viewer.public_address is not None:
            typer.echo(f"Open to anyone with this address: {viewer.public_address}")
        viewer.run()
