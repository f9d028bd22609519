"""Reads ``states.csv``: the tracked poses of a round, as the original's logger and ours write them.

Fields are separated by commas, tabs and spaces, so that what a spreadsheet has saved (byte order
mark, CR LF or CR, commas behind short lines) is read as well. The same as
``app_runtime/rl/state_log.cpp`` reads, to the last case: sim2vr-app --replay takes the same files.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name, read_text
from sim2vr_harness.sessions.checks import check_duration

FloatArray = NDArray[np.float64]

_FIELD = re.compile(r"[^, \t]+")
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_WHOLE_NUMBER = re.compile(r"-?\d+", re.ASCII)
_LATEST_S = 1e9
_DEVICES = ("left", "head", "right")
_FIRST = "_pos_x"


@dataclass(frozen=True)
class StateLog:
    """A round's title and rows.

    Attributes:
        condition: The game's condition.
        seed: Of the round's random numbers, 32 bits; the log may have any whole number.
        times_s: (N,) absolute game time.
        head: (N, 7) poses of the head, app frame: position (m), rotation x y z w.
        right: (N, 7) poses of the right controller.
        left: (N, 7) poses of the left controller; the origin while it was off.
        others: further poses by the names of their columns, such as ``marker``, (N, 7) each.
    """

    condition: str
    seed: int
    times_s: FloatArray
    head: FloatArray
    right: FloatArray
    left: FloatArray
    others: Mapping[str, FloatArray] = field(default_factory=dict)


def read_state_log(path: Path) -> StateLog:
    """Read a ``states.csv``; a last row that was cut off is left out.

    Raises:
        InputError: Names the line that cannot be read.
    """
    lines = read_lines(path)
    condition, seed = _title(path, lines)
    if len(lines) < 2:
        raise InputError(f"{path}, line 2", "nothing", "the names of the columns")
    names = _FIELD.findall(lines[1])
    columns = [_pose_column(path, names, part) for part in _DEVICES]
    rows = np.array(_rows(path, lines, len(names)))
    check_duration(rows[:, 0], file_name(path))
    left, head, right = (rows[:, column : column + 7] for column in columns)
    others = {
        part: rows[:, column : column + 7]
        for column, name in enumerate(names[:-6])
        if name.endswith(_FIRST) and (part := name.removesuffix(_FIRST)) not in _DEVICES
    }
    return StateLog(condition, seed, rows[:, 0], head, right, left, others)


def read_lines(path: Path) -> list[str]:
    """The lines of a log, whatever ends them.

    Raises:
        InputError: The file cannot be read.
    """
    text = read_text(path, "the log of a round")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _title(path: Path, lines: list[str]) -> tuple[str, int]:
    match _FIELD.findall(lines[0]):
        case ["condition", name, *more, "random", "seed", seed] if _WHOLE_NUMBER.fullmatch(seed):
            return " ".join((name, *more)), int(seed) % 2**32
    got = repr(lines[0][:60]) if lines[0] else "an empty line"
    raise InputError(f"{path}, line 1", got, "'condition C, random seed N'")


def _pose_column(path: Path, names: list[str], part: str) -> int:
    first = part + _FIRST
    if first not in names or names.index(first) + 7 > len(names):
        expected = f"a column {first} and six more for the pose"
        raise InputError(f"{path}, line 2", repr(", ".join(names)[:60]), expected)
    return names.index(first)


def _rows(path: Path, lines: list[str], columns: int) -> list[list[float]]:
    filled = [(i, fields) for i, line in enumerate(lines) if (fields := _FIELD.findall(line))]
    last = filled[-1][0]
    rows: list[list[float]] = []
    earliest_s = 0.0
    for i, fields in filled:
        if i < 2:
            continue
        row = _numbers(fields)
        if len(row) != columns:
            if i == last and rows:
                break
            expected = f"{columns} numbers, as the header has columns"
            raise InputError(f"{path}, line {i + 1}", repr(lines[i][:60]), expected)
        if not earliest_s <= row[0] <= _LATEST_S:
            expected = "a time from the row above to 1e9 s" if rows else "0 to 1e9 s"
            raise InputError(f"{path}, line {i + 1}", f"'{fields[0]}'", expected)
        earliest_s = row[0]
        rows.append(row)
    if not rows:
        raise InputError(str(path), "no row", "at least one row")
    return rows


def _numbers(fields: list[str]) -> list[float]:
    """The finite numbers of a row; none when a field is none."""
    if not all(map(_NUMBER.fullmatch, fields)):
        return []
    numbers = [float(field) for field in fields]
    return numbers if all(map(math.isfinite, numbers)) else []
