"""A recording's events against those of its replay: how many came again, and where they part."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim2vr_harness.sessions.session import Session, SessionEvent

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
        """Whether every recorded event came again in its frame, and no other."""
        return self.recorded == self.same_frame and not self.extra


def compare_events(recording: Session, replayed: Session) -> Comparison:
    """Compare the events of the kinds that the recording has; both begin with the first frame.

    Events are like each other if kind, texts, truths and whole numbers are equal. Other numbers may
    differ by a hundredth of their size; positions and speeds follow from rounded poses.
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
    gap = _gap_before(recording, time_ns)
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


def _gap_before(recording: Session, time_ns: int) -> str:
    """A sentence on frames that are missing within a second before; empty: none are."""
    times = recording.time_ns - recording.time_ns[0]
    near = times[(times <= time_ns) & (times >= time_ns - 10**9)]
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if len(near) > 1 and np.diff(near).max() > 1.5 * usual:
        longest_ms = float(np.diff(near).max()) * 1e-6
        return (
            f"frame rate: a frame before it lasts {longest_ms:.0f} ms instead of "
            f"{usual * 1e-6:.0f} ms"
        )
    return ""
