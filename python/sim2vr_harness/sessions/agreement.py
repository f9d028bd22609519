"""Agreement of a replayed round of Whac-A-Mole with its recording, per target and per hit."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim2vr_harness.sessions.logs import TargetEvent, target_events
from sim2vr_harness.sessions.session import Session
from sim2vr_harness.sessions.whacamole import constrained, printed

# Hits are the same hit when they are of the same target and this close in time.
WINDOWS_S = (0.050, 0.100)
# Event lists are identical when the same things happened to the same targets in the same cells,
# each within this time: one frame and one fixed step of people's rounds (14 ms each). A spawn that
# a rounded time puts into the next frame can move its miss by both.
IDENTICAL_S = 0.030
_SAME_SPAWN_S = 0.020

_Key = tuple[str, int, int, int]


@dataclass(frozen=True)
class Agreement:
    """Counts and differences of one round, or of several pooled.

    Attributes:
        rounds: How many rounds.
        identical_rounds: Those with identical event lists.
        targets: Recorded targets.
        agreeing: Targets with the same outcome (hit, miss, or alive at the end).
        recorded: Events per kind in the recording.
        predicted: Events per kind in the replay.
        matched: Recorded hits that were predicted within 50 and 100 ms.
        dt_s: Predicted minus recorded time of the hits found within 50 ms, both as printed.
        dv_mps: Length of the difference of their velocities.
        same_step: Of them, those in the same fixed step.
        first_divergence_s: Seconds from the first frame of play to the first difference of the
            event lists; None when there is none, or for pooled rounds.
    """

    rounds: int
    identical_rounds: int
    targets: int
    agreeing: int
    recorded: Counter[str]
    predicted: Counter[str]
    matched: tuple[int, int]
    dt_s: np.ndarray
    dv_mps: np.ndarray
    same_step: int
    first_divergence_s: float | None = None

    @property
    def identical(self) -> float:
        """Share of rounds with identical event lists."""
        return self.identical_rounds / self.rounds


def agreement_of(recording: Session, replayed: Session) -> Agreement:
    """Compare a replay with its recording.

    Args:
        recording: as it was read.
        replayed: the replay, with its clock.
    """
    assert replayed.clock is not None
    recorded, predicted = target_events(recording), target_events(replayed)
    spawned, spawned_again = (_of_kind(each, "spawn") for each in (recorded, predicted))
    # In a closed loop, target 7 of the replay is the recorded one only if it is the same spawn.
    same = {
        target
        for target, event in spawned.items()
        if (again := spawned_again.get(target)) is not None
        and again.cell == event.cell
        and _apart(again, event) <= _SAME_SPAWN_S
    }
    ends, ends_again = (
        {target: event.kind for target, event in _of_kind(each, "hit", "miss").items()}
        for each in (recorded, predicted)
    )
    agreeing = sum(ends.get(target) == ends_again.get(target) for target in same)
    hits, hits_again = (_of_kind(each, "hit") for each in (recorded, predicted))
    apart = {
        target: _apart(hits_again[target], hits[target])
        for target in same & hits.keys() & hits_again.keys()
    }
    within = [sum(abs(dt) <= window for dt in apart.values()) for window in WINDOWS_S]
    pairs = [t for t, dt in apart.items() if abs(dt) <= WINDOWS_S[0]]
    dt = [printed(hits_again[t].time_s) - printed(hits[t].time_s) for t in pairs]
    half_step_s = replayed.clock.fixed_delta_time_s / 2
    # Time of the first event that the other list does not have, s; None: the lists agree.
    ours, theirs = _keyed(predicted), _keyed(recorded)
    differing = [
        min(event.time_s for event in (ours.get(key), theirs.get(key)) if event is not None)
        for key in ours.keys() | theirs.keys()
        if key not in ours or key not in theirs or _apart(ours[key], theirs[key]) > IDENTICAL_S
    ]
    divergence = min(differing, default=None)
    play_start_s = float(recording.time_ns[1] / 1e9)
    return Agreement(
        rounds=1,
        identical_rounds=int(divergence is None),
        targets=len(spawned),
        agreeing=agreeing,
        recorded=Counter(event.kind for event in recorded),
        predicted=Counter(event.kind for event in predicted),
        matched=(within[0], within[1]),
        dt_s=np.array(dt),
        dv_mps=np.array([_velocity_difference(hits_again[t], hits[t]) for t in pairs]),
        same_step=int(sum(abs(d) < half_step_s for d in dt)),
        first_divergence_s=None if divergence is None else max(0.0, divergence - play_start_s),
    )


def pooled(parts: Sequence[Agreement]) -> Agreement:
    """Rounds taken together: every target and every hit counts the same.

    Raises:
        ValueError: No rounds.
    """
    if not parts:
        raise ValueError("parts: got no rounds, expected one or more")
    return Agreement(
        rounds=sum(part.rounds for part in parts),
        identical_rounds=sum(part.identical_rounds for part in parts),
        targets=sum(part.targets for part in parts),
        agreeing=sum(part.agreeing for part in parts),
        recorded=sum((part.recorded for part in parts), Counter()),
        predicted=sum((part.predicted for part in parts), Counter()),
        matched=(sum(p.matched[0] for p in parts), sum(p.matched[1] for p in parts)),
        dt_s=np.concatenate([part.dt_s for part in parts]),
        dv_mps=np.concatenate([part.dv_mps for part in parts]),
        same_step=sum(part.same_step for part in parts),
    )


def as_json(part: Agreement) -> dict[str, Any]:
    """Return the figures as plain values; a share of nothing is None."""
    hits, hits_again = part.recorded["hit"], part.predicted["hit"]
    return {
        "targets": part.targets,
        "outcome_agreement": _share(part.agreeing, part.targets),
        "hit_recall_50ms": _share(part.matched[0], hits),
        "hit_precision_50ms": _share(part.matched[0], hits_again),
        "hit_recall_100ms": _share(part.matched[1], hits),
        "hit_precision_100ms": _share(part.matched[1], hits_again),
        "same_step": _share(part.same_step, len(part.dt_s)),
        "mean_abs_dt_s": _or_none(np.abs(part.dt_s), np.mean),
        "dv_median": _or_none(part.dv_mps, np.median),
        "dv_p95": _or_none(part.dv_mps, lambda dv: np.quantile(dv, 0.95)),
        "hits_recorded": hits,
        "hits_predicted": hits_again,
        "misses_recorded": part.recorded["miss"],
        "misses_predicted": part.predicted["miss"],
        "contacts_recorded": part.recorded["contact"],
        "contacts_predicted": part.predicted["contact"],
    }


def rounds_json(
    rounds: Sequence[tuple[str, Session, Agreement]], *, closed_loop: bool
) -> dict[str, Any]:
    """``rounds`` (a list) and ``total`` (all rounds, and ``constrained``/``unconstrained``).

    Args:
        rounds: name, recording and agreement of each.
        closed_loop: whether spawns were predicted as well.
    """
    parts = {
        wanted: [part for _, session, part in rounds if constrained(session) == wanted]
        for wanted in (True, False)
    }
    return {
        "rounds": [
            {
                "name": name,
                "source": str(session.path),
                "condition": session.app.condition,
                "constrained": constrained(session),
                "closed_loop": closed_loop,
                **as_json(part),
                "identical": part.identical_rounds == 1,
                "first_divergence_s": part.first_divergence_s,
            }
            for name, session, part in rounds
        ],
        "total": {
            **(_total([part for *_, part in rounds]) or {}),
            "constrained": _total(parts[True]),
            "unconstrained": _total(parts[False]),
        },
    }


def _total(parts: Sequence[Agreement]) -> dict[str, Any] | None:
    if not parts:
        return None
    total = pooled(parts)
    identical = {"identical": total.identical, "identical_rounds": total.identical_rounds}
    return {"rounds": total.rounds, **as_json(total), **identical}


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _or_none(values: np.ndarray, statistic: Any) -> float | None:
    return float(statistic(values)) if len(values) else None


def _apart(a: TargetEvent, b: TargetEvent) -> float:
    return abs(a.time_s - b.time_s)


def _velocity_difference(a: TargetEvent, b: TargetEvent) -> float:
    if a.velocity_mps is None or b.velocity_mps is None:
        return float("nan")
    return float(np.linalg.norm(np.subtract(a.velocity_mps, b.velocity_mps)))


def _keyed(events: Iterable[TargetEvent]) -> dict[_Key, TargetEvent]:
    """Events by kind, target, cell and how many like it came before.

    The order of events within a fixed step does not matter: nothing depends on it.
    """
    keyed: dict[_Key, TargetEvent] = {}
    for event in sorted(events, key=lambda event: event.time_s):
        count = 0
        while (event.kind, event.target, event.cell, count) in keyed:
            count += 1
        keyed[event.kind, event.target, event.cell, count] = event
    return keyed


def _of_kind(events: Iterable[TargetEvent], *kinds: str) -> dict[int, TargetEvent]:
    return {event.target: event for event in events if event.kind in kinds}
