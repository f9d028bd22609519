"""Apps over every transport of the table, made in the same way, and over variants of some."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import (
    AppClient,
    AppsWanted,
    InProcessApp,
    InProcessBatch,
    OptionValue,
    Protocol2Connection,
    list_games,
    list_transports,
    start_sim2vr_app,
    transport_named,
)
from sim2vr_harness.client.games import loaded_game_libraries


def over(
    transport: str,
    game: str,
    options: Mapping[str, OptionValue] | None = None,
    *,
    log_dir: Path | None = None,
    **settings: Any,
) -> AppClient:
    """The only app of a transport of the table."""
    wanted = AppsWanted(n=1, game=game, options=options or {}, **settings)
    return transport_named(transport).apps(wanted)(0, log_dir)


def through_the_socket(
    game: str, options: Mapping[str, OptionValue] | None = None, **settings: Any
) -> AppClient:
    """Over protocol 2, without shared memory."""
    libraries = [word for file in loaded_game_libraries() for word in ("--game-library", file)]
    channel = start_sim2vr_app(app_executable(), libraries).channel(60.0, 60.0)
    return Protocol2Connection(
        channel, game=game, options=options, shared_memory=False, **settings
    ).app(0)


def in_a_batch(
    game: str,
    options: Mapping[str, OptionValue] | None = None,
    *,
    log_dir: Path | None = None,
    **settings: Any,
) -> AppClient:
    """The last of three apps that are stepped together in this process, on two threads."""
    log_dirs = None if log_dir is None else [log_dir / str(i) for i in range(3)]
    batch = InProcessBatch(3, game, options, threads=2, log_dirs=log_dirs, **settings)
    batch.apps[0].close()
    batch.apps[1].close()
    return batch.apps[2]


TRANSPORTS: dict[str, Callable[..., AppClient]] = {
    "alone": InProcessApp,
    "in a batch": in_a_batch,
    **{
        transport.name: partial(over, transport.name)
        for transport in list_transports()
        if transport.reports_reward  # apps of others have contracts of their own
    },
    "protocol2, images through the socket": through_the_socket,
}
"""The first is what the others are compared with."""
ALONE, *REMOTE = TRANSPORTS
TWO_GAMES = ("beats", "sample")
"""Played over every transport: one with both hands and levels, and one with little of all."""


def cases() -> list[tuple[str, str]]:
    """Transports with games: every game in this process, and two over each other transport."""
    everywhere = list_games() if loaded_game_libraries() else TWO_GAMES
    return [
        (transport, game)
        for game in sorted(list_games())
        for transport in (TRANSPORTS if game in everywhere else (ALONE,))
    ]
