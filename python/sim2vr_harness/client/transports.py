"""The ways to an app: one table, by which configurations, command line and tests go.

A new one is a file with a :class:`Transport` and a line here; one from outside the package is
registered with :func:`register_transport` before a configuration names it.
"""

import difflib
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from sim2vr_harness.base import paths
from sim2vr_harness.client.base import CAPABILITIES, AppClient, UInt8Array
from sim2vr_harness.client.channel import Channel
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import (
    AppDied,
    AppRefused,
    AppTimeout,
    AppUnsupported,
    ProtocolError,
)
from sim2vr_harness.client.games import GameFacts, read_facts
from sim2vr_harness.client.in_process import InProcessBatch
from sim2vr_harness.client.launch import (
    StartingApp,
    connect,
    is_sim2vr_app,
    options_beside,
    sim2vr_arguments,
    start_sim2vr_app,
    start_unity_app,
    unity_arguments,
)
from sim2vr_harness.client.openxr.app import OPENXR
from sim2vr_harness.client.protocol1 import Protocol1App
from sim2vr_harness.client.protocol2 import Protocol2Connection
from sim2vr_harness.client.runtime import frame_time_ns
from sim2vr_harness.client.transport import AppPlace, AppsWanted, Transport
from sim2vr_harness.client.webxr.app import WEBXR

START_ATTEMPTS = 2


class Served(Protocol):
    """A connection to a process that plays the apps of some users."""

    @property
    def usable(self) -> bool:
        """True if the connection can be used."""

    taken: set[int]
    """Places whose apps were given out."""

    def app(self, index: int) -> AppClient:
        """The app at a place, from 0; each can be taken once."""


Open = Callable[[Channel, AppsWanted, int, Path | None], Served]
"""Begins a session: (channel, what is wanted, number of apps, folder for their logs)."""


class AppServers:
    """The source of apps outside this process.

    All processes are started when the first app is requested, so that they start in parallel.
    With several users per process the steps of those who share travel in one message.

    Args:
        wanted: the apps.
        per_server: users that share a process at most.
        open_session: begins a session with a process.
    """

    def __init__(self, wanted: AppsWanted, per_server: int, open_session: Open) -> None:
        if _is_ours(wanted.place):
            own = options_beside(wanted.game, wanted.options, wanted.place.arguments)
            wanted = replace(wanted, options=own)
        self._wanted, self._place = wanted, wanted.place
        self._per_server = per_server
        self._open = open_session
        self._starting: dict[int, StartingApp] = {}
        self._connections: dict[int, Served] = {}
        self._starts: dict[int, int] = {}
        self._began = False

    def __call__(self, index: int, log_dir: Path | None) -> AppClient:
        """The app of user ``index``; see :data:`AppSource`."""
        if self._place.connect is None:
            if log_dir is not None:
                self._per_server = 1  # a folder for every user
            if not self._began:
                self._began = True
                for server in range(-(-self._wanted.n // self._per_server)):
                    self._starting[server] = self._start(server, log_dir)
        server, place = divmod(index, self._per_server)
        connection = self._connections.get(server)
        if connection is None or not connection.usable or place in connection.taken:
            connection = self._settled(server, log_dir)
            self._connections[server] = connection
        return connection.app(place)

    def _settled(self, server: int, log_dir: Path | None) -> Served:
        """A session with the process; a failed start is tried again."""
        attempts = 1 if self._place.connect is not None else START_ATTEMPTS
        try:
            for _ in range(attempts - 1):
                with suppress(AppDied, AppTimeout):
                    return self._once(server, log_dir)
            return self._once(server, log_dir)
        except BaseException:
            while self._starting:
                self._starting.popitem()[1].process.kill()
            raise

    def _once(self, server: int, log_dir: Path | None) -> Served:
        apps = min(self._per_server, self._wanted.n - server * self._per_server)
        if self._place.connect is not None:
            channel = connect(self._place.connect, self._place.timeout_s)
            return self._open(channel, self._wanted, apps, log_dir)
        starting = self._starting.pop(server, None) or self._start(server, log_dir)
        channel = starting.channel(self._place.timeout_s, self._place.start_timeout_s)
        return self._open(channel, self._wanted, apps, self._log_folder(server, log_dir))

    def _start(self, server: int, log_dir: Path | None) -> StartingApp:
        place, wanted = self._place, self._wanted
        self._starts[server] = self._starts.get(server, 0) + 1
        logs = self._log_folder(server, log_dir)
        if not _is_ours(place):
            assert place.executable is not None
            arguments = unity_arguments(wanted.options, place.arguments, logs)
            return start_unity_app(Path(place.executable), arguments)
        executable = Path(place.executable or paths.app_executable())
        arguments = sim2vr_arguments(
            wanted.game,
            wanted.options,
            width=wanted.width,
            height=wanted.height,
            renderer=wanted.renderer,
            log_dir=logs,
        )
        return start_sim2vr_app(executable, [*arguments, *place.arguments])

    def _log_folder(self, server: int, log_dir: Path | None) -> Path | None:
        """A folder of its own for every start: an app numbers its rounds from 0."""
        if log_dir is None:
            return None
        starts = self._starts.get(server, 1)
        return log_dir / (f"user{server:03d}" + (f"-restart{starts - 1}" if starts > 1 else ""))


def _is_ours(place: AppPlace) -> bool:
    return place.executable is None or is_sim2vr_app(Path(place.executable))


# --- protocol 1: a process for every user -----------------------------------------------------


class _OneApp:
    """The session of an app that serves one user; a new one needs a new process."""

    usable = False

    def __init__(self, app: AppClient) -> None:
        self._app = app
        self.taken: set[int] = set()

    def app(self, index: int) -> AppClient:
        self.taken.add(index)
        return self._app


def _open_protocol1(
    channel: Channel, wanted: AppsWanted, apps: int, log_dir: Path | None
) -> _OneApp:
    if log_dir is not None and wanted.place.connect is not None:
        channel.close()
        raise AppRefused(
            f"logs: the app at {wanted.place.connect} runs already, expected it to be started "
            "with its own arguments for logging"
        )
    app = Protocol1App(
        channel,
        width=wanted.width,
        height=wanted.height,
        frequency_hz=wanted.frequency_hz,
        time_scale=wanted.place.time_scale,
        options=wanted.options,
        start_timeout_s=wanted.place.start_timeout_s,
    )
    return _OneApp(app)


def _protocol1_apps(wanted: AppsWanted) -> AppServers:
    if wanted.place.connect is not None and wanted.n != 1:
        raise ValueError(
            f"app.connect: got {wanted.place.connect!r} for {wanted.n} users, but an app serves "
            "one user over protocol 1, expected 1 user (ppo.n_envs=1), or protocol 2"
        )
    if wanted.eyes != 1:
        raise AppUnsupported("two_eyes: protocol 1 carries one picture, expected protocol 2")
    return AppServers(wanted, 1, _open_protocol1)


_STARTED_OR_FOUND = frozenset(
    {"executable", "arguments", "connect", "timeout_s", "start_timeout_s", "time_scale"}
)

PROTOCOL1 = Transport(
    name="protocol1",
    summary="SIM2VR's protocol: Unity builds, the Unity Editor, sim2vr-app",
    apps=_protocol1_apps,
    capabilities=frozenset({"left_controller"}),
    reads=_STARTED_OR_FOUND,
    users_per_connection=1,
    knows_options=lambda place: place.connect is None and _is_ours(place),
)


# --- protocol 2: servers that users share -----------------------------------------------------


def _open_protocol2(
    channel: Channel, wanted: AppsWanted, apps: int, log_dir: Path | None
) -> Protocol2Connection:
    connection = Protocol2Connection(
        channel,
        apps=apps,
        game=wanted.game,
        options=wanted.options,
        width=wanted.width,
        height=wanted.height,
        eyes=wanted.eyes,
        ipd_m=wanted.ipd_m,
        renderer=wanted.renderer,
        log_dir=log_dir,
        start_timeout_s=wanted.place.start_timeout_s,
    )
    if wanted.place.connect is not None:
        _note_facts(wanted.place.connect, connection)
    return connection


def _protocol2_apps(wanted: AppsWanted) -> AppServers:
    place = wanted.place
    if not _is_ours(place):
        raise ValueError(
            f"app.transport: got 'protocol2' for {place.executable!r}, expected 'protocol1': only "
            "sim2vr-app speaks protocol 2"
        )
    processes = place.processes or wanted.threads
    servers = 1 if place.connect is not None else min(wanted.n, processes)
    return AppServers(wanted, -(-wanted.n // servers), _open_protocol2)


_PUBLISHED: dict[tuple[str, str], GameFacts | None] = {}
"""Facts of games that running servers have published, by address and game. While a session lasts,
such a server accepts no other session that could request them."""


def _note_facts(address: str, connection: Protocol2Connection) -> GameFacts | None:
    facts = connection.facts
    try:
        known = None if facts is None else read_facts(facts)
    except ValueError as error:
        connection.close()
        raise ProtocolError(
            f"hello: {error}, as protocol 2 has it; the app of "
            f"{connection.game!r} may be of another version"
        ) from error
    _PUBLISHED[address, connection.game] = known
    return known


def _protocol2_facts(place: AppPlace, game: str) -> GameFacts | None:
    if place.connect is None:
        return None
    if (place.connect, game) in _PUBLISHED:
        return _PUBLISHED[place.connect, game]
    channel = connect(place.connect, place.timeout_s)
    with closing(Protocol2Connection(channel, game=game, renderer="null")) as connection:
        return _note_facts(place.connect, connection)


PROTOCOL2 = Transport(
    name="protocol2",
    summary="our own protocol, several times as fast: sim2vr-app, on this machine or another",
    apps=_protocol2_apps,
    capabilities=frozenset(CAPABILITIES) - {"privileged", "fovea"},
    reads=_STARTED_OR_FOUND - {"time_scale"} | {"processes"},
    knows_options=lambda place: place.connect is None,
    facts=_protocol2_facts,
)


def _batch(
    wanted: AppsWanted, log_dir: Path | None, vision_channels: Sequence[int] = ()
) -> InProcessBatch:
    return InProcessBatch(
        wanted.n,
        wanted.game,
        wanted.options,
        width=wanted.width,
        height=wanted.height,
        eyes=wanted.eyes,
        ipd_m=wanted.ipd_m,
        renderer=wanted.renderer,
        log_dirs=None if log_dir is None else [log_dir / f"user{i:03d}" for i in range(wanted.n)],
        threads=wanted.threads,
        vision_channels=vision_channels,
        fovea=wanted.fovea,
    )


class _Apps:
    """Those of one batch, one by one."""

    def __init__(self, wanted: AppsWanted) -> None:
        self._wanted = wanted
        self._made: InProcessBatch | None = None

    def __call__(self, index: int, log_dir: Path | None) -> AppClient:
        if self._made is None:
            self._made = _batch(self._wanted, log_dir)
        return self._made.apps[index]


IN_PROCESS = Transport(
    name="in_process",
    summary="our runtime, in this process",
    apps=_Apps,
    batch=_batch,
    capabilities=frozenset(CAPABILITIES) - {"privileged"},
)


_TABLE: dict[str, Transport] = {
    transport.name: transport
    for transport in (
        IN_PROCESS,
        PROTOCOL1,
        PROTOCOL2,
        WEBXR,
        OPENXR,
    )
}


def list_transports() -> list[Transport]:
    """Return every transport, those of the package first."""
    return list(_TABLE.values())


def transport_named(name: str) -> Transport:
    """Return a transport by its name.

    Raises:
        ValueError: there is none; names those that are and the nearest one.
    """
    if name in _TABLE:
        return _TABLE[name]
    near = difflib.get_close_matches(name, _TABLE, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    known = ", ".join(map(repr, _TABLE))
    raise ValueError(f"transport: got {name!r}, expected one of {known}{hint}")


def register_transport(transport: Transport) -> None:
    """Add a transport to the table.

    Raises:
        ValueError: there is one of that name.
    """
    if transport.name in _TABLE:
        raise ValueError(f"transport: got {transport.name!r}, which is taken, expected a new name")
    _TABLE[transport.name] = transport


# --- a short trial ---------------------------------------------------------------------------

_TRIAL_STEPS = 10
_TRIAL_HZ = 20
_HEAD_TURN_RAD = 0.35
"""Rotation of the head during the steps, rad, so that the image of any scene changes."""


@dataclass(frozen=True)
class AppTrial:
    """Behaviour of an app over one protocol.

    Attributes:
        protocol: 1 or 2.
        steps: Number of steps; fewer than ten if the round ended.
        steps_per_s: Steps per second of real time, images included.
        reward: Sum of the reward over the steps.
        images: (steps + 1, H, W, 4), images of the reset and of every step.
        announces_protocol2: True if its handshake announces protocol 2, too.
    """

    protocol: int
    steps: int
    steps_per_s: float
    reward: float
    images: UInt8Array
    announces_protocol2: bool

    @property
    def picture_changes(self) -> bool:
        """True if any image differs from the reset's."""
        return bool((self.images != self.images[0]).any())

    def warnings(self) -> list[str]:
        """Return one sentence for each way in which a user could not see in this app."""
        found = []
        if not self.picture_changes:
            found.append(
                "the picture never changed while head and hand moved, expected another one after "
                "each step: does the app apply the poses, and does it draw without a window?"
            )
        for channels, name in ((slice(0, 3), "colour"), (slice(3, 4), "depth")):
            last = self.images[-1][..., channels]
            if not (last != last[0, 0]).any():
                found.append(
                    f"{name} is the same in every pixel of the last picture, expected a scene in "
                    "front of the user"
                )
        return found


def try_app(
    executable: Path,
    arguments: Sequence[str] = (),
    *,
    size: tuple[int, int] = (120, 80),
    timeout_s: float = 60.0,
) -> list[AppTrial]:
    """Start an app and play ten steps over protocol 1, and over protocol 2 if it has it.

    Args:
        executable: A Unity build with the SIM2VR asset, sim2vr-app, or a program like either.
        arguments: Added to those that every app gets.
        size: (width, height) of the app's picture, pixels.
        timeout_s: How long the start and every answer may take.

    Raises:
        AppRefused: The executable, an argument or the picture's size cannot be used.
        AppTimeout, AppDied, ProtocolError: The app gives no answer, ends, or answers nonsense.
    """
    trials: list[AppTrial] = []
    start = start_sim2vr_app if is_sim2vr_app(executable) else start_unity_app
    width, height = size
    for protocol in (1, 2):
        if protocol == 2 and not trials[0].announces_protocol2:
            break
        channel = start(executable, arguments).channel(timeout_s, timeout_s)
        app: AppClient
        if protocol == 1:
            app = Protocol1App(
                channel,
                width=width,
                height=height,
                frequency_hz=_TRIAL_HZ,
                start_timeout_s=timeout_s,
            )
        else:
            app = Protocol2Connection(
                channel, width=width, height=height, start_timeout_s=timeout_s
            ).app(0)
        with app:
            app.reset(1, _poses(0))
            images = [app.image.copy()]
            reward = 0.0
            began_s = time.perf_counter()
            for step in range(1, _TRIAL_STEPS + 1):
                reply = app.step(frame_time_ns(step, _TRIAL_HZ), _poses(step))
                reward += reply.reward
                images.append(app.image.copy())
                if reply.finished:
                    break
            elapsed_s = time.perf_counter() - began_s
            announces = isinstance(app, Protocol1App) and app.server is not None
        steps = len(images) - 1
        trials.append(
            AppTrial(protocol, steps, steps / elapsed_s, reward, np.stack(images), announces)
        )
    return trials


def _poses(step: int) -> DevicePoses:
    """A seated user who turns the head and moves the right hand to the left."""
    done = step / _TRIAL_STEPS
    half = 0.5 * _HEAD_TURN_RAD * done
    head = [0.0, 1.2, 0.0, 0.0, np.sin(half), 0.0, np.cos(half)]
    hand = [0.25 - 0.3 * done, 1.0, 0.4, 0.0, 0.0, 0.0, 1.0]
    return DevicePoses(head=np.array(head), right_controller=np.array(hand))
