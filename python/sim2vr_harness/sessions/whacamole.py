"""Recorded rounds of Whac-A-Mole: their packed form, their targets' plane and their clock.

A packed round is ``NAME.npz`` with ``NAME_events.csv``, listed in a ``manifest.json`` beside them;
``logs.py`` reads the logs. Both keep times as they were logged: rounded, and without the frame that
started play. :func:`with_clock` works out what repeats the round.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_arrays, read_json
from sim2vr_harness.client import ClockSettings, OptionValue
from sim2vr_harness.sessions.checks import LATEST_NS
from sim2vr_harness.sessions.logs import (
    DIGITS,
    GRID,
    PLANE,
    WHACAMOLE,
    TargetEvent,
    rounding_s,
    target_event,
    target_events,
    times_of_log,
)
from sim2vr_harness.sessions.session import (
    AppIdentity,
    Controller,
    FloatArray,
    Session,
    SessionEvent,
)
from sim2vr_harness.sessions.state_log import read_lines

PACKED = "packed round"
RECORDED = ("log", PACKED)
"""Sources whose times are as they were logged."""
UNCONSTRAINED = "-unconstrained"
"""End of a condition in which every touch is a hit."""

_LEAST_FRAMES = 3
_PLACE = re.compile(
    r"\[(?P<cell>\d+) \d+ \d+ (?P<x>-?[\d.]+(?:E-?\d+)?) (?P<y>-?[\d.]+(?:E-?\d+)?) "
)
_PERIOD = "a period from 0.0001 to 1 s"
# Of simulated users and of people in the original (binary32 in both).
_FIXED_STEPS_S = (1.0 / 70.0, 0.002)
_STUDY_STEP_S = 0.014285714
_ROUND_S = 60.0
# A gap this long before the first frame of play is the countdown.
_SHORTEST_COUNTDOWN_S = 0.5
# A fixed step belongs to the first frame with k h <= t + this, for rounded t. Results are the same
# within 0.1 % from -2e-5 to 2e-5.
_TOLERANCE_S = 1e-5
# Log times are game times: what a hitch took from the game is not in them.
_NO_MAXIMUM_S = 120.0


def is_recorded_round(session: Session) -> bool:
    """Return True if a session is a log or a packed round of Whac-A-Mole."""
    return session.app.name == WHACAMOLE and session.source in RECORDED


def constrained(session: Session) -> bool:
    """Return True if hits of this session required a minimum speed."""
    return not session.app.condition.endswith(UNCONSTRAINED)


def without_constraint(session: Session) -> Session:
    """Return a round in which every touch was a hit; logs of the original do not record this."""
    if not constrained(session):
        return session
    condition = session.app.condition + UNCONSTRAINED
    return replace(session, app=replace(session.app, condition=condition))


def plane_of(session: Session) -> FloatArray | None:
    """(7,) pose of the targets' plane: x right, y up, z away from the player; None: not known."""
    found = (each.data["value"] for each in session.events if each.kind == PLANE)
    plane = next(found, None)
    return None if plane is None else np.array(plane, dtype=np.float64)


def places_of(session: Session) -> dict[int, tuple[float, float]]:
    """Cell -> x and y of its target in the plane, m, as far as the session says."""
    text = next((str(each.data.get("text")) for each in session.events if each.kind == GRID), "")
    return {int(x["cell"]): (float(x["x"]), float(x["y"])) for x in _PLACE.finditer(text)}


# --- the packed form -----------------------------------------------------------------------------


def packed_rounds(manifest: Path) -> list[Path]:
    """Return the files of the rounds that a ``manifest.json`` lists.

    Raises:
        InputError: it is none.
    """
    return [manifest.parent / f"{trial['file']}.npz" for trial in _trials(manifest)]


def _trials(manifest: Path) -> list[dict[str, Any]]:
    expected = "a JSON object with a list 'trials'"
    trials = read_json(manifest, expected).get("trials")
    if not isinstance(trials, list):
        raise InputError(file_name(manifest), f"trials: {shown(trials, 40)}", expected)
    for trial in trials:
        if not isinstance(trial, dict) or not _is_file_name(trial.get("file")):
            expected = "trials with the name of a file beside the manifest"
            raise InputError(file_name(manifest), shown(trial, 60), expected)
    return [trial for trial in trials if trial.get("file") and "seed" in trial]


def _is_file_name(name: Any) -> bool:
    """Return True for the name of a file in the manifest's folder, or None (a missing file)."""
    return name is None or (isinstance(name, str) and Path(name).name == name)


def read_packed(file: Path) -> Session:
    """Read a packed round.

    Raises:
        InputError: a file is missing or has invalid content; names file and key, or line.
    """
    manifest = file.with_name("manifest.json")
    if not manifest.is_file():
        expected = "a manifest.json beside it, which has its condition and seed"
        raise InputError("PATH", repr(str(file)), expected)
    found = next((each for each in _trials(manifest) if each["file"] == file.stem), None)
    if found is None:
        raise InputError(str(manifest), f"no trial {file.stem!r}", "one for every packed round")
    trial = _checked_trial(file, found)
    expected = "numbers t (N,), head and right (N, 7), N of 3 or more, in an .npz file"
    arrays = read_arrays(file, expected)
    for key in ("t", "head", "right"):
        if key not in arrays or arrays[key].dtype.kind not in "fiu":
            got = f"{key} of {arrays[key].dtype}" if key in arrays else f"no array {key!r}"
            raise InputError(file_name(file), got, expected)
    t, head, right = (arrays[key].astype(float) for key in ("t", "head", "right"))
    if not (t.ndim == 1 and len(t) >= 3 and head.shape == right.shape == (len(t), 7)):
        got = f"shapes {t.shape}, {head.shape}, {right.shape}"
        raise InputError(file_name(file), got, expected)
    if not (np.abs(t) <= LATEST_NS / 1e9).all():
        frame = int(np.argmin(np.abs(t) <= LATEST_NS / 1e9))
        raise InputError(
            f"{file_name(file)}, frame {frame}", f"the time {t[frame]:g}", "0 to 1e9 s"
        )
    time_ns = np.rint(t * 1e9).astype(np.int64)
    step, condition = trial.get("fixed_timestep"), trial["condition"]
    if not trial.get("constrained", True) and not condition.endswith(UNCONSTRAINED):
        condition += UNCONSTRAINED
    plane = _packed_plane(file, trial)
    return Session(
        time_ns=time_ns,
        head=head,
        right=Controller(right),
        objects={
            key: array.astype(float)
            for key, array in arrays.items()
            if key not in ("t", "head", "right")
            and array.dtype.kind in "fiu"
            and array.shape == (len(t), 7)
        },
        events=(
            *([] if plane is None else [SessionEvent(int(time_ns[0]), PLANE, {"value": plane})]),
            *_packed_events(file.with_name(f"{file.stem}_events.csv")),
        ),
        app=AppIdentity("game", WHACAMOLE, condition),
        seed=trial["seed"] % 2**32,
        clock=None if step is None else ClockSettings(fixed_delta_time_s=step),
        source=PACKED,
        person="" if trial.get("participant") is None else str(trial["participant"]),
    )


def _packed_plane(file: Path, trial: Mapping[str, Any]) -> list[float] | None:
    parts = [trial.get("plane_pos", ()), trial.get("plane_quat_xyzw", ())]
    if parts == [(), ()]:
        return None
    try:
        plane = np.array([float(number) for part in parts for number in part])
    except (TypeError, ValueError):
        plane = np.zeros(0)
    if plane.shape != (7,) or not np.isfinite(plane).all():
        place = f"{file_name(file.with_name('manifest.json'))}, trial {file_name(file.stem)}"
        raise InputError(
            f"{place}: plane_pos, plane_quat_xyzw", shown(parts, 60), "3 and 4 numbers"
        )
    numbers: list[float] = plane.tolist()
    return numbers


def _checked_trial(file: Path, trial: dict[str, Any]) -> dict[str, Any]:
    """A trial of the manifest with what a replay needs of it, all of the right kind."""
    step = trial.get("fixed_timestep")
    number = isinstance(step, (int, float)) and not isinstance(step, bool)
    for key, wrong, expected in (
        ("condition", not isinstance(trial.get("condition"), str), "the name of a condition"),
        ("seed", type(trial.get("seed")) is not int, "a whole number"),
        ("constrained", type(trial.get("constrained", True)) is not bool, "true or false"),
        ("fixed_timestep", not (step is None or (number and 1e-4 <= step <= 1.0)), _PERIOD),
    ):
        if wrong:
            place = f"{file_name(file.with_name('manifest.json'))}, trial {file_name(file.stem)}"
            raise InputError(f"{place}: {key}", shown(trial.get(key), 40), expected)
    return trial


def _packed_events(path: Path) -> list[SessionEvent]:
    lines = read_lines(path)
    expected = "t,type,target_id,grid_id,vx,vy,vz"
    if not set(expected.split(",")) <= set(lines[0].split(",")):
        raise InputError(f"{file_name(path)}, line 1", shown(lines[0], 60), f"columns {expected}")
    events = []
    # A line at a time: a quote that is never closed would swallow the rest.
    names = lines[0].split(",")
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        row = dict(zip(names, line.split(","), strict=False))
        try:
            data: dict[str, Any] = {key: int(row[key]) for key in ("target_id", "grid_id")}
            velocity = [float(row[axis]) for axis in ("vx", "vy", "vz") if row[axis]]
            if velocity:
                data["velocity"] = velocity
            if not abs(float(row["t"])) <= LATEST_NS / 1e9:
                raise ValueError
            event = SessionEvent(round(float(row["t"]) * 1e9), f"target_{row['type']}", data)
            target_event(event)
        except (KeyError, TypeError, ValueError):
            place = f"{file_name(path)}, line {number}"
            raise InputError(place, shown(line, 60), expected) from None
        events.append(event)
    return events


# --- the clock -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Timing:
    """Frame times and options with which the app's clock reproduces the recording's.

    Attributes:
        frame_times_ns: (N,) absolute times of the recording's frames.
        play_start_ns: Time of the frame in which play was started, one before the first frame of
            play; None if that is frame 0 (no countdown).
        countdown_s: Option ``countdown_seconds``.
        round_s: Option ``round_seconds``.
        clock: Fixed step and tolerances.
    """

    frame_times_ns: NDArray[np.int64]
    play_start_ns: int | None
    countdown_s: float
    round_s: float
    clock: ClockSettings


def with_clock(
    session: Session, *, closed_loop: bool = True, fixed_step_s: float | None = None
) -> Session:
    """Return a recorded round with the frames, the clock and the options that reproduce it.

    Args:
        session: a log or a packed round of Whac-A-Mole.
        closed_loop: spawns are drawn from the seed; else they are taken from the recording.
        fixed_step_s: period of its fixed steps, s; None works it out.

    Raises:
        InputError: the clock cannot be worked out, or a spawn lies at no frame.
    """
    timing = timing_of(session, fixed_step_s)
    times_ns, start = timing.frame_times_ns, timing.play_start_ns
    frames = np.arange(len(times_ns))
    if start is not None:
        # The log has no row for the frame that started play; the hammer is where it is next.
        times_ns, frames = np.insert(times_ns, 1, start), np.insert(frames, 1, 1)
    options: dict[str, OptionValue] = {
        "condition": session.app.condition,
        "countdown_seconds": timing.countdown_s,
        "round_seconds": timing.round_s,
        **session.app.options,
    }
    if not closed_loop:
        times, cells = spawn_schedule(session, timing.frame_times_ns)
        options |= {"spawn_times": times, "spawn_cells": [float(cell) for cell in cells]}
    return replace(
        session.frames(frames),
        time_ns=times_ns,
        app=replace(session.app, options=options),
        clock=timing.clock,
        source="session",
    )


def printed(time_s: float) -> float:
    """A time as the original's log prints it: binary32, 7 significant digits."""
    return float(f"{np.float32(time_s):.{DIGITS}g}")


def timing_of(session: Session, fixed_step_s: float | None = None) -> Timing:
    """Work out the clock of a recorded round.

    Args:
        session: The round.
        fixed_step_s: Period of its fixed steps, s; None: as the source says, or the one of the
            original's two (1/70 s for people, 0.002 s for simulated users) that its events lie on.

    Raises:
        InputError: The events fit neither fixed step, or the frames are no round.
    """
    if len(session) < _LEAST_FRAMES:
        raise InputError(session.name, f"{len(session)} frames", f"at least {_LEAST_FRAMES}")
    times_ns, rate = times_of_log(session.time_ns / 1e9)
    known_s = None if session.clock is None else session.clock.fixed_delta_time_s
    step_s = fixed_step_s or known_s or _fixed_step(session, lockstep=rate is not None)
    clock = ClockSettings(
        fixed_delta_time_s=step_s,
        maximum_delta_time_s=_NO_MAXIMUM_S,
        fixed_step_tolerance_s=0.0 if rate is not None else min(_TOLERANCE_S, step_s / 4),
    )
    start_ns, countdown_s = _start_of_play(times_ns)
    base_ns = int(times_ns[0]) if start_ns is None else start_ns
    over = any(each.kind == "episode_statistics" for each in session.events[-3:])
    if not over and session.source != PACKED:
        round_s = 3600.0
    else:
        before_s, after_s = (float(t - base_ns) / 1e9 for t in times_ns[-2:])
        frame_s = after_s - before_s
        if before_s - frame_s <= _ROUND_S <= after_s + frame_s:
            round_s = _ROUND_S
        else:
            round_s = (before_s + after_s) / 2.0
    if start_ns is not None and round_s == _ROUND_S:
        # The start nearest to start_ns with which the last frame is the first after 60 s.
        edge_ns = 200_000
        low = int(times_ns[-2]) - round(_ROUND_S * 1e9) + edge_ns
        high = int(times_ns[-1]) - round(_ROUND_S * 1e9) - edge_ns
        start_ns = min(max(start_ns, low), max(high, low))
        countdown_s = _countdown(times_ns, start_ns)
    return Timing(times_ns, start_ns, countdown_s, round_s, clock)


def _fixed_step(session: Session, *, lockstep: bool) -> float:
    """The original's fixed step whose multiples the events' times are."""
    times = np.array([each.time_s for each in target_events(session) if each.kind != "spawn"])
    if len(times) == 0:
        return 0.002 if lockstep else _STUDY_STEP_S
    for exact_s in _FIXED_STEPS_S:
        step_s = _STUDY_STEP_S if exact_s == _FIXED_STEPS_S[0] else exact_s
        grid_s = float(np.float32(step_s))
        off_s = np.abs(np.rint(times / grid_s) * grid_s - times)
        if np.mean(off_s <= rounding_s(times) + 1e-6) > 0.9:
            return step_s
    raise InputError(
        "--fixed-step",
        "nothing",
        f"the period of the fixed steps in s: the events of {session.name} lie neither on "
        "multiples of 1/70 s nor of 0.002 s",
    )


def _start_of_play(times_ns: NDArray[np.int64]) -> tuple[int | None, float]:
    """Time of the frame that started play, and the countdown that makes it so."""
    gap_ns = int(times_ns[1] - times_ns[0])
    frame_ns = int(np.median(np.diff(times_ns[1:])))
    if gap_ns < max(_SHORTEST_COUNTDOWN_S * 1e9, 2 * frame_ns):
        return None, 0.0
    start_ns = int(times_ns[1]) - frame_ns
    return start_ns, _countdown(times_ns, start_ns)


def _countdown(times_ns: NDArray[np.int64], start_ns: int) -> float:
    # A little less than the pause, which binary32 game times may round either way.
    return max(0.0, (start_ns - int(times_ns[0])) / 1e9 - 2e-3)


def spawn_schedule(
    session: Session, times_ns: Sequence[int] | NDArray[np.int64]
) -> tuple[list[float], list[int]]:
    """The options ``spawn_times`` and ``spawn_cells`` that repeat the recorded spawns.

    Each target appears in the frame nearest to its recorded time.

    Raises:
        InputError: A spawn lies at no frame.
    """
    frames_s = np.asarray(times_ns) / 1e9
    spawns: list[TargetEvent] = [each for each in target_events(session) if each.kind == "spawn"]
    times: list[float] = []
    for event in spawns:
        nearest = float(frames_s[np.argmin(np.abs(frames_s - event.time_s))])
        if abs(nearest - event.time_s) > 2e-3:
            raise InputError(
                f"{session.name}, target {event.target}",
                f"a spawn at {event.time_s:g} s, {abs(nearest - event.time_s):.3g} s from a frame",
                "the time of a frame in states.csv",
            )
        times.append(nearest)
    return times, [event.cell for event in spawns]
