"""Logs of rounds: ``states.csv`` with ``events.csv`` beside it, by this runtime or SIM2VR's games.

They hold the poses of every frame and the app's events as text, and no inputs.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, parse_json, read_json
from sim2vr_harness.client import OptionValue, frame_time_ns
from sim2vr_harness.sessions.checks import LATEST_NS
from sim2vr_harness.sessions.session import (
    AppIdentity,
    Controller,
    FloatArray,
    Session,
    SessionEvent,
)
from sim2vr_harness.sessions.state_log import read_lines, read_state_log

_OPTIONS = ", game options "
_TITLE_LINES = 3
DIGITS = 7
"""Number of significant digits of a time in the original's log."""
_LOCKSTEP_RATES = range(1, 1001)
_NUMBER = r"-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LINE = re.compile(rf"\s*({_NUMBER})[ ,\t]+(.*?)[ ,\t]*")
_PART = re.compile(rf"(?P<name>[^,]*?)(?P<numbers>(?:(?:^|[ ])(?:{_NUMBER}))*)")
_SEPARATOR = re.compile(r" *[,\t][ ,\t]*")
_DEVICES = ("left", "right", "head")
_AXES = ("pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w")


WHACAMOLE = "whacamole"
"""The game whose logs are recognised by their targets' cells."""
PLANE, GRID = "target_plane_transform", "grid_mapping"
"""Events of a log of Whac-A-Mole: pose of the targets' plane, and places of the cells in it."""
_TARGET = "target_"
_KINDS = ("spawn", "hit", "contact", "miss")


@dataclass(frozen=True)
class TargetEvent:
    """Something that happened to a target of Whac-A-Mole.

    Attributes:
        time_s: on the game's clock: of the frame for a spawn, of the fixed step for the others.
        kind: ``spawn``, ``hit``, ``contact`` (a touch too slow for a hit) or ``miss``.
        target: counts the round's spawns from 0.
        cell: 0 to 8, row by row from the top left as the player sees it.
        velocity_mps: the game's smoothed hammer velocity, world axes; of hits and contacts.
    """

    time_s: float
    kind: str
    target: int
    cell: int
    velocity_mps: tuple[float, float, float] | None = None


def target_event(event: SessionEvent) -> TargetEvent:
    """Return what an event says of its target.

    Raises:
        KeyError, TypeError, ValueError: it is none of a target of Whac-A-Mole.
    """
    kind, data = event.kind.removeprefix(_TARGET), event.data
    target, cell = int(str(data["target_id"])), int(str(data["grid_id"]))
    speeds = tuple(float(v) for v in data.get("velocity", ()))
    if kind not in _KINDS or not 0 <= cell < 9 or len(speeds) not in (0, 3):
        raise ValueError
    three = (speeds[0], speeds[1], speeds[2]) if speeds else None
    return TargetEvent(event.time_ns / 1e9, kind, target, cell, three)


def target_events(session: Session) -> tuple[TargetEvent, ...]:
    """Return what happened to the targets of a round of Whac-A-Mole.

    Raises:
        InputError: an event of a target has no number or cell.
    """
    named = ((f"event at {each.time_ns / 1e9:g} s", each) for each in session.events)
    return tuple(target_event(each) for each in _checked_targets(named) if _is_target(each))


def _is_target(event: SessionEvent) -> bool:
    return event.kind.startswith(_TARGET) and event.kind != PLANE


def _checked_targets(logged: Iterable[tuple[str, SessionEvent]]) -> list[SessionEvent]:
    """Events of Whac-A-Mole, without a last one that was cut off."""
    every = list(logged)
    for place, event in every:
        expected = "'T, target_KIND, target ID N, grid ID G[, velocity X Y Z]'"
        try:
            if event.kind.startswith(PLANE):
                expected = "the plane's pose: position x y z, rotation x y z w"
                if event.kind != PLANE or np.shape(event.data["value"]) != (7,):
                    raise ValueError
            elif _is_target(event):
                target_event(event)
        except (KeyError, TypeError, ValueError):
            if event is every[-1][1]:
                return [each for _, each in every[:-1]]
            raise InputError(place, shown(event_text(event), 80), expected) from None
    return [each for _, each in every]


def read_log(path: Path) -> Session:
    """Read the log of a round; times are as logged, see :func:`on_lockstep_clock`.

    Args:
        path: Its folder, or its ``states.csv``.

    Raises:
        InputError: a file is missing, or a line of it cannot be read.
    """
    states = path / "states.csv" if path.is_dir() else path
    log = read_state_log(states)
    events = states.with_name(states.name.removesuffix("states.csv") + "events.csv")
    options, logged = dict[str, OptionValue](), list[tuple[str, SessionEvent]]()
    if events.is_file():
        options, logged = logged_options(events), numbered_events(events)
    of_found = [event for _, event in logged]
    if any(event.kind == "block_start" for event in of_found):
        game_of = "pointing"
    else:
        targets = [event for event in of_found if event.kind.startswith(_TARGET)]
        game_of = (
            WHACAMOLE if targets and not any("center" in each.data for each in targets) else ""
        )
    game, found = game_of, [event for _, event in logged]
    left = _controller(log.left)
    if game == WHACAMOLE:
        found = _checked_targets(logged)
        left = left if options.get("hand") == "left" else None
    person = states.with_name("person.json")
    index = read_json(person, "a person's fields").get("index") if person.is_file() else None
    return Session(
        time_ns=np.rint(log.times_s * 1e9).astype(np.int64),
        head=log.head,
        left=left,
        right=_controller(log.right),
        objects=log.others,
        events=tuple(found),
        app=AppIdentity("game", game, log.condition, options),
        seed=log.seed,
        rate_hz=times_of_log(log.times_s)[1],
        source="log",
        person="" if index is None else str(index),
    )


def times_of_log(times_s: FloatArray) -> tuple[NDArray[np.int64], int | None]:
    """Return times that a log rounds, in ns, and the rate of the lockstep clock that they lie on.

    The rate is None where they lie on none: times of a headset's frames.
    """
    rate = _lockstep_rate(times_s)
    if rate is None:
        return np.rint(times_s * 1e9).astype(np.int64), None
    frames = np.rint(times_s / (frame_time_ns(1, rate) / 1e9)).astype(int)
    return np.array([frame_time_ns(int(n), rate) for n in frames], dtype=np.int64), rate


def rounding_s(times_s: FloatArray) -> FloatArray:
    """Return the largest difference between each time and its print: binary32, 7 digits."""
    size = np.maximum(np.abs(times_s), 1e-3)
    step: FloatArray = 10.0 ** (np.floor(np.log10(size)) + 1 - DIGITS)
    return 0.51 * step + size * 2.0**-23


def _lockstep_rate(times_s: FloatArray) -> int | None:
    """Frames per second of a lockstep clock that all times lie on, or None."""
    median_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    if median_s <= 0.0:
        return None
    rate = round(1.0 / median_s)
    if rate not in _LOCKSTEP_RATES:
        return None
    period_s = frame_time_ns(1, rate) / 1e9
    off_s = np.abs(np.rint(times_s / period_s) * period_s - times_s)
    return rate if bool((off_s <= rounding_s(times_s)).all()) else None


def _controller(poses: FloatArray) -> Controller | None:
    """None: the controller was off, which the log writes as the origin."""
    off = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return None if (poses == off).all() else Controller(grip=poses)


def logged_options(events: Path) -> dict[str, OptionValue]:
    """Return the options that an ``events.csv`` says differ from the usual ones.

    Raises:
        InputError: they are no JSON.
    """
    for number, line in enumerate(read_lines(events)[:_TITLE_LINES], start=1):
        _, found, text = line.rstrip(" ,\t").partition(_OPTIONS)
        if not found:
            continue
        try:
            return parse_json(text, "", "")
        except InputError as error:
            place = f"{file_name(events)}, line {number}"
            expected = "the game's options as a JSON object"
            raise InputError(place, shown(text, 60), expected) from error
    return {}


def logged_events(events: Path) -> tuple[SessionEvent, ...]:
    """Return the events of an ``events.csv``: ``T, KIND[ NUMBERS][, NAME NUMBERS] ...``.

    Raises:
        InputError: a line begins with no time.
    """
    return tuple(event for _, event in numbered_events(events))


def numbered_events(events: Path) -> list[tuple[str, SessionEvent]]:
    """Return the events of an ``events.csv`` with the file and line of each; see logged_events.

    A last line that was cut off is left out.

    Raises:
        InputError: a line begins with no time, or has a number that is not finite.
    """
    lines = read_lines(events)
    filled = [number for number, line in enumerate(lines, start=1) if line.strip(" ,\t")]
    found = []
    for number in filled:
        line = lines[number - 1]
        match = _LINE.fullmatch(line)
        place = f"{file_name(events)}, line {number}"
        if match is None:
            if number == filled[-1]:
                break
            raise InputError(place, shown(line, 60), "a time in s, a comma and what happened")
        if not abs(float(match[1])) <= LATEST_NS * 1e-9:
            raise InputError(place, f"the time {shown(match[1], 30)}", "-1e9 to 1e9 s")
        if not match[2].startswith(_OPTIONS.strip(" ,")):
            found.append((place, _event(float(match[1]), match[2], place)))
    return found


def _event(time_s: float, text: str, place: str) -> SessionEvent:
    kind, data = "", dict[str, Any]()
    for i, part in enumerate(_SEPARATOR.split(text)):
        part, _, listed = part.partition(" [")
        data |= {"text": f"[{listed}"} if listed else {}
        match = _PART.fullmatch(part)
        name = "_".join((part if match is None else match["name"]).split()).lower()
        numbers = [] if match is None else [float(n) for n in match["numbers"].split()]
        if math.inf in map(abs, numbers):
            raise InputError(place, shown(part, 60), "finite numbers")
        plain = [int(n) if n == math.floor(n) and abs(n) < 2**53 else n for n in numbers]
        value = plain[0] if len(plain) == 1 else plain or True
        if i == 0:
            kind = name or "note"
            data |= {"value": value} if plain else {}
        else:
            data[name or f"value_{i}"] = value
    return SessionEvent(round(time_s * 1e9), kind, data)


def write_log(session: Session, folder: Path) -> None:
    """Write the poses as a log's ``states.csv``, and the events as its ``events.csv``.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    app = session.app
    names = [f"{device}_{axis}" for device in _DEVICES for axis in _AXES]
    off = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(session), 1))
    known = session.devices()
    poses = [
        off if rows is None else rows
        for rows in (known.left_controller, known.right_controller, session.head)
    ]
    rows = np.column_stack([session.time_ns * 1e-9, *poses])
    lines = [f"condition {app.condition or app.name or 'none'}, random seed {session.seed or 0}"]
    lines.append(", ".join(["timestamp", *names]))
    lines += [", ".join(f"{number:.9g}" for number in row) for row in rows.tolist()]
    (folder / "states.csv").write_text("\n".join(lines) + "\n")
    events = "".join(f"{event_text(each)}\n" for each in session.events)
    (folder / "events.csv").write_text(events)


def event_text(event: SessionEvent) -> str:
    """Return the line of an ``events.csv`` for an event."""
    parts = [event.kind]
    for name, value in event.data.items():
        parts.append(f"{name.replace('_', ' ')} {_value_text(value)}".rstrip())
    return f"{event.time_ns * 1e-9:.9g}, {', '.join(parts)}"


def _value_text(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return " ".join(f"{number:.9g}" for number in value)
    if isinstance(value, bool):
        return "" if value else "0"
    return f"{value:.9g}" if isinstance(value, (int, float)) else str(value)
