"""Apps over every transport, made in the same way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from sim2vr_harness.client import (
    AppClient,
    InProcessApp,
    InProcessBatch,
    OptionValue,
    Protocol1App,
    Protocol2Connection,
    sim2vr_arguments,
    start_sim2vr_app,
)
from sim2vr_harness.paths import app_executable


def over_protocol1(
    game: str,
    options: Mapping[str, OptionValue] | None = None,
    *,
    width: int = 120,
    height: int = 80,
    renderer: str = "automatic",
    log_dir: Path | None = None,
) -> Protocol1App:
    """An app in a server of its own."""
    arguments = sim2vr_arguments(
        game, options or {}, width=width, height=height, renderer=renderer, log_dir=log_dir
    )
    channel = start_sim2vr_app(app_executable(), arguments).channel(60.0, 60.0)
    return Protocol1App(channel, width=width, height=height)


def connected(apps: int = 1, local: bool = True, **settings: object) -> Protocol2Connection:
    """A session with a server of its own, through its local socket or ZeroMQ."""
    channel = start_sim2vr_app(app_executable(), []).channel(60.0, 60.0, local=local)
    return Protocol2Connection(channel, apps=apps, **settings)  # type: ignore[arg-type]


def over_protocol2(
    game: str,
    options: Mapping[str, OptionValue] | None = None,
    *,
    width: int = 120,
    height: int = 80,
    renderer: str = "automatic",
    log_dir: Path | None = None,
    local: bool = True,
) -> AppClient:
    """An app in a server of its own, its images in shared memory."""
    return connected(
        local=local,
        game=game,
        options=options,
        width=width,
        height=height,
        renderer=renderer,
        log_dir=log_dir,
    ).app(0)


def in_a_batch(
    game: str,
    options: Mapping[str, OptionValue] | None = None,
    *,
    width: int = 120,
    height: int = 80,
    renderer: str = "automatic",
    log_dir: Path | None = None,
) -> AppClient:
    """The last of three apps that are stepped together in this process, on two threads."""
    batch = InProcessBatch(
        3,
        game,
        options,
        width=width,
        height=height,
        renderer=renderer,
        log_dirs=None if log_dir is None else [log_dir / str(i) for i in range(3)],
        threads=2,
    )
    batch.app(0).close()
    batch.app(1).close()
    return batch.app(2)


TRANSPORTS: dict[str, Callable[..., AppClient]] = {
    "in process": InProcessApp,
    "in process, batch": in_a_batch,
    "protocol 1": over_protocol1,
    "protocol 2": over_protocol2,
    "protocol 2 over ZeroMQ": partial(over_protocol2, local=False),
}
