"""Table of a round's items, a row each, from the game's log (``events.csv``).

A line of the log is ``time, EVENT, FIELD VALUE, FIELD VALUE ...``, with a colon between a field and
a value that is no number (``kind: left box``); which events and fields mean what, the game
publishes (:class:`~sim2vr_harness.client.LoggedItem`).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import read_text
from sim2vr_harness.client import GameFacts, LoggedItem
from sim2vr_harness.evaluation.data.columns import Column, column_name, columns_of, merged

EVENT_COLUMNS = (
    Column("episode", "text", "", "The episode; a key of the table episodes"),
    Column("item", "text", "", "What came and went, as the game calls it"),
    Column("item_id", "integer", "", "Its number in the game's log; a key with episode and item"),
    Column("cell", "integer", "", "Number of the place that it came up in; none without cells"),
    Column("begin_s", "number", "s", "Game time at which it came; none where the log has none"),
    Column("end_s", "number", "s", "Game time of its outcome; none where the round ended first"),
    Column("latency_s", "number", "s", "From its begin to its outcome"),
    Column("outcome", "text", "", "How it ended, as the game calls it; none where it did not"),
    Column("success", "boolean", "", "Whether that is good for the player"),
    Column("x_m", "number", "m", "Its place, right; frame of the game's log"),
    Column("y_m", "number", "m", "Its place, up"),
    Column("z_m", "number", "m", "Its place, forward; none in a plane"),
    Column("speed_mps", "number", "m/s", "Norm of the velocity that decided"),
    Column("velocity_x_mps", "number", "m/s", "That velocity, right"),
    Column("velocity_y_mps", "number", "m/s", "That velocity, up"),
    Column("velocity_z_mps", "number", "m/s", "That velocity, forward"),
)
"""Columns of items in every game; further fields of the log follow them."""

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class LogLine:
    """A line of a log.

    Attributes:
        time_s: Game time.
        event: Name of the event.
        fields: name -> text of the value, empty for a word alone.
    """

    time_s: float
    event: str
    fields: Mapping[str, str]

    def numbers(self, name: str) -> list[float]:
        """Return the numbers of a field; none if it is missing, or is something else."""
        return _numbers(self.fields.get(name, ""))


def read_log(file: Path) -> list[LogLine]:
    """Read an ``events.csv``; lines without a time are left out, as is one that was cut off.

    Raises:
        InputError: The file cannot be read.
    """
    lines = []
    for text in read_text(file, "the log of a round").splitlines():
        first, _, rest = text.partition(",")
        if not _NUMBER.fullmatch(first.strip()) or not rest.strip():
            continue
        event, *fields = (part.strip() for part in rest.split(", "))
        lines.append(LogLine(float(first), event, dict(map(_field, fields))))
    return lines


def _field(text: str) -> tuple[str, str]:
    """``target ID 3`` -> ``target ID`` and ``3``: numbers at the end are the value."""
    name, colon, value = text.partition(": ")
    if colon:
        return name, value.strip()
    words = text.split()
    count = len(words)
    while count > 1 and _NUMBER.fullmatch(words[count - 1]):
        count -= 1
    return " ".join(words[:count]), " ".join(words[count:])


def _numbers(text: str) -> list[float]:
    words = text.split()
    return [float(word) for word in words] if all(map(_NUMBER.fullmatch, words)) else []


def item_rows(episode: str, log: Sequence[LogLine], facts: GameFacts) -> list[dict[str, Any]]:
    """Return a row per item of a round, in the order in which the log first has them.

    Args:
        log: Of the round.
    """
    rows: dict[tuple[str, int], dict[str, Any]] = {}
    for item in facts.items:
        places = _places(log, item)
        for line in log:
            numbers = line.numbers(item.id_field)
            found = {outcome.event for outcome in item.outcomes} | set(item.counted_events)
            events_of = found | ({item.begin_event} if item.begin_event else set())
            if line.event not in events_of or not numbers:
                continue
            number = int(numbers[0])
            row = rows.setdefault(
                (item.name, number),
                {
                    "episode": episode,
                    "item": item.name,
                    "item_id": number,
                    "_first_s": line.time_s,
                    **{_count_name(event): 0 for event in item.counted_events},
                },
            )
            _take(row, line, item, places)
    ordered = sorted(rows.values(), key=lambda row: row.pop("_first_s"))
    for row in ordered:
        if row.get("begin_s") is not None and row.get("end_s") is not None:
            row["latency_s"] = row["end_s"] - row["begin_s"]
    return ordered


def _count_name(event: str) -> str:
    return f"{column_name(event)}_count"


def _take(
    row: dict[str, Any], line: LogLine, item: LoggedItem, places: Mapping[int, Sequence[float]]
) -> None:
    if line.event in item.counted_events:
        row[_count_name(line.event)] += 1
        return
    if line.event == item.begin_event:
        row["begin_s"] = line.time_s
    for outcome in item.outcomes:
        if line.event == outcome.event:
            row |= {"end_s": line.time_s, "outcome": outcome.name, "success": outcome.success}
    if item.cell_field and line.numbers(item.cell_field):
        row["cell"] = int(line.numbers(item.cell_field)[0])
        _place(row, places.get(row["cell"], ()))
    if item.place_field:
        _place(row, line.numbers(item.place_field))
    velocity = line.numbers(item.velocity_field) if item.velocity_field else []
    if len(velocity) == 3:
        row["speed_mps"] = math.sqrt(sum(part * part for part in velocity))
        row |= {f"velocity_{axis}_mps": v for axis, v in zip(_AXES, velocity, strict=True)}
    known = {item.id_field, item.cell_field, item.place_field, item.velocity_field}
    for name, text in line.fields.items():
        if name not in known:
            row |= _further(name, text)


def _place(row: dict[str, Any], place: Sequence[float]) -> None:
    row |= {f"{axis}_m": value for axis, value in zip(_AXES, place, strict=False)}


def _further(name: str, text: str) -> dict[str, Any]:
    """Return columns of a field that every game may have in its own form."""
    column, values = column_name(name), _numbers(text)
    if not column:
        return {}
    if len(values) > 1:
        names = _AXES if len(values) <= len(_AXES) else map(str, range(len(values)))
        return {f"log_{column}_{axis}": v for axis, v in zip(names, values, strict=False)}
    # A word alone says something by being there: the hand that cut.
    return {f"log_{column}": values[0] if values else text or True}


def _places(log: Sequence[LogLine], item: LoggedItem) -> dict[int, Sequence[float]]:
    """Return the world position of each cell, from the event that lists them."""
    found: dict[int, Sequence[float]] = {}
    for line in log:
        if item.places_event and line.event.startswith(item.places_event):
            for inside in re.findall(r"\[([^\]]*)\]", line.event):
                values = _numbers(inside)
                if len(values) >= 4:
                    found[int(values[0])] = values[-3:]
    return found


def item_columns(rows: Sequence[Mapping[str, Any]]) -> list[Column]:
    """Return the columns of these rows: those of every user, then those of this game's log."""
    known = {column.name for column in EVENT_COLUMNS}
    further: list[Column] = []
    for row in rows:
        own = {name: value for name, value in row.items() if name not in known}
        told = {name: ("", _told(name)) for name in own}
        further += columns_of(own, told)
    return merged([*EVENT_COLUMNS, *further])


def _told(name: str) -> str:
    if name.endswith("_count") and not name.startswith("log_"):
        return f"How often the log has {name.removesuffix('_count')} of it"
    return f"Field {name.removeprefix('log_')!r} of the game's log"


def events_of_episode(episode: str, folder: Path, facts: GameFacts) -> list[dict[str, Any]]:
    """Return the rows of a round with its log in ``folder``; none without a log.

    Raises:
        InputError: The log cannot be read.
    """
    file = folder / "events.csv"
    if not file.is_file():
        return []
    try:
        return item_rows(episode, read_log(file), facts)
    except (ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(str(file), str(error), "the log of a round") from error
