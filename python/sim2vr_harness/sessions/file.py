"""The session format: JSON lines, a header and then frames and events in order of time.

``docs/reference/sessions.md`` describes every field. Files are read line by line, within bounds.
"""

import gzip
import json
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.files import file_name, parse_json, read_lines_of
from sim2vr_harness.client import INPUT_COUNT, ClockSettings, PageStart
from sim2vr_harness.client.base import plain_options
from sim2vr_harness.sessions.checks import LATEST_NS, MOST_EVENTS, MOST_FRAMES
from sim2vr_harness.sessions.session import (
    APP_KINDS,
    JOINTS,
    SIDES,
    AppIdentity,
    Controller,
    FloatArray,
    Session,
    SessionEvent,
)

FORMAT = "sim2vr-session"
VERSION = 1
_EXPECTED = "a session, JSON lines that begin with a header"
_HEADER = (
    "format", "version", "app", "seed", "clock", "headset", "rate_hz", "source", "person",
    "rounding_m", "page_start",
)  # fmt: skip
_SIZES = {"grip": 7, "aim": 7, "inputs": INPUT_COUNT, "joints": 8 * JOINTS}
_LONGEST_TEXT = 1000
_LATEST_MS = 1e8


def write_file(session: Session, path: Path) -> None:
    """Write a session; packed with gzip where the name ends in ``.gz``.

    Raises:
        OSError: the file cannot be written.
    """
    content = "".join(f"{line}\n" for line in session_lines(session)).encode()
    if path.suffix == ".gz":
        content = gzip.compress(content, compresslevel=6, mtime=0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def session_lines(session: Session) -> Iterator[str]:
    """Yield the lines of a session's file, without their ends."""
    app = {**asdict(session.app), "options": plain_options(session.app.options)}
    clock = None if session.clock is None else asdict(session.clock)
    header = {name: getattr(session, name, None) for name in _HEADER}
    start = None if session.page_start is None else asdict(session.page_start)
    header |= {"format": FORMAT, "version": VERSION, "app": app, "clock": clock}
    header["page_start"] = start
    yield _line({name: value for name, value in header.items() if value not in (None, "")})
    events = iter(session.events)
    event = next(events, None)
    for i, time_ns in enumerate(session.time_ns.tolist()):
        while event is not None and event.time_ns < time_ns:
            yield _event_line(event)
            event = next(events, None)
        frame: dict[str, Any] = {"t": time_ns, "head": session.head[i].tolist()}
        for side, controller in session.controllers.items():
            rows = {
                name: array[i].reshape(-1).tolist()
                for name, array in vars(controller).items()
                if array is not None and not np.isnan(array[i]).any()
            }
            if "grip" in rows:
                frame[side] = rows
        yield _line(frame)
    while event is not None:
        yield _event_line(event)
        event = next(events, None)


def _event_line(event: SessionEvent) -> str:
    data = {"data": dict(event.data)} if event.data else {}
    return _line({"t": event.time_ns, "event": event.kind, **data})


def _line(content: Mapping[str, Any]) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def read_file(path: Path) -> Session:
    """Read a session's file; the frames are not checked yet, see ``formats.read_session``.

    Raises:
        InputError: it is no session, or a line of it cannot be read; names file and line.
    """
    name = file_name(path)
    lines = enumerate(read_lines_of(path, _EXPECTED), start=1)
    header: dict[str, Any] | None = None
    frames, events = _Frames(), list[SessionEvent]()
    number = 0
    for number, text in lines:
        if not text.strip():
            continue
        place = f"{name}, line {number}"
        content = _parsed(text, place)
        if header is None:
            header = _checked_header(content, place)
        elif "event" in content:
            events.append(_event(content, place))
        else:
            frames.add(content, place)
        if len(events) > MOST_EVENTS or frames.count > MOST_FRAMES:
            raise InputError(place, "one frame or event too many", f"at most {MOST_FRAMES:,}")
    if header is None:
        raise InputError(name, "an empty file", _EXPECTED)
    if not frames.count:
        raise InputError(name, "a header without frames", "frames below it")
    return frames.session(header, events)


def _parsed(text: str, place: str) -> dict[str, Any]:
    try:
        return parse_json(text, "", "")
    except InputError as error:
        expected = "an object in JSON; the file may be cut off here"
        raise InputError(place, error.got, expected) from error


# --- header --------------------------------------------------------------------------------------


def _checked_header(content: dict[str, Any], place: str) -> dict[str, Any]:
    if content.get("format") != FORMAT:
        got = f"an object of {', '.join(content)[:60] or 'nothing'}"
        raise InputError(place, got, f'a header with "format": "{FORMAT}"')
    if content.get("version") != VERSION:
        got = f"version {shown(content.get('version'), 30)}"
        raise InputError(place, got, f"version {VERSION}; a newer sim2vr may have written it")
    _known(content, _HEADER, place)
    seed, rate = content.get("seed"), content.get("rate_hz")
    if seed is not None and not (type(seed) is int and 0 <= seed < 2**32):
        raise InputError(f"{place}, seed", shown(seed, 40), "a whole number of 32 bits")
    for key, number in (("rate_hz", rate), ("rounding_m", content.get("rounding_m"))):
        if number is not None and not (_is_number(number) and 0 <= number <= 1000):
            raise InputError(f"{place}, {key}", shown(number, 40), "a number from 0 to 1000")
    for key in ("headset", "source", "person"):
        _text(content.get(key, ""), f"{place}, {key}")
    return {
        "app": _app(content.get("app", {}), f"{place}, app"),
        "seed": seed,
        "clock": _clock(content.get("clock"), f"{place}, clock"),
        "headset": content.get("headset", ""),
        "rate_hz": None if rate is None else float(rate),
        "source": content.get("source", "session"),
        "person": content.get("person", ""),
        "rounding_m": float(content.get("rounding_m") or 0.0),
        "page_start": _page_start(content.get("page_start"), f"{place}, page_start"),
    }


def _app(content: Any, place: str) -> AppIdentity:
    if not isinstance(content, dict):
        raise InputError(place, shown(content, 40), "an object with kind and name")
    _known(content, ("kind", "name", "condition", "options"), place)
    kind = content.get("kind", "unknown")
    if kind not in APP_KINDS:
        raise InputError(f"{place}.kind", shown(kind, 40), f"one of {', '.join(APP_KINDS)}")
    options = content.get("options", {})
    if not (isinstance(options, dict) and all(map(_is_option, options.values()))):
        expected = "an object of numbers, texts, truths and lists of numbers"
        raise InputError(f"{place}.options", shown(options, 60), expected)
    name, condition = (
        _text(content.get(key, ""), f"{place}.{key}") for key in ("name", "condition")
    )
    return AppIdentity(kind, name, condition, options)


def _is_option(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_is_number, value))
    return isinstance(value, (str, bool)) or _is_number(value)


def _clock(content: Any, place: str) -> ClockSettings | None:
    if content is None:
        return None
    names = tuple(asdict(ClockSettings()))
    if not (isinstance(content, dict) and all(map(_is_number, content.values()))):
        raise InputError(place, shown(content, 60), f"an object of numbers: {', '.join(names)}")
    _known(content, names, place)
    settings = ClockSettings(**content)
    if not 1e-4 <= settings.fixed_delta_time_s <= 1.0:
        got = shown(settings.fixed_delta_time_s, 40)
        raise InputError(f"{place}.fixed_delta_time_s", got, "0.0001 to 1 s")
    return settings


def _page_start(content: Any, place: str) -> PageStart | None:
    if content is None:
        return None
    expected = "an object of frames_ms (a rising list), requested_ms and first_ms, 0 to 1e8 ms"
    if not (isinstance(content, dict) and isinstance(content.get("frames_ms"), list)):
        raise InputError(place, shown(content, 60), expected)
    names = ("frames_ms", "requested_ms", "first_ms")
    _known(content, names, place)
    frames = content["frames_ms"]
    times = [*frames, content.get("requested_ms"), content.get("first_ms")]
    if not all(_is_number(time) and 0 <= time <= _LATEST_MS for time in times):
        raise InputError(place, "another time", expected)
    if any(late < early for early, late in pairwise(frames)) or len(frames) > MOST_FRAMES:
        raise InputError(f"{place}.frames_ms", "times that go backwards", expected)
    return PageStart(tuple(map(float, frames)), float(times[-2]), float(times[-1]))


# --- frames and events ---------------------------------------------------------------------------


class _Frames:
    """Frames as they are read, in arrays that grow."""

    def __init__(self) -> None:
        self.count = 0
        self._times, self._head = array("q"), array("d")
        self._columns: dict[tuple[str, str], tuple[array[int], array[float]]] = {}

    def add(self, content: dict[str, Any], place: str) -> None:
        """Take a frame's object."""
        _known(content, ("t", "head", *SIDES), place)
        self._times.append(_time(content, place))
        self._head.extend(_numbers(content.get("head"), 7, f"{place}, head"))
        for side in SIDES:
            hand = content.get(side)
            if hand is None:
                continue
            if not isinstance(hand, dict) or "grip" not in hand:
                got = shown(hand, 60)
                raise InputError(f"{place}, {side}", got, "an object with a grip, or null")
            _known(hand, tuple(_SIZES), f"{place}, {side}")
            for name, row in hand.items():
                if row is not None:
                    numbers = _numbers(row, _SIZES[name], f"{place}, {side}.{name}")
                    frames, values = self._columns.setdefault(
                        (side, name), (array("q"), array("d"))
                    )
                    frames.append(self.count)
                    values.extend(numbers)
        self.count += 1

    def session(self, header: dict[str, Any], events: list[SessionEvent]) -> Session:
        """Return what was taken."""
        return Session(
            time_ns=np.array(self._times, dtype=np.int64),
            head=np.array(self._head).reshape(-1, 7),
            left=self._controller("left"),
            right=self._controller("right"),
            events=tuple(events),
            **header,
        )

    def _controller(self, side: str) -> Controller | None:
        arrays = {name: self._filled(side, name) for name in _SIZES}
        if arrays["grip"] is None:
            return None
        if arrays["joints"] is not None:
            arrays["joints"] = arrays["joints"].reshape(-1, JOINTS, 8)
        return Controller(**cast(dict[str, Any], arrays))

    def _filled(self, side: str, name: str) -> FloatArray | None:
        if (side, name) not in self._columns:
            return None
        frames, values = self._columns[side, name]
        filled = np.full((self.count, _SIZES[name]), np.nan)
        filled[np.array(frames, dtype=np.int64)] = np.array(values).reshape(len(frames), -1)
        return filled


def _event(content: dict[str, Any], place: str) -> SessionEvent:
    _known(content, ("t", "event", "data"), place)
    kind, data = _text(content["event"], f"{place}, event"), content.get("data", {})
    if not (isinstance(data, dict) and all(v is None or _is_option(v) for v in data.values())):
        expected = "an object of numbers, texts, truths and lists of numbers"
        raise InputError(f"{place}, data", shown(data, 60), expected)
    return SessionEvent(_time(content, place), kind, data)


def _time(content: dict[str, Any], place: str) -> int:
    time_ns = content.get("t")
    if type(time_ns) is not int or not 0 <= time_ns <= LATEST_NS:
        raise InputError(f"{place}, t", shown(time_ns, 40), "whole nanoseconds from 0 to 1e18")
    return time_ns


def _numbers(row: Any, count: int, place: str) -> Sequence[float]:
    if not (isinstance(row, list) and len(row) == count and all(map(_is_number, row))):
        raise InputError(place, shown(row, 80), f"{count} finite numbers")
    return row


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and type(value) is not bool and math.isfinite(value)


def _text(value: Any, place: str) -> str:
    if not isinstance(value, str) or len(value) > _LONGEST_TEXT:
        raise InputError(place, shown(value, 40), f"text of at most {_LONGEST_TEXT} characters")
    return value


def _known(content: Mapping[str, Any], names: Sequence[str], place: str) -> None:
    for name in content:
        if name not in names:
            raise unknown_name(place, name, names)
