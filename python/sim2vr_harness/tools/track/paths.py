"""Paths of a person's head and hands, read from whatever recorded them.

- Sessions of any format (``sessions/``), logs and packed rounds among them.
- A plain CSV file with a header (:func:`read_table_of_poses`), which needs no head.

All end as poses in the app's frame (Unity: left-handed, x right, y up, z forward): position x y z
in metres, rotation x y z w.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_text
from sim2vr_harness.sessions import Session, read_sessions
from sim2vr_harness.sessions.checks import check_duration
from sim2vr_harness.sessions.whacamole import RECORDED, is_recorded_round

FloatArray = NDArray[np.float64]
Frame = Literal["app", "openxr"]

FRAMES: tuple[Frame, ...] = ("app", "openxr")
"""Of plain CSV files. ``app``: Unity's, left-handed, z forward. ``openxr``: right-handed, z
backward; x is to the right and y up in both."""

_DEVICES = {
    "headset": ("headset", "head"),
    "controller_right": ("controller_right", "right"),
    "controller_left": ("controller_left", "left"),
}
"""Accepted names of columns in a CSV file."""
_PLACE, _TURN = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
_FURTHEST_M = 20.0
"""Tracking spaces are smaller; numbers beyond are probably millimetres."""
_LEAST_ROWS = 3
_PAUSE_S = 0.5
"""A first gap this long is the countdown of a game, not movement."""
_QUATERNION = 0.05
"""Largest accepted difference between the length of a quaternion and 1."""


@dataclass(frozen=True)
class RecordedPath:
    """Recorded movement of a person.

    Attributes:
        name: for files and tables.
        source: file or folder of the recording.
        times_s: (N,) rising, as recorded.
        hands: device, such as ``controller_right`` -> (N, 7) poses in the app's frame.
        headset: (N, 7), or None if it was not recorded.
        turned: True if rotations were recorded; otherwise those here are the identity.
        session: the recorded round; None for a plain CSV file.
    """

    name: str
    source: Path
    times_s: FloatArray
    hands: Mapping[str, FloatArray]
    headset: FloatArray | None
    turned: bool = True
    session: Session | None = None

    @property
    def duration_s(self) -> float:
        """From the first moment to the last."""
        return float(self.times_s[-1] - self.times_s[0])


def read_paths(path: Path, *, frame: Frame = "app") -> list[RecordedPath]:
    """Read every recorded path at or below a place.

    Args:
        path: a recording, a folder of such, or a CSV file with a header.
        frame: of a CSV file.

    Raises:
        InputError: it cannot be read; names file and line.
    """
    table = path.is_file() and path.suffix.lower() == ".csv"
    if table and not path.name.endswith("states.csv"):
        return [read_table_of_poses(path, frame)]
    return [_of_session(session) for session in read_sessions(path, "RECORDING")]


def _of_session(session: Session) -> RecordedPath:
    times_s = session.time_ns / 1e9
    first = first_of_play(times_s) if session.source in RECORDED else 0
    times_s, rows = np.unique(times_s[first:], return_index=True)
    path = session.path or Path()
    if len(times_s) < _LEAST_ROWS:
        raise InputError(file_name(path), f"{len(times_s)} moments", f"at least {_LEAST_ROWS}")
    devices = session.devices()
    poses = {
        "controller_right": devices.right_controller,
        "controller_left": devices.left_controller,
    }
    if is_recorded_round(session) and session.left is not None:
        poses["controller_right"] = None  # the left hand holds the hammer
    hands = {
        name: each[first:][rows]
        for name, each in poses.items()
        if each is not None and bool(np.ptp(each[:, :3], axis=0).max() > 1e-6)
    }
    if not hands:
        raise InputError(file_name(path), "controllers that never move", "one that does")
    head = session.head[first:][rows]
    return RecordedPath(session.name.replace("/", "-"), path, times_s, hands, head, session=session)


def first_of_play(times_s: FloatArray) -> int:
    """Return the first row of movement: 1 if a game's countdown follows row 0."""
    return int(len(times_s) > _LEAST_ROWS and times_s[1] - times_s[0] > _PAUSE_S)


# --- plain CSV -----------------------------------------------------------------------------------


def read_table_of_poses(file: Path, frame: Frame = "app") -> RecordedPath:
    """Read a CSV file with a header.

    Columns, in any order: ``time_s``; ``controller_right_x``, ``_y``, ``_z`` (m), and if known
    ``_qx``, ``_qy``, ``_qz``, ``_qw``; the same of ``controller_left`` and ``headset``. ``right``,
    ``left`` and ``head`` are the same devices, and ``_x_m`` is ``_x``, as in the tables that
    evaluations export. Other columns are ignored. A device without numbers in the first row was
    off.

    Args:
        frame: of its positions and rotations.

    Raises:
        InputError: names line and column.
    """
    lines = [
        (number, line)
        for number, line in enumerate(read_text(file, "recorded poses").splitlines(), start=1)
        if line.strip(" ,;\t")
    ]
    if not lines:
        raise InputError(file_name(file), "nothing", "a header and a row per moment")
    header = [name.strip().strip('"').lower() for name in lines[0][1].lstrip("\ufeff").split(",")]
    if "time_s" not in header:
        expected = "a column time_s, and controller_right_x, _y and _z"
        raise InputError(f"{file_name(file)}, line 1", shown(lines[0][1], 60), expected)
    for name in header:
        if name and header.count(name) > 1:
            raise InputError(f"{file_name(file)}, line 1", f"{name} twice", "each column once")
    columns = {device: _columns(file, header, device) for device in _DEVICES}
    rows = _numbers(file, lines, header, columns)
    times_s = rows[:, header.index("time_s")]
    back = np.flatnonzero(np.diff(times_s) <= 0.0)
    if len(back):
        i = int(back[0]) + 1
        got = f"{times_s[i]:g} after {times_s[i - 1]:g}"
        raise InputError(f"{file_name(file)}, line {lines[i + 1][0]}, time_s", got, "a later time")
    check_duration(times_s, f"{file_name(file)}, time_s")
    poses: dict[str, FloatArray] = {}
    turned = True
    for device, found in columns.items():
        if not found or np.isnan(rows[0, found[0]]):
            continue
        values = np.full((len(rows), 7), 0.0)
        values[:, 6] = 1.0
        values[:, : len(found)] = rows[:, found]
        far = np.flatnonzero(np.abs(values[:, :3]).max(axis=1) > _FURTHEST_M)
        if len(far):
            place = f"{file_name(file)}, line {lines[int(far[0]) + 1][0]}, {device}"
            places_got = f"{np.abs(values[far[0], :3]).max():g}"
            raise InputError(place, places_got, f"metres, at most {_FURTHEST_M:g} from the origin")
        length = np.linalg.norm(values[:, 3:], axis=1)
        wrong = np.flatnonzero(np.abs(length - 1.0) > _QUATERNION)
        if len(wrong):
            place = f"{file_name(file)}, line {lines[int(wrong[0]) + 1][0]}, {device}"
            places_got = f"a rotation of length {length[wrong[0]]:.3g}"
            raise InputError(place, places_got, "a quaternion x y z w of length 1")
        if device != "headset":
            turned = turned and len(found) == 7
        if frame == "app":
            poses[device] = values
        else:
            poses[device] = values * np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0])
    headset = poses.pop("headset", None)
    if not poses:
        expected = "columns of a hand: controller_right_x, _y and _z, in m"
        raise InputError(f"{file_name(file)}, line 1", shown(lines[0][1], 60), expected)
    return RecordedPath(file.stem, file, times_s, poses, headset, turned)


def _columns(file: Path, header: list[str], device: str) -> list[int]:
    """Return the columns of a device's 3 or 7 numbers; none if it was not recorded."""
    for name in _DEVICES[device]:
        places = [_column(header, f"{name}_{part}") for part in _PLACE]
        turns = [_column(header, f"{name}_{part}") for part in _TURN]
        known = [column for column in (*places, *turns) if column is not None]
        if not known:
            continue
        for parts, found in ((_PLACE, places), (_TURN, turns)):
            missing = [part for part, at in zip(parts, found, strict=True) if at is None]
            if missing and (parts is _PLACE or len(missing) < len(parts)):
                got = f"no column {name}_{missing[0]}"
                expected = f"{name}_{', _'.join(parts)}"
                raise InputError(f"{file_name(file)}, line 1", got, expected)
        return known
    return []


def _column(header: list[str], name: str) -> int | None:
    for written in (name, f"{name}_m"):
        if written in header:
            return header.index(written)
    return None


def _numbers(
    file: Path,
    lines: list[tuple[int, str]],
    header: list[str],
    columns: Mapping[str, list[int]],
) -> FloatArray:
    """Return values (N, C) of the used columns; NaN elsewhere and for devices that were off."""
    wanted = {header.index("time_s"), *(column for found in columns.values() for column in found)}
    rows = np.full((len(lines) - 1, len(header)), np.nan)
    off: dict[int, bool] = {}
    for row, (number, line) in enumerate(lines[1:]):
        cells = line.split(",")
        for column in sorted(wanted):
            cell = cells[column].strip().strip('"') if column < len(cells) else ""
            if column != header.index("time_s") and not cell and off.setdefault(column, row == 0):
                continue
            off.setdefault(column, False)
            rows[row, column] = _number(f"{file_name(file)}, line {number}", header[column], cell)
    if len(rows) < _LEAST_ROWS:
        raise InputError(file_name(file), f"{len(rows)} rows", f"at least {_LEAST_ROWS}")
    return rows


def _number(place: str, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{place}, {column}", shown(cell, 30) if cell else "nothing", "a number")
    return value
