"""Logs of rounds: ``states.csv`` with ``events.csv`` beside it, by this runtime or SIM2VR's games.

They hold the poses of every frame and the app's events as text, and no inputs.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, parse_json
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
"""Of a time in the original's log."""
_LOCKSTEP_RATES = range(1, 1001)
_NUMBER = r"-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LINE = re.compile(rf"\s*({_NUMBER})[ ,\t]+(.*?)[ ,\t]*")
_PART = re.compile(rf"(?P<name>[^,]*?)(?P<numbers>(?:(?:^|[ ])(?:{_NUMBER}))*)")
_SEPARATOR = re.compile(r" *[,\t][ ,\t]*")
_DEVICES = ("left", "right", "head")
_AXES = ("pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w")


def read_log(path: Path) -> Session:
    """Read the log of a round.

    Args:
        path: Its folder, or its ``states.csv``.

    Raises:
        InputError: a file is missing, or a line of it cannot be read.
    """
    states = path / "states.csv" if path.is_dir() else path
    log = read_state_log(states)
    events = states.with_name(states.name.removesuffix("states.csv") + "events.csv")
    options, found = dict[str, OptionValue](), tuple[SessionEvent, ...]()
    if events.is_file():
        options, found = logged_options(events), logged_events(events)
    times_ns, rate = times_of_log(log.times_s)
    return Session(
        time_ns=times_ns,
        head=log.head,
        left=_controller(log.left),
        right=_controller(log.right),
        events=found,
        app=AppIdentity("game", _game_of(found), log.condition, options),
        seed=log.seed,
        rate_hz=rate,
        source="log",
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


def _game_of(events: tuple[SessionEvent, ...]) -> str:
    """Only Whac-A-Mole's events say whose they are."""
    return "whacamole" if any(each.kind == "target_spawn" for each in events) else ""


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
        InputError: a line begins with no time.
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
            found.append((place, _event(float(match[1]), match[2])))
    return found


def _event(time_s: float, text: str) -> SessionEvent:
    kind, data = "", dict[str, Any]()
    for i, part in enumerate(_SEPARATOR.split(text)):
        part, _, listed = part.partition(" [")
        data |= {"text": f"[{listed}"} if listed else {}
        match = _PART.fullmatch(part)
        name = "_".join((part if match is None else match["name"]).split()).lower()
        numbers = [] if match is None else [float(n) for n in match["numbers"].split()]
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
