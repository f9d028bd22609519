"""A session as it is measured: tool, hand and head, and what happened to its targets.

Rounds of a game that is described are measured in the coordinates of its targets' plane, those of
any other app by the hand. An app's events name its targets: ``spawn``, ``hit``, ``miss``, of games
of this runtime ``target_hit`` and so on. A session without them has them after a replay with the
task.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name
from sim2vr_harness.base.rotations import turned
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.sessions import Controller, Session, SessionEvent
from sim2vr_harness.sessions.logs import target_events
from sim2vr_harness.sessions.whacamole import places_of, plane_of

FloatArray = NDArray[np.float64]

_KINDS = {
    "spawn": ("spawn", "target_spawn", "box_spawn"),
    "hit": ("hit", "target_hit", "box_slice"),
    "miss": ("miss", "target_miss", "box_miss", "box_wrong_hand", "box_wrong_direction"),
}
_BOX = {"good": "hit", "bad": "miss", "miss": "miss"}
"""Outcomes of Beat Saber's boxes; they have the time of their spawn."""
_NUMBERS = ("target_id", "number", "value")
"""Names of the field for the target's number in events; without it, the oldest target ends
first."""

_ELSEWHERE = (0.0, 0.0)

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


@dataclass(frozen=True)
class Targets:
    """The targets of a round, in the order in which they came up; T of them.

    Attributes:
        spawn_s: (T,) when each came up, game time.
        end_s: (T,) when it was hit or missed; NaN if the round ended first.
        hit: (T,) whether it was hit.
        missed: (T,) whether it went away unhit.
        cell: (T,) where it was, as a number.
        place_m: (T, 2) where it was, x and y in the plane.
        logged_speed_mps: (T,) speed that the game logged with the hit; NaN without.
    """

    spawn_s: FloatArray
    end_s: FloatArray
    hit: NDArray[np.bool_]
    missed: NDArray[np.bool_]
    cell: NDArray[np.int64]
    place_m: FloatArray
    logged_speed_mps: FloatArray

    @property
    def n(self) -> int:
        """Number of targets that appeared."""
        return len(self.spawn_s)


@dataclass
class _Target:
    """A target while events are read; NaN and None: not yet, or never."""

    spawn_s: float
    cell: int
    end_s: float = np.nan
    hit: bool | None = None
    speed_mps: float = np.nan


def ending(event: SessionEvent) -> str | None:
    """Return ``hit`` or ``miss`` for an event that ends a target."""
    if event.kind == "box":
        return _BOX.get(str(event.data.get("outcome")))
    return next((kind for kind in ("hit", "miss") if event.kind in _KINDS[kind]), None)


def targets_of(
    events: Sequence[SessionEvent], places_m: Mapping[int, tuple[float, float]] | None = None
) -> Targets:
    """Return targets in the order of their spawns.

    Without spawns, each comes up as the one before ends. A target of which no spawn was recorded
    has none: NaN.

    Args:
        events: Of the app.
        places_m: Cell -> x and y in the plane; all in one place where there are none.
    """
    places = places_m or {}
    spawned = any(event.kind in _KINDS["spawn"] for event in events)
    up: dict[object, list[_Target]] = defaultdict(list)
    found: list[_Target] = []
    before_s = np.nan
    for event in events:
        time_s, how = event.time_ns / 1e9, ending(event)
        number = next((event.data[name] for name in _NUMBERS if name in event.data), None)
        cell = int(event.data["grid_id"]) if places else 0
        if event.kind in _KINDS["spawn"]:
            found.append(_Target(time_s, cell))
            up[number].append(found[-1])
        if how is None:
            continue
        if not up[number]:
            spawn_s = event.data.get("spawn_s", np.nan if spawned else before_s)
            found.append(_Target(float(spawn_s), cell))
            up[number].append(found[-1])
        target = up[number].pop(0)
        target.end_s, target.hit, before_s = time_s, how == "hit", time_s
        if target.hit and "velocity" in event.data:
            target.speed_mps = float(np.linalg.norm(event.data["velocity"]))
    cells = [target.cell for target in found]
    return Targets(
        spawn_s=np.array([target.spawn_s for target in found], dtype=np.float64),
        end_s=np.array([target.end_s for target in found], dtype=np.float64),
        hit=np.array([target.hit is True for target in found], dtype=np.bool_),
        missed=np.array([target.hit is False for target in found], dtype=np.bool_),
        cell=np.array(cells, dtype=np.int64),
        place_m=np.array([places.get(cell, _ELSEWHERE) for cell in cells]).reshape(-1, 2),
        logged_speed_mps=np.array([target.speed_mps for target in found], dtype=np.float64),
    )


@dataclass(frozen=True)
class PlayedRound:
    """Recorded data of a round: tool, hand and head of N frames, and outcomes of the targets.

    Attributes:
        source: file or folder of the recording.
        group: of people who play by the same rule.
        condition: its name in the recordings of people.
        person: the player.
        times_s: (N,) times of the frames of play, game time.
        tool_m: (N, 3) the tool in the plane's frame: x right, y up, z along its normal away from
            the player.
        root_m: (N, 3) the point whose speed the game tests, in the same frame.
        controller: (N, 4) rotation of the controller that holds the tool, x y z w, app's world.
        head: (N, 7) pose of the head, app's world: m, x y z w.
        targets: targets that appeared.
        contacts: touches that were too slow to count.
        ahead_m: of a session, (N, 3) the point 0.3 m ahead on the hand's ray; else None.
        other_m: of a session with two hands, (N, 3) the hand that moved less; else None.
    """

    source: Path
    group: str
    condition: str
    person: str
    times_s: FloatArray
    tool_m: FloatArray
    root_m: FloatArray
    controller: FloatArray
    head: FloatArray
    targets: Targets
    contacts: int
    ahead_m: FloatArray | None = None
    other_m: FloatArray | None = None


def round_of(session: Session, behaviour: Behaviour, person: str) -> PlayedRound | None:
    """Return a session as a round to measure; None for a condition that is not compared.

    Args:
        session: As it was read.
        person: The player.

    Raises:
        InputError: It is no round of this game, or data for a measure are missing in it.
    """
    if behaviour.any_app:
        return _round_of_any_app(session, person)
    known = behaviour.recognise(session.app.condition)
    if known is None:
        return None
    path = session.path or Path()
    tool, plane = session.objects.get(behaviour.tool), plane_of(session)
    if tool is None:
        expected = f"columns {behaviour.tool}_pos_x ..., as in a log of {behaviour.game}"
        raise InputError(file_name(path), f"poses of {shown(sorted(session.objects))}", expected)
    if plane is None:
        expected = f"the pose of the targets' plane, as in a log of {behaviour.game}"
        raise InputError(file_name(path), "none", expected)
    controller = session.left or session.right
    if controller is None:
        raise InputError(file_name(path), "no controller that is on", f"the {behaviour.tool}'s")
    hand, root = controller.grip, np.array(behaviour.root_m)
    if session.left is not None:  # held the other way round: mirrored
        root = root * (-1.0, 1.0, 1.0)
    at, turn = plane[:3], plane[3:] * (-1.0, -1.0, -1.0, 1.0)
    play = slice(1, None)  # frame 0 placed the target area
    return PlayedRound(
        source=path,
        group=known[0],
        condition=known[1],
        person=person,
        times_s=session.time_ns[play] / 1e9,
        tool_m=rotated(turn, tool[play, :3] - at),
        root_m=rotated(turn, hand[play, :3] + rotated(hand[play, 3:], root) - at),
        controller=hand[play, 3:],
        head=session.head[play],
        targets=_targets(session, behaviour),
        contacts=sum(event.kind == "contact" for event in target_events(session)),
    )


def _targets(session: Session, behaviour: Behaviour) -> Targets:
    known = dict(enumerate(behaviour.places_m)) | places_of(session)
    cells = {event.cell for event in target_events(session)}
    unknown = sorted(cells - known.keys())
    if unknown or not cells:
        got = f"cell {unknown[0]}" if unknown else "no target"
        expected = f"one of the {len(known)} of {behaviour.game}"
        if not cells:
            expected = f"targets that come up, as in a round of {behaviour.game}"
        raise InputError(file_name(session.path or Path()), got, expected)
    return targets_of([each for each in session.events if "grid_id" in each.data], known)


def rotated(turn: FloatArray, vectors: FloatArray) -> FloatArray:
    """Turn vectors (..., 3) by unit quaternions (..., 4), x y z w."""
    return turned(turn[..., :3], turn[..., 3:], vectors)


# --- any app -------------------------------------------------------------------------------------


def behaviour_of_sessions(name: str, sessions: Sequence[Session]) -> Behaviour:
    """Return the description of an app for the measures, from its sessions.

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
    """Return whether a session's events name targets that were hit or missed."""
    return any(event is not None for event in map(ending, session.events))


def _round_of_any_app(session: Session, person: str) -> PlayedRound:
    hands = {
        side: _known(one) for side, one in session.controllers.items() if one.tracked.sum() > 1
    }
    if not hands:
        raise InputError(
            session.name or "SESSION", "a session without a controller", "a hand to be measured"
        )
    paths = {
        side: float(np.linalg.norm(np.diff(one.grip[:, :3], axis=0), axis=1).sum())
        for side, one in hands.items()
    }
    side = max(paths, key=lambda each: paths[each])
    hand, others = hands[side], [one for name, one in hands.items() if name != side]
    start_m = session.head[0, :3]
    ray = hand.ray()
    ahead = ray[:, :3] + rotated(ray[:, 3:], np.array([0.0, 0.0, _AHEAD_M]))
    place = hand.grip[:, :3] - start_m
    times_s, rows = np.unique(session.time_ns * 1e-9, return_index=True)
    return PlayedRound(
        source=session.path or Path(),
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


def _known(one: Controller) -> Controller:
    """Return a controller whose pose is kept while it is not tracked."""
    frames = np.arange(len(one.grip))
    last = np.maximum.accumulate(np.where(one.tracked, frames, 0))
    last = np.where(one.tracked[last], last, int(np.argmax(one.tracked)))
    return Controller(one.grip[last], None if one.aim is None else one.aim[last])
