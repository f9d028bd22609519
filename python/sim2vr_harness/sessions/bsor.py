"""Open replays of Beat Saber (BSOR, version 1): poses of head and sabers, boxes with their outcome.

The format is described at github.com/BeatLeader/BS-Open-Replay. Names of player and song, the
player's number and height stay in the file.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import MOST_TEXT, file_name, read_bytes
from sim2vr_harness.client import OptionValue
from sim2vr_harness.sessions.checks import MOST_EVENTS, MOST_FRAMES
from sim2vr_harness.sessions.frames import grip_of
from sim2vr_harness.sessions.session import AppIdentity, Controller, Session, SessionEvent

MAGIC = struct.pack("<i", 0x442D3D69)
OUTCOMES = ("good", "bad", "miss", "bomb")
_EXPECTED = "an open replay of Beat Saber (BSOR), version 1"
_LONGEST_TEXT = 1000
_FRAME = np.dtype([("time", "<f4"), ("rate", "<i4"), ("poses", "<f4", (3, 7))])
_SPEEDS = {"SS": 0.85, "FS": 1.2, "SF": 1.5}
"""Modifiers by which the song is slower or faster."""
_SLOWEST, _FASTEST = 0.01, 100.0
"""Speeds of a song in practice that are read; the game offers a part of them."""
_SLIDER_HEAD, _SLIDER_TAIL, _CHAIN_HEAD, _CHAIN_LINK = 4, 5, 6, 7


def read_bsor(path: Path) -> Session:
    """Read a replay; times are those of the song, at the speed at which it was played.

    The sabers' poses are the controllers' rays.

    Raises:
        InputError: it is none, cut off, or of another version.
    """
    name = file_name(path)
    data = _Data(read_bytes(path, _EXPECTED, most=MOST_TEXT), name)
    if data.content[:4] != MAGIC:
        raise InputError(name, "another file", _EXPECTED)
    data.place = 4
    version = data.byte()
    if version != 1:
        raise InputError(name, f"version {version}", _EXPECTED)
    data.section(0, "info")
    app, headset = _info(data)
    data.section(1, "frames")
    rows = np.frombuffer(data.take(_FRAME.itemsize * data.count(MOST_FRAMES, "frames")), _FRAME)
    data.section(2, "notes")
    modifiers = str(app.options["modifiers"]).split(",")
    speed = float(str(app.options["practice_speed"]))
    if not speed:  # Not practice, which has a speed of its own and takes none from modifiers.
        speed = next((_SPEEDS[each] for each in modifiers if each in _SPEEDS), 1.0)
    elif not _SLOWEST <= speed <= _FASTEST:
        expected = f"0, or {_SLOWEST:g} to {_FASTEST:g}"
        raise InputError(f"{name}, practice speed", f"{speed:g}", expected)
    events = [_box(data, speed) for _ in range(data.count(MOST_EVENTS, "boxes"))]
    if not len(rows):
        raise InputError(name, "no frame", "poses of head and sabers")
    if not np.isfinite(rows["time"]).all():
        raise InputError(name, "a time that is not finite", "the time of every frame")
    # Recorders begin with a frame from before tracking: all at the origin, rotations no rotations.
    tracked = (rows["poses"][:, :, :3] != 0.0).any(axis=(1, 2))
    first = int(np.argmax(tracked)) if tracked.any() else 0
    rows = rows[first:]
    poses = rows["poses"].astype(np.float64)
    times = np.rint(rows["time"].astype(np.float64) / speed * 1e9).astype(np.int64)
    start = min(0, int(times[0]), *(event.time_ns for event in events))
    left, right = (Controller(grip=grip_of(poses[:, k]), aim=poses[:, k]) for k in (1, 2))
    return Session(
        time_ns=times - start,
        head=poses[:, 0],
        left=left,
        right=right,
        events=tuple(SessionEvent(each.time_ns - start, each.kind, each.data) for each in events),
        app=app,
        headset=headset,
        source="bsor",
        notes=(f"{first} frames from before the devices were tracked are left out",) * bool(first),
    )


def _info(data: _Data) -> tuple[AppIdentity, str]:
    """The app and the headset; what identifies the player is skipped."""
    data.text()  # version of the recorder
    game_version = data.text()
    data.text()  # date
    data.text()  # player
    data.name()
    platform = data.text()
    data.text()  # tracking system
    headset = data.text()
    data.text()  # controllers
    level = data.text()
    data.name()
    data.name()
    difficulty = data.text()
    score = data.number("i")
    mode = data.text()
    data.text()  # environment
    modifiers = data.text()
    jump_m, left_handed = data.number("f"), bool(data.byte())
    data.number("f")  # height
    start_s, fail_s, practice_speed = (data.number("f") for _ in range(3))
    options: dict[str, OptionValue] = {
        "game_version": game_version,
        "platform": platform,
        "level_hash": level,
        "mode": mode,
        "modifiers": modifiers,
        "jump_distance_m": jump_m,
        "left_handed": left_handed,
        "score": score,
        "start_s": start_s,
        "fail_s": fail_s,
        "practice_speed": practice_speed,
    }
    return AppIdentity("app", "beat_saber", difficulty, options), headset


def _box(data: _Data, speed: float) -> SessionEvent:
    number = int(data.number("i"))
    event_s, spawn_s = data.number("f") / speed, data.number("f") / speed
    outcome = int(data.number("i"))
    if not 0 <= outcome < len(OUTCOMES):
        raise data.wrong(f"the outcome {outcome} of a box", "0 to 3")
    kind, digits = number // 10_000, [number // 10**k % 10 for k in range(4)]
    found: dict[str, Any] = {
        "column": digits[3],
        "row": digits[2],
        "colour": digits[1],
        "direction": digits[0],
        "scoring": kind,
        "outcome": OUTCOMES[outcome],
        "spawn_s": spawn_s,
    }
    if outcome in (0, 1):
        found |= _cut(data, kind)
    if not math.isfinite(event_s):
        raise data.wrong("a box without a time", "a finite number")
    return SessionEvent(round(event_s * 1e9), "box", found)


def _cut(data: _Data, kind: int) -> dict[str, Any]:
    speed_ok, direction_ok, saber_ok, _too_soon = (bool(data.byte()) for _ in range(4))
    saber_speed = data.number("f")
    direction = data.numbers(3)
    saber = int(data.number("i"))
    deviation_s, deviation_deg = data.numbers(2)
    point, normal = data.numbers(3), data.numbers(3)
    distance, angle, before, after = data.numbers(4)
    points = 0
    if speed_ok and direction_ok and saber_ok:
        if kind == _CHAIN_LINK:
            points = 20
        else:
            first = 70 if kind == _SLIDER_TAIL else min(70, max(0, math.floor(70 * before + 0.5)))
            last = min(30, max(0, math.floor(30 * after + 0.5)))
            last = {_SLIDER_HEAD: 30, _CHAIN_HEAD: 0}.get(kind, last)
            centre = math.floor(15 * (1.0 - min(1.0, max(0.0, distance / 0.3))) + 0.5)
            points = first + last + centre
    return {
        "saber": saber,
        "speed_mps": saber_speed,
        "saber_direction": direction,
        "time_deviation_s": deviation_s,
        "direction_deviation_deg": deviation_deg,
        "cut_point_m": point,
        "cut_normal": normal,
        "distance_to_centre_m": distance,
        "angle_deg": angle,
        "before": before,
        "after": after,
        "points": points,
    }


class _Data:
    """The bytes of a replay, read from the beginning."""

    def __init__(self, content: bytes, name: str) -> None:
        self.content, self.place, self._name = content, 0, name

    def take(self, count: int) -> bytes:
        part = self.content[self.place : self.place + count]
        if len(part) < count:
            raise self.wrong("the end of the file", "more; the file is cut off")
        self.place += count
        return part

    def wrong(self, got: str, expected: str) -> InputError:
        return InputError(f"{self._name}, byte {self.place:,}", got, expected)

    def byte(self) -> int:
        return self.take(1)[0]

    def number(self, kind: str) -> float:
        found: float = struct.unpack(f"<{kind}", self.take(4))[0]
        if not math.isfinite(found):
            raise self.wrong("a number that is not finite", "a finite one")
        return found

    def numbers(self, count: int) -> list[float]:
        return [self.number("f") for _ in range(count)]

    def section(self, number: int, what: str) -> None:
        got = self.byte()
        if got != number:
            raise self.wrong(f"section {got}", f"section {number}, the {what}")

    def count(self, most: int, what: str) -> int:
        found = int(self.number("i"))
        if not 0 <= found <= most:
            raise self.wrong(f"{found:,} {what}", f"0 to {most:,}")
        return found

    def text(self) -> str:
        length = int(self.number("i"))
        if not 0 <= length <= _LONGEST_TEXT:
            raise self.wrong(f"a text of {length:,} bytes", f"at most {_LONGEST_TEXT:,}")
        return self.take(length).decode("utf-8", errors="replace")

    def name(self) -> None:
        """Skip a name, whose length some recorders count in characters instead of bytes.

        The name ends where the length of the next text follows; no text has zero bytes.
        """
        self.text()
        while True:
            follows = self.content[self.place : self.place + 4]
            if len(follows) < 4:
                raise self.wrong("the end of the file", "more; the file is cut off")
            if 0 <= struct.unpack("<i", follows)[0] <= _LONGEST_TEXT:
                return
            self.place += 1
