"""Recorded sessions of any app as rounds to be measured: the hand, the head, and targets if named.

An app's events name its targets: ``spawn``, ``hit``, ``miss``, of games of this runtime
``target_hit`` and so on. A session without them has them after a replay with the task.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.persons import RoundMeasures, measure_round
from sim2vr_harness.human_comparison.rounds import PlayedRound, rotated
from sim2vr_harness.human_comparison.targets import ending, targets_of
from sim2vr_harness.sessions import Controller, Session

FloatArray = NDArray[np.float64]

GROUP = "sessions"
_ROUND = "round"
_AHEAD_M = 0.3
_NEED_PLANE = frozenset(
    (
        *("depth_median", "depth_p5", "depth_p95", "d_depth", "retreat", "depth_at_spawn"),
        *("overshoot", "endpoint_error", "endpoint_sd", "cell_hit_rates", "worst_cell"),
        *("hit_speed", "hit_speed_p5", "hit_speed_p95", "hit_speed_game", "wrist_ratio"),
        *("oldest_first", "nearest_first", "choices_share"),
    )
)
_NEED_TARGETS = frozenset(
    (
        *("hits", "hit_rate", "misses", "tth_median", "tth_p5", "tth_p95", "tth_iqr"),
        *("fast_hits", "ihi_median", "ihi_cv", "peak_speed", "peak_speed_cv", "path_per_hit"),
        *("peaks_per_hit", "sparc", "ldlj", "d_hit_rate", "d_tth", "d_peak_speed"),
    )
)
_HEADLINES = (
    *("hits", "hit_rate", "tth_median", "first_movement", "movement_time", "top_speed"),
    *("path_per_min", "rms_jerk", "wrist_share", "head_range"),
)


def behaviour_of_sessions(name: str, sessions: Sequence[Session]) -> Behaviour:
    """Return what the measures need to know of an app, from its sessions.

    Args:
        name: of the app.
        sessions: of people and users; targets are measured if one of them has some.
    """
    conditions = tuple(dict.fromkeys(map(name_of_condition, sessions)))
    targets = any(map(has_targets, sessions))
    return Behaviour(
        game=name,
        tool="",
        root_m=(0.0, 0.0, 0.0),
        places_m=((0.0, 0.0),),
        groups={GROUP: ""},
        conditions={each: (each,) for each in conditions},
        without=_NEED_PLANE | (frozenset() if targets else _NEED_TARGETS),
        headlines=tuple((each, measure) for each in conditions for measure in _HEADLINES),
        any_app=True,
    )


def name_of_condition(session: Session) -> str:
    """Return the condition that a session is compared in: a game's, else one for all."""
    return session.app.condition or _ROUND if session.app.kind == "game" else _ROUND


def has_targets(session: Session) -> bool:
    """Whether a session's events name targets that were hit or missed."""
    return any(event is not None for event in map(ending, session.events))


def measure_session(
    session: Session, behaviour: Behaviour, person: str, source: Path
) -> RoundMeasures:
    """Measure a session.

    Raises:
        InputError: it has no hand, or is too short.
    """
    hands = {
        side: _known(one) for side, one in session.controllers.items() if one.tracked.sum() > 1
    }
    if not hands:
        raise InputError(source.name, "a session without a controller", "a hand to be measured")
    paths = {side: _path_m(one.grip[:, :3]) for side, one in hands.items()}
    side = max(paths, key=lambda each: paths[each])
    hand, others = hands[side], [one for name, one in hands.items() if name != side]
    start_m = session.head[0, :3]
    ray = hand.ray()
    ahead = ray[:, :3] + rotated(ray[:, 3:], np.array([0.0, 0.0, _AHEAD_M]))
    place = hand.grip[:, :3] - start_m
    times_s, rows = np.unique(session.time_ns * 1e-9, return_index=True)
    played = PlayedRound(
        source=source,
        group=GROUP,
        condition=name_of_condition(session),
        person=person,
        times_s=times_s,
        tool_m=place[rows],
        root_m=place[rows],
        controller=hand.grip[rows, 3:],
        head=session.head[rows],
        targets=targets_of(session.events),
        contacts=0,
        ahead_m=ahead[rows],
        other_m=others[0].grip[rows, :3] if others else None,
    )
    return measure_round(played, behaviour)


def _known(one: Controller) -> Controller:
    """A controller whose pose stays as it was while it is not tracked."""
    frames = np.arange(len(one.grip))
    last = np.maximum.accumulate(np.where(one.tracked, frames, 0))
    last = np.where(one.tracked[last], last, int(np.argmax(one.tracked)))
    return Controller(one.grip[last], None if one.aim is None else one.aim[last])


def _path_m(places: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
