"""Interface of transports, the ways to reach an app.

A new transport is a file with an entry and a line in :mod:`sim2vr_harness.client.transports`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sim2vr_harness.client.base import AppClient, OptionValue
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.games import GameFacts
from sim2vr_harness.client.in_process import InProcessBatch

AppSource = Callable[[int, Path | None], AppClient]
"""Makes the app of a user: (its number, root of the logs or None) -> client. Called again for a
user whose app has failed and was closed."""


@dataclass(frozen=True)
class AppPlace:
    """Location of the apps; a transport reads its own settings (:attr:`Transport.reads`).

    Attributes:
        executable: app to start; None: our own server.
        arguments: further arguments of the executable.
        connect: ``HOST:PORT`` or ZeroMQ endpoint of a running app; None: an app is started.
        timeout_s: deadline of every answer.
        start_timeout_s: deadline of the start of an app.
        time_scale: largest ratio of game time to real time of a Unity app.
        processes: servers that share the users; 0: one per core at most.
        page: WebXR page: a file, a folder with an ``index.html``, or an address below one of
            ``map``.
        map: beginning of addresses -> local folder from which pages may load them; all other
            addresses are refused.
        browser: program that shows pages; None: one on the PATH.
        options: options of this transport alone (:attr:`Transport.options`).
    """

    executable: str | None = None
    arguments: tuple[str, ...] = ()
    connect: str | None = None
    timeout_s: float = 60.0
    start_timeout_s: float = 60.0
    time_scale: int = 5
    processes: int = 0
    page: str | None = None
    map: Mapping[str, str] = field(default_factory=dict)
    browser: str | None = None
    options: Mapping[str, OptionValue] = field(default_factory=dict)


@dataclass(frozen=True)
class PageStart:
    """Start of a recorded page before its first frame in VR, in ms since its document began.

    Attributes:
        frames_ms: times of its own animation frames.
        requested_ms: time of its request for VR.
        first_ms: time of the first frame in VR.
    """

    frames_ms: tuple[float, ...]
    requested_ms: float
    first_ms: float


@dataclass(frozen=True)
class AppsWanted:
    """The apps of N users.

    Attributes:
        width, height: of one eye's image, pixels.
        eyes: 1, or 2 for a picture of each.
        fovea: width and height of the picture around the gaze, pixels, 0: none, and the width of a
            pixel at a depth of 1 m, m.
        ipd_m: distance between the pupils, metres.
        depth: whether a user sees the image's depth.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``.
        frequency_hz: user steps per second.
        threads: for what runs in this process.
        place: where the apps are.
        values: name -> expression that an app with values of its own (a page) answers with its
            value after every step.
        page_reset: expression by which a page begins a round; None: it is loaded anew.
        page_start: what a page does before its first frame in VR; None: it enters at once.
    """

    n: int
    game: str
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    width: int = 120
    height: int = 80
    eyes: int = 1
    fovea: tuple[int, int, float] = (0, 0, 0.0)
    ipd_m: float = 0.064
    depth: bool = True
    renderer: str = "automatic"
    frequency_hz: int = 20
    threads: int = 1
    place: AppPlace = AppPlace()
    values: Mapping[str, str] = field(default_factory=dict)
    page_reset: str | None = None
    page_start: PageStart | None = None


@dataclass(frozen=True)
class Transport:
    """One way to an app.

    Attributes:
        name: in configurations, ``env.app.transport``.
        apps: how to get the apps of N users. ValueError where the settings do not serve so many.
        capabilities: names of :data:`~sim2vr_harness.client.CAPABILITIES` that every app has which
            is reached so; a single app may have more.
        reads: fields of :class:`AppPlace` that mean something; others must be left alone.
        options: names of :attr:`AppPlace.options` that it knows, with a line each.
        text_options: those of ``options`` that are text, whatever YAML would make of it.
        needs: the field of :class:`AppPlace` that must be given; "" for none.
        reports_reward: whether its apps say what a step is worth; otherwise a task always does.
        users_per_connection: how many users an app serves; None: any number.
        knows_options: whether the apps of a place take game options at every reset, rather than at
            their start or never.
        facts: asks the apps of a place what their game publishes, (place, name of the game); None
            where they do not say.
        batch: for apps of this process that are stepped as arrays: makes them all, (wanted, root
            of the logs, channels of the pictures to concatenate).
    """

    name: str
    summary: str
    apps: Callable[[AppsWanted], AppSource]
    capabilities: frozenset[str] = frozenset()
    reads: frozenset[str] = frozenset()
    options: Mapping[str, str] = field(default_factory=dict)
    text_options: frozenset[str] = frozenset()
    needs: str = ""
    reports_reward: bool = True
    users_per_connection: int | None = None
    knows_options: Callable[[AppPlace], bool] = lambda place: True
    facts: Callable[[AppPlace, str], GameFacts | None] = lambda place, game: None
    batch: Callable[[AppsWanted, Path | None, Sequence[int]], InProcessBatch] | None = None


def checked_options(
    given: Mapping[str, OptionValue], choices: Mapping[str, tuple[str, ...]]
) -> dict[str, str]:
    """Return a transport's options as text, with the first choice where none was made.

    Args:
        given: :attr:`AppPlace.options`.
        choices: option -> the values that it can have; others can be any text.

    Raises:
        AppRefused: one has a value that it cannot have.
    """
    found = {name: known[0] for name, known in choices.items()}
    found |= {
        name: str(value).lower() if isinstance(value, bool) else str(value)
        for name, value in given.items()
    }
    for name, known in choices.items():
        if found[name] not in known:
            raise AppRefused(
                f"app.transport_options.{name}: got {found[name]!r}, expected one of "
                f"{', '.join(known)}"
            )
    return found
