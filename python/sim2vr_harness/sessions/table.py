"""Sessions as CSV: a row per frame, a header with the names of the columns.

Columns: ``time_s`` (or ``time_ms``, ``time_ns``), ``head_x`` to ``head_qw``, ``left_*`` and
``right_*`` (grip), ``left_aim_*``, and the inputs, such as ``right.trigger``. Events have no place.
"""

import csv
import io
import math
import re
from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_lines_of
from sim2vr_harness.client import INPUT_COUNT, INPUTS
from sim2vr_harness.sessions.checks import MOST_FRAMES
from sim2vr_harness.sessions.session import SIDES, Controller, FloatArray, Session

_EXPECTED = "a table with the columns time_s and head_x to head_qw"
_PARTS = ("x", "y", "z", "qx", "qy", "qz", "qw")
_TIMES = {"time_s": 1e9, "time_ms": 1e6, "time_ns": 1.0}
_DEVICES = ("head", "left", "left_aim", "right", "right_aim")


def _pose_names(device: str) -> list[str]:
    return [f"{device}_{part}" for part in _PARTS]


def _input_names(side: str) -> dict[str, int]:
    return {f"{side}.{one.name}": one.column for one in INPUTS if one.hand == side}


def read_table(path: Path) -> Session:
    """Read a table; separated by commas, semicolons or tabs. Columns of other names are left out.

    Raises:
        InputError: a column is missing, or a row cannot be read; names file and line.
    """
    name = file_name(path)
    lines = enumerate(read_lines_of(path, _EXPECTED), start=1)
    _, first = next(lines, (1, ""))
    separator = max(",;\t", key=first.count)
    names = [each.strip().strip('"') for each in first.split(separator)]
    place = f"{name}, line 1"
    twice = next((each for each in names if each and names.count(each) > 1), None)
    if twice is not None:
        raise InputError(place, f"the column {twice} twice", "each column once")
    if not _TIMES.keys() & set(names):
        got = f"columns {shown(', '.join(names), 60)}"
        raise InputError(place, got, f"one of {', '.join(_TIMES)}")
    for device in _DEVICES:
        lacking = [each for each in _pose_names(device) if each not in names]
        if lacking and (device == "head" or len(lacking) < len(_PARTS)):
            expected = f"{device}_x to {device}_qw: position in metres, rotation x y z w"
            raise InputError(place, f"no column {lacking[0]}", expected)
    values, count = array("d"), 0
    for number, line in lines:
        if not line.strip():
            continue
        values.extend(_row(line.split(separator), names, f"{name}, line {number}"))
        count += 1
        if count > MOST_FRAMES:
            raise InputError(name, f"more than {MOST_FRAMES:,} rows", f"at most {MOST_FRAMES:,}")
    if not count:
        raise InputError(name, "no row below the header", "a row per frame")
    table = dict(zip(names, np.array(values).reshape(count, len(names)).T, strict=True))
    time = next(each for each in _TIMES if each in names)
    times = table[time] * _TIMES[time]
    if not np.isfinite(times).all():
        row = int(np.flatnonzero(~np.isfinite(times))[0])
        raise InputError(f"{name}, row {row}", f"no number in {time}", "the time of the frame")
    head = np.stack([table[each] for each in _pose_names("head")], axis=1)
    left, right = (_controller(table, side) for side in SIDES)
    return Session(np.rint(times).astype(np.int64), head, left, right, source="csv")


def _row(fields: Sequence[str], names: Sequence[str], place: str) -> list[float]:
    if len(fields) != len(names):
        raise InputError(place, f"{len(fields)} fields", f"{len(names)}, as the header has")
    known = re.compile(rf"time_|({'|'.join(_DEVICES)})_|(left|right)\.")
    numbers = []
    for field, name in zip(fields, names, strict=True):
        try:
            numbers.append(float(field) if field.strip() else math.nan)
        except ValueError:
            if known.match(name):
                expected = "a number, or nothing where a device is not tracked"
                raise InputError(f"{place}, {name}", shown(field, 40), expected) from None
            numbers.append(math.nan)
    return numbers


def _controller(table: dict[str, FloatArray], side: str) -> Controller | None:
    if f"{side}_x" not in table:
        return None
    grip = np.stack([table[each] for each in _pose_names(side)], axis=1)
    aim = None
    if f"{side}_aim_x" in table:
        aim = np.stack([table[each] for each in _pose_names(f"{side}_aim")], axis=1)
    inputs = None
    there = {name: column for name, column in _input_names(side).items() if name in table}
    if there:
        inputs = np.zeros((len(grip), INPUT_COUNT))
        given = np.stack([table[name] for name in there], axis=1)
        inputs[:, list(there.values())] = given
        inputs[np.isnan(given).all(axis=1)] = np.nan
    return Controller(grip, aim, inputs)


def write_table(session: Session, path: Path) -> None:
    """Write the frames; empty fields where a device is not tracked.

    Raises:
        OSError: the file cannot be written.
    """
    columns: dict[str, FloatArray] = {}

    def add(device: str, poses: FloatArray) -> None:
        columns.update(zip(_pose_names(device), poses.T, strict=True))

    add("head", session.head)
    for side, controller in session.controllers.items():
        add(side, controller.grip)
        if controller.aim is not None:
            add(f"{side}_aim", controller.aim)
        if controller.inputs is not None:
            for name, column in _input_names(side).items():
                columns[name] = controller.inputs[:, column]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time_ns", *columns])
    rows = zip(*(each.tolist() for each in columns.values()), strict=True)
    for time_ns, row in zip(session.time_ns.tolist(), rows, strict=True):
        writer.writerow([time_ns, *("" if math.isnan(one) else repr(one) for one in row)])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.getvalue())
