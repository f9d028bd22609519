"""Replay of a session in any app: the recorded devices at the recorded times, and what came back.

A game of this runtime keeps the session's clock; other apps begin at 0 with the first frame.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.client import (
    AppClient,
    AppPlace,
    AppReply,
    AppsWanted,
    InProcessApp,
    OptionValue,
    describe_game,
    transport_named,
)
from sim2vr_harness.client.tasks import TaskedApp, load_task
from sim2vr_harness.sessions.logs import WHACAMOLE, logged_events, times_of_log
from sim2vr_harness.sessions.session import AppIdentity, Session, SessionEvent
from sim2vr_harness.sessions.whacamole import RECORDED, is_recorded_round, with_clock

_COUNT = "_count"
"""Suffix of a task's event counts in the log."""


@dataclass(frozen=True)
class SessionReplay:
    """Result of the replay of a session in an app.

    Attributes:
        session: the same devices with the events of the replay.
        values: the app's named numbers, including the task's, after the last frame.
        finished: True if the app ended the round.
        frames: number of replayed frames.
        comparison: comparison of the recorded with the replayed events.
    """

    session: Session
    values: Mapping[str, float]
    finished: bool
    frames: int
    comparison: Comparison


def replay_session(
    session: Session,
    *,
    game: str | None = None,
    app: Mapping[str, Any] | None = None,
    options: Mapping[str, OptionValue] | None = None,
    log_dir: Path | None = None,
    renderer: str = "null",
    size: tuple[int, int] = (120, 80),
    watch: Callable[[AppClient, int, AppReply], None] = lambda client, i, reply: None,
    on_progress: Callable[[float], None] = lambda part: None,
) -> SessionReplay:
    """Replay a session.

    Args:
        game: name of a game of this runtime; None: ``app``, or the session's own game.
        app: settings of ``env.app`` for a page or another app, and its ``task``.
        options: of the app, over the session's.
        log_dir: keeps a game's own log here.
        renderer: what a game of this runtime draws with.
        size: (width, height) of another app's headset picture.
        watch: called after frame i with the app and its reply.
        on_progress: receives the part of the frames that is done.

    Raises:
        InputError: neither names an app, or the app cannot be played with the session's devices.
    """
    settings = dict(app or {})
    if is_recorded_round(session) and game in (None, WHACAMOLE) and "transport" not in settings:
        session = with_clock(session)
    elif session.source in RECORDED:
        session = replace(session, time_ns=times_of_log(session.time_ns / 1e9)[0])
    chosen = _chosen(session, game, settings, options)
    start_ns = 0 if chosen.kind == "game" else int(session.time_ns[0])
    recorder = EventRecorder(session.time_ns, len(session), on_progress)
    with ExitStack() as stack:
        if log_dir is None:
            log_dir = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        with _opened(session, chosen, settings, log_dir, renderer, size) as client:
            for_devices = session.devices()
            if "left_controller" in client.capabilities:
                devices_for = for_devices
            else:
                devices_for = replace(for_devices, left_controller=None, left_inputs=None)
            devices, times_ns = devices_for, session.time_ns - start_ns
            frames = ((int(time_ns), devices[i]) for i, time_ns in enumerate(times_ns))
            for i, reply in enumerate(client.play(session.seed or 0, frames)):
                recorder.take(i, reply)
                watch(client, i, reply)
        logs = sorted(log_dir.rglob("events.csv"))
        logged = logged_events(logs[-1]) if logs else ()
    events = sorted([*recorder.events, *logged], key=lambda event: event.time_ns)
    replayed = replace(
        session.frames(slice(0, recorder.frames)),
        events=tuple(events),
        app=chosen,
        seed=session.seed or 0,
        source="replay",
        notes=(),
    )
    return SessionReplay(
        session=replayed,
        values=recorder.values,
        finished=recorder.finished,
        frames=recorder.frames,
        comparison=compare_events(session, replayed),
    )


def _chosen(
    session: Session,
    game: str | None,
    settings: Mapping[str, Any],
    options: Mapping[str, OptionValue] | None,
) -> AppIdentity:
    """The app that is played, with its options."""
    recorded = session.app
    if game is not None and "transport" in settings:
        raise InputError("--game", "it together with another app", "one of them")
    given = {**_own_options(session), **settings.get("options", {}), **(options or {})}
    if settings.get("page"):
        page = Path(str(settings["page"]))  # the file, as recorders name it
        return AppIdentity("page", "index.html" if page.is_dir() else page.name, "", given)
    if "transport" in settings:
        named = _of_condition(recorded.name, recorded.condition) if recorded.kind == "game" else {}
        played = str(settings.get("game") or recorded.name)
        return AppIdentity("app", played, "", {**named, **given})
    name = game or (recorded.name if recorded.kind == "game" else "")
    if not name:
        got = f"a session of {recorded.name or 'an app that it does not name'}"
        raise InputError("SESSION", got, "the app to replay it in: --game NAME or --page FILE")
    condition = recorded.condition if recorded.name in ("", name) else ""
    named = _of_condition(name, condition)
    if not named and recorded.name not in ("", name):
        given = dict(options or {})
    return AppIdentity("game", name, condition, {**named, **given})


def _own_options(session: Session) -> dict[str, OptionValue]:
    """The recorded options; a file that a session names as its level lies in its own folder."""
    options = dict(session.app.options)
    level = options.get("level")
    if session.folder is None or session.app.kind != "game" or not isinstance(level, str):
        return options
    folder = session.folder.resolve()
    file = (folder / level).resolve()
    if file.exists() and file != folder and file.is_relative_to(folder):
        return {**options, "level": str(file)}
    if not level.isidentifier():
        expected = f"a level in the session's own folder; copy it to {folder}"
        raise InputError("SESSION, option level", shown(level, 80), expected)
    return options


def _of_condition(game: str, condition: str) -> dict[str, OptionValue]:
    """The options of a condition of a game of this runtime; none if it is not known."""
    facts = describe_game(game)
    known = any(each.name == condition for each in facts.conditions)
    return dict(facts.condition(condition).options) if known else {}


@contextmanager
def _opened(
    session: Session,
    chosen: AppIdentity,
    settings: Mapping[str, Any],
    log_dir: Path,
    renderer: str,
    size: tuple[int, int],
) -> Iterator[AppClient]:
    """The app, with its task where it has one; closed in the end."""
    judged = settings.get("task") is not None or chosen.kind == "page"
    task = load_task(settings.get("task")) if judged else None
    client: AppClient
    if chosen.kind == "game":
        clock = session.clock
        client = InProcessApp(
            chosen.name, chosen.options, renderer=renderer, log_dir=log_dir, clock=clock
        )
    else:
        known = {each.name for each in fields(AppPlace)}
        place = {key: value for key, value in settings.items() if key in known}
        wanted = AppsWanted(
            n=1,
            game=chosen.name,
            options=chosen.options,
            width=size[0],
            height=size[1],
            frequency_hz=round(session.frame_rate_hz or 20),
            place=AppPlace(**place),
            depth=False,  # no user sees it; programs without it can be replayed
            values={} if task is None else dict(task.values),
            page_start=session.page_start,
        )
        starts = str(settings["transport"]).startswith("protocol") and not place.get("connect")
        apps = transport_named(str(settings["transport"])).apps(wanted)
        client = apps(0, log_dir if starts else None)  # programs and pages write no logs
    with closing(client):
        yield client if task is None else TaskedApp(client, task, ends=False)


def counted_events(
    time_ns: int, before: Mapping[str, float], log: Mapping[str, float]
) -> list[SessionEvent]:
    """Return the events of a task that have happened since the log before, by their counts."""
    events = []
    for key, count in log.items():
        if key.endswith(_COUNT):
            new = round(count - before.get(key, 0.0))
            events += [SessionEvent(time_ns, key.removesuffix(_COUNT))] * max(0, new)
    return events


class EventRecorder:
    """Collects what an app sends back: vibrations, sounds, whole values that change, the end.

    Args:
        times_ns: (N,) times of the frames, on the session's clock.
        count: frames that there will be, for the progress.
        on_progress: receives the part that is done.
    """

    def __init__(
        self,
        times_ns: NDArray[np.int64],
        count: int,
        on_progress: Callable[[float], None] = lambda part: None,
    ) -> None:
        self.events: list[SessionEvent] = []
        self.values: Mapping[str, float] = {}
        self.finished = False
        self.frames = 0
        self._times_ns, self._count, self._on_progress = times_ns, count, on_progress
        self._known: dict[str, Any] = {}
        self._log: Mapping[str, float] = {}

    def take(self, i: int, reply: AppReply) -> None:
        """Take the reply to frame i."""
        time_ns = int(self._times_ns[i])
        for pulse in reply.haptics:
            self.events.append(SessionEvent(time_ns, "haptic", vars(pulse)))
        for sound in reply.sounds:
            data = {**vars(sound), "position_m": list(sound.position_m)}
            self.events.append(SessionEvent(time_ns, "sound", data))
        self.events += counted_events(time_ns, self._log, reply.log)
        self._log = reply.log
        for name, value in reply.values.items():
            whole = isinstance(value, (bool, int)) or (
                isinstance(value, float) and value.is_integer()
            )
            if whole and value != self._known.get(name):
                if name in self._known:
                    data = {"name": name, "value": value}
                    self.events.append(SessionEvent(time_ns, "value", data))
                self._known[name] = value
        if reply.finished and not self.finished:
            self.events.append(SessionEvent(time_ns, "end"))
        self.finished |= reply.finished
        self.values, self.frames = reply.log, i + 1
        if i % 20 == 0 or i + 1 == self._count:
            self._on_progress((i + 1) / self._count)


# --- a recording's events against those of its replay ---------------------------------------------

WINDOW_S = 0.1
"""An event of the replay is a recorded one again if it is like it and this close in time."""
_SAME_FRAMES = 1.01
_NUMBER_TOLERANCE = 1e-2
_DRIFT_PAIRS = 5
_END = "end"

Pair = tuple[SessionEvent, SessionEvent]


@dataclass(frozen=True)
class Counts:
    """Events of one kind: recorded, replayed, recorded ones that came again."""

    recorded: int
    replayed: int
    again: int


@dataclass(frozen=True)
class Divergence:
    """The first difference.

    Attributes:
        time_s: from the first frame.
        text: the event, and what happened to it.
        cause: the likely cause, a sentence.
    """

    time_s: float
    text: str
    cause: str


@dataclass(frozen=True)
class Comparison:
    """A recording's events against its replay's.

    Attributes:
        recorded: events of the recording.
        again: those that came again within :data:`WINDOW_S`.
        same_frame: those of them in the same frame.
        extra: events of the replay, of kinds that the recording has, without a recorded one.
        kinds: per kind.
        first: the first difference; None: none.
    """

    recorded: int
    again: int
    same_frame: int
    extra: int
    kinds: Mapping[str, Counts] = field(default_factory=dict)
    first: Divergence | None = None

    @property
    def same(self) -> bool:
        """True if the replay has every recorded event in its frame, and no other event."""
        return self.recorded == self.same_frame and not self.extra


def compare_events(recording: Session, replayed: Session) -> Comparison:
    """Compare the events of the kinds that the recording has; both begin with the first frame.

    Events match if kind, texts, booleans and integers are equal. Other numbers may differ by 1 %,
    because positions and speeds are computed from rounded poses.
    """
    kinds = {event.kind for event in recording.events} - {_END}
    ours = _from_start(recording, kinds)
    kinds = {event.kind for event in ours}
    theirs = _from_start(replayed, kinds)
    pairs, missing, extra = _paired(ours, theirs)
    frame_ns = _SAME_FRAMES * 1e9 / (recording.frame_rate_hz or 1e9)
    late = [pair for pair in pairs if abs(pair[1].time_ns - pair[0].time_ns) > frame_ns]
    wrong = [pair for pair in pairs if _numbers_differ(*pair)]
    first = _first(recording, replayed, pairs, missing, extra, late, wrong)
    again = [pair[0].kind for pair in pairs]
    return Comparison(
        recorded=len(ours),
        again=len(pairs),
        same_frame=len(pairs) - len(late),
        extra=len(extra),
        kinds={
            kind: Counts(
                sum(event.kind == kind for event in ours),
                sum(event.kind == kind for event in theirs),
                again.count(kind),
            )
            for kind in sorted(kinds)
        },
        first=first,
    )


def _from_start(session: Session, kinds: Iterable[str]) -> list[SessionEvent]:
    """Events of the kinds up to the last frame, by the time since the first one."""
    start, end = int(session.time_ns[0]), int(session.time_ns[-1])
    return [
        SessionEvent(event.time_ns - start, event.kind, event.data)
        for event in session.events
        if event.kind in kinds and event.time_ns <= end
    ]


def _key(event: SessionEvent) -> tuple[Any, ...]:
    exact = [
        (name, value)
        for name, value in sorted(event.data.items())
        if isinstance(value, (str, bool, int)) or (isinstance(value, float) and value.is_integer())
    ]
    return event.kind, *exact


def _paired(
    recorded: Sequence[SessionEvent], replayed: Sequence[SessionEvent]
) -> tuple[list[Pair], list[SessionEvent], list[SessionEvent]]:
    """Pairs of events that are like each other, and those of either side without one."""
    waiting: dict[tuple[Any, ...], list[SessionEvent]] = defaultdict(list)
    for event in reversed(replayed):
        waiting[_key(event)].append(event)
    pairs, missing, extra = [], [], []
    window_ns = WINDOW_S * 1e9
    for event in recorded:
        like = waiting[_key(event)]
        while like and like[-1].time_ns < event.time_ns - window_ns:
            extra.append(like.pop())
        if like and like[-1].time_ns <= event.time_ns + window_ns:
            pairs.append((event, like.pop()))
        else:
            missing.append(event)
    extra += [event for like in waiting.values() for event in like]
    return pairs, missing, extra


def _numbers_differ(recorded: SessionEvent, replayed: SessionEvent) -> bool:
    for name, value in recorded.data.items():
        if isinstance(value, (float, list, tuple)):
            other = replayed.data.get(name)
            if other is None or np.shape(value) != np.shape(other):
                return True
            size = max(1.0, float(np.max(np.abs(value), initial=0.0)))
            if np.any(np.abs(np.subtract(value, other)) > _NUMBER_TOLERANCE * size):
                return True
    return False


def _first(
    recording: Session,
    replayed: Session,
    pairs: Sequence[Pair],
    missing: Sequence[SessionEvent],
    extra: Sequence[SessionEvent],
    late: Sequence[Pair],
    wrong: Sequence[Pair],
) -> Divergence | None:
    found = [(event.time_ns, f"{_named(event)} did not come") for event in missing]
    found += [(event.time_ns, f"{_named(event)} came, not recorded") for event in extra]
    for ours, theirs in late:
        by_ms = (theirs.time_ns - ours.time_ns) * 1e-6
        text = f"{_named(ours)} came {abs(by_ms):.0f} ms {'later' if by_ms > 0 else 'earlier'}"
        found.append((min(ours.time_ns, theirs.time_ns), text))
    found += [(ours.time_ns, f"{_named(ours)} came with other numbers") for ours, _ in wrong]
    if not found:
        return None
    time_ns, text = min(found)
    return Divergence(time_ns * 1e-9, text, _cause(recording, replayed, pairs, time_ns))


def _named(event: SessionEvent) -> str:
    parts = [
        f"{name} {str(value)[:20]}"
        for name, value in event.data.items()
        if isinstance(value, (str, int))
    ]
    return f"{event.kind} ({', '.join(parts[:3])})" if parts else event.kind


def _cause(recording: Session, replayed: Session, pairs: Sequence[Pair], time_ns: int) -> str:
    """The likeliest cause of a first difference, by what the session lacks and how times drift."""
    ours, theirs = recording.app, replayed.app
    # A page or app that was copied under another name does the same.
    if ours.name and ours.name != theirs.name and (ours.kind == "game" or not pairs):
        return f"the session is of {ours.name}, the replay of {theirs.name}"
    if recording.seed is None:
        return "seed: the session has none, so the app drew other random numbers"
    drift = _drift(recording, pairs)
    if drift:
        return drift
    times = recording.time_ns - recording.time_ns[0]
    near = times[(times <= time_ns) & (times >= time_ns - 10**9)]
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if len(near) > 1 and np.diff(near).max() > 1.5 * usual:
        longest_ms = float(np.diff(near).max()) * 1e-6
        gap = (
            f"frame rate: a frame before it lasts {longest_ms:.0f} ms instead of "
            f"{usual * 1e-6:.0f} ms"
        )
    else:
        gap = ""
    if gap:
        return gap
    if not pairs and not {one.kind for one in recording.events} & {
        one.kind for one in replayed.events
    }:
        return "no event of these kinds came: the app reports none here, or had other options"
    if not pairs:
        return "no event came again: other options, or chance that the seed does not govern"
    if recording.rounding_m:
        step_mm = recording.rounding_m * 1e3
        return (
            f"rounding: the source rounds positions to {step_mm:g} mm, and touches tip at an edge"
        )
    if theirs.kind == "page" and recording.page_start is None:
        return "start: the session does not say what the page did before the first frame"
    if all(one.inputs is None for one in recording.controllers.values()):
        return "inputs: the session has no triggers and buttons; or chance outside the seed"
    return "not known: chance that the seed does not govern, or time that the app reads elsewhere"


def _drift(recording: Session, pairs: Sequence[Pair]) -> str:
    """A sentence on times that differ more and more, or all by the same; empty: they do not."""
    if len(pairs) < _DRIFT_PAIRS:
        return ""
    at_s = np.array([ours.time_ns for ours, _ in pairs]) * 1e-9
    late_s = np.array([theirs.time_ns - ours.time_ns for ours, theirs in pairs]) * 1e-9
    half_frame_s = 0.5 / (recording.frame_rate_hz or 1.0)
    if np.ptp(at_s) > 0:
        slope = float(np.polyfit(at_s, late_s, 1)[0])
        if abs(slope) * np.ptp(at_s) > 2 * half_frame_s:
            return (
                f"time: events come {abs(slope) * 60e3:.0f} ms per minute "
                f"{'later' if slope > 0 else 'earlier'}; the app reads a clock outside the replay, "
                "such as a worker's, or the frame rate differs"
            )
    middle = float(np.median(late_s))
    if abs(middle) > half_frame_s:
        return (
            f"time: all events come {abs(middle) * 1e3:.0f} ms "
            f"{'later' if middle > 0 else 'earlier'}; the round did not begin with the first frame"
        )
    return ""
