"""Which app a user plays in: in this process, started by us, or running somewhere already."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from sim2vr_harness import paths
from sim2vr_harness.client import (
    AppClient,
    AppDied,
    AppRefused,
    AppTimeout,
    Channel,
    InProcessBatch,
    Protocol1App,
    Protocol2Connection,
    StartingApp,
    connect,
    is_sim2vr_app,
    sim2vr_arguments,
    start_sim2vr_app,
    start_unity_app,
    unity_arguments,
)
from sim2vr_harness.envs.config import AppConfig, EnvConfig

__all__ = [
    "AppFactory",
    "InProcessApps",
    "RemoteApps",
    "app_factory",
    "in_process_batch",
    "knows_options",
]

AppFactory = Callable[[EnvConfig, int, Path | None], AppClient]
"""Makes the app of user i: (config, i, log folder) -> client. Called again for a user whose app has
failed and was closed."""

START_ATTEMPTS = 2

IPD_M = 0.064
"""Distance of the pupils of those who do not say theirs."""

Made = TypeVar("Made", Protocol1App, Protocol2Connection)


def app_factory(config: EnvConfig, n: int, ipd_m: float = IPD_M) -> AppFactory:
    """The factory for ``config.app.transport``.

    Args:
        config: of the users.
        n: how many users there will be.
        ipd_m: distance of the users' pupils.

    Raises:
        ValueError: the settings do not serve so many users.
    """
    if config.app.transport == "in_process":
        return InProcessApps(n, ipd_m)
    return RemoteApps(config.app, n, ipd_m)


class InProcessApps:
    """An :data:`AppFactory` for apps of the C++ runtime in this process, stepped together.

    Args:
        n: number of users.
        ipd_m: distance of their pupils.
    """

    def __init__(self, n: int, ipd_m: float = IPD_M) -> None:
        self._n, self._ipd_m = n, ipd_m
        self._batch: InProcessBatch | None = None

    def __call__(self, config: EnvConfig, index: int, log_dir: Path | None) -> AppClient:
        """The app of user ``index``; see :data:`AppFactory`."""
        if self._batch is None:
            self._batch = in_process_batch(config, self._n, log_dir, ipd_m=self._ipd_m)
        return self._batch.app(index)


def in_process_batch(
    config: EnvConfig,
    n: int,
    log_dir: Path | None,
    vision_channels: Sequence[int] = (),
    ipd_m: float = IPD_M,
) -> InProcessBatch:
    """The apps of ``n`` users in this process; errors as of :class:`InProcessBatch`."""
    return InProcessBatch(
        n,
        config.app.game,
        config.app.options,
        width=config.vision.width,
        height=config.vision.height,
        eyes=config.vision.eyes,
        ipd_m=ipd_m,
        renderer=config.app.renderer,
        log_dirs=None if log_dir is None else [log_dir / f"user{i:03d}" for i in range(n)],
        threads=config.threads or len(os.sched_getaffinity(0)),
        vision_channels=vision_channels,
    )


def knows_options(app: AppConfig) -> bool:
    """Whether the app is known to take game options at every reset, as our runtime does.

    A SIM2VR app of others takes them at its start, as arguments; of one that runs somewhere
    already, nothing is known.
    """
    return app.transport == "in_process" or (app.connect is None and _is_ours(app))


def _is_ours(app: AppConfig) -> bool:
    return app.executable is None or is_sim2vr_app(Path(app.executable))


class RemoteApps:
    """An :data:`AppFactory` for apps outside this process.

    All processes are started when the first app is asked for, so that they start side by side;
    each has its own port. Over protocol 1 every user has a process, over protocol 2 ``processes``
    servers share the users, and the steps of those who share travel in one message.

    Args:
        settings: the app.
        n: number of users.
        ipd_m: distance of their pupils.

    Raises:
        ValueError: the settings do not serve so many users.
    """

    def __init__(self, settings: AppConfig, n: int, ipd_m: float = IPD_M) -> None:
        self._settings = settings
        self._n, self._ipd_m = n, ipd_m
        self._per_server = 1
        if settings.transport == "protocol2":
            self._per_server = -(-n // self._servers())
        elif settings.connect is not None and n != 1:
            raise ValueError(
                f"app.connect: got {settings.connect!r} for {n} users, but an app serves one user "
                "over protocol 1, expected 1 user (ppo.n_envs=1), or protocol 2"
            )
        if not _is_ours(settings) and settings.transport == "protocol2":
            raise ValueError(
                f"app.transport: got 'protocol2' for {settings.executable!r}, expected "
                "'protocol1': only sim2vr-app speaks protocol 2"
            )
        self._starting: dict[int, StartingApp] = {}
        self._connections: dict[int, Protocol2Connection] = {}
        self._starts: dict[int, int] = {}
        self._began = False

    def _servers(self) -> int:
        if self._settings.connect is not None:
            return 1
        wanted = self._settings.processes or len(os.sched_getaffinity(0))
        return min(self._n, wanted)

    def __call__(self, config: EnvConfig, index: int, log_dir: Path | None) -> AppClient:
        """The app of user ``index``; see :data:`AppFactory`."""
        if log_dir is not None and self._settings.connect is None:
            self._per_server = 1  # a folder for every user
        if not self._began and self._settings.connect is None:
            self._began = True
            for server in range(-(-self._n // self._per_server)):
                self._starting[server] = self._start(config, server, log_dir)
        server, place = divmod(index, self._per_server)
        if self._settings.transport == "protocol1":
            return self._settled(server, config, log_dir, self._protocol1)
        connection = self._connections.get(server)
        if connection is None or not connection.usable or place in connection.taken:
            connection = self._settled(server, config, log_dir, self._protocol2)
            self._connections[server] = connection
        return connection.app(place)

    def _settled(
        self,
        server: int,
        config: EnvConfig,
        log_dir: Path | None,
        make: Callable[[Channel, EnvConfig, int, Path | None], Made],
    ) -> Made:
        """``make`` with a channel to the app; a failed start is tried again, on another port."""
        attempts = 1 if self._settings.connect is not None else START_ATTEMPTS
        for attempt in range(1, attempts + 1):
            try:
                return self._once(server, config, log_dir, make)
            except (AppDied, AppTimeout):
                if attempt == attempts:
                    self._abandon_starts()
                    raise
            except BaseException:
                self._abandon_starts()
                raise
        raise AssertionError("unreachable")

    def _once(
        self,
        server: int,
        config: EnvConfig,
        log_dir: Path | None,
        make: Callable[[Channel, EnvConfig, int, Path | None], Made],
    ) -> Made:
        if self._settings.connect is not None:
            channel = connect(self._settings.connect, self._settings.timeout_s)
            return make(channel, config, server, log_dir)
        starting = self._starting.pop(server, None) or self._start(config, server, log_dir)
        try:
            channel = starting.channel(
                self._settings.timeout_s,
                self._settings.start_timeout_s,
                local=self._settings.transport == "protocol2",
            )
            return make(channel, config, server, log_dir)
        finally:
            starting.release_port()

    def _abandon_starts(self) -> None:
        while self._starting:
            _, starting = self._starting.popitem()
            starting.release_port()
            starting.process.kill()

    def _start(self, config: EnvConfig, server: int, log_dir: Path | None) -> StartingApp:
        app = self._settings
        self._starts[server] = self._starts.get(server, 0) + 1
        logs = self._log_folder(server, log_dir)
        if not _is_ours(app):
            assert app.executable is not None
            arguments = unity_arguments(app.options, app.arguments, logs)
            return start_unity_app(Path(app.executable), arguments)
        executable = paths.app_executable() if app.executable is None else Path(app.executable)
        arguments = sim2vr_arguments(
            app.game,
            app.options,
            width=config.vision.width,
            height=config.vision.height,
            renderer=app.renderer,
            log_dir=logs,
        )
        return start_sim2vr_app(executable, [*arguments, *app.arguments])

    def _log_folder(self, server: int, log_dir: Path | None) -> Path | None:
        """A folder of its own for every start: an app numbers its rounds from 0."""
        if log_dir is None:
            return None
        starts = self._starts.get(server, 1)
        return log_dir / (f"user{server:03d}" + (f"-restart{starts - 1}" if starts > 1 else ""))

    def _protocol1(
        self, channel: Channel, config: EnvConfig, server: int, log_dir: Path | None
    ) -> Protocol1App:
        if log_dir is not None and self._settings.connect is not None:
            channel.close()
            raise AppRefused(
                f"logs: the app at {self._settings.connect} runs already, expected it to be "
                "started with its own arguments for logging"
            )
        return Protocol1App(
            channel,
            width=config.vision.width,
            height=config.vision.height,
            frequency_hz=config.action_frequency_hz,
            time_scale=self._settings.time_scale,
            options=self._settings.options,
            start_timeout_s=self._settings.start_timeout_s,
        )

    def _protocol2(
        self, channel: Channel, config: EnvConfig, server: int, log_dir: Path | None
    ) -> Protocol2Connection:
        first = server * self._per_server
        return Protocol2Connection(
            channel,
            apps=min(self._per_server, self._n - first),
            game=self._settings.game,
            options=self._settings.options,
            width=config.vision.width,
            height=config.vision.height,
            renderer=self._settings.renderer,
            log_dir=self._log_folder(server, log_dir),
            start_timeout_s=self._settings.start_timeout_s,
        )
