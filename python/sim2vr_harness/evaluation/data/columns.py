"""Columns of a table, each with its type, unit and meaning, and tables that are made of them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa

Kind = Literal["text", "integer", "number", "single", "boolean"]

_ARROW: dict[str, pa.DataType] = {
    "text": pa.string(),
    "integer": pa.int64(),
    "number": pa.float64(),
    "single": pa.float32(),
    "boolean": pa.bool_(),
}


@dataclass(frozen=True)
class Column:
    """A column of a table, and its line of the data dictionary.

    Attributes:
        name: Lower case, unit last.
        kind: ``number`` is binary64, ``single`` binary32.
        unit: Such as ``m/s``; empty for names, counts and proportions.
        description: One line on its meaning.
    """

    name: str
    kind: Kind
    unit: str
    description: str

    @property
    def field(self) -> pa.Field:
        """The column as Parquet has it, with unit and description as metadata."""
        told = {"unit": self.unit, "description": self.description}
        return pa.field(self.name, _ARROW[self.kind], metadata=told)


def column_name(text: str) -> str:
    """Return the column name for a text: ``hammer.depth_m`` -> ``hammer_depth_m``."""
    return re.sub(r"\W+", "_", text.strip()).strip("_").lower()


def columns_of(values: Mapping[str, Any], told: Mapping[str, tuple[str, str]]) -> list[Column]:
    """Return columns for plain values, by their types; those without a value are left out.

    Args:
        values: name -> text, number or boolean.
        told: name -> unit and description.
    """
    found = []
    for name, value in values.items():
        unit, description = told.get(name, ("", ""))
        if isinstance(value, bool):
            found.append(Column(name, "boolean", unit, description))
        elif isinstance(value, int):
            found.append(Column(name, "integer", unit, description))
        elif value is not None:
            kind: Kind = "number" if isinstance(value, float) else "text"
            found.append(Column(name, kind, unit, description))
    return found


def merged(columns: Iterable[Column]) -> list[Column]:
    """Return the columns without repetitions, in the order of their first appearance.

    Whole numbers and fractions of one name become fractions; anything else unlike becomes text.
    """
    found: dict[str, Column] = {}
    for column in columns:
        known = found.get(column.name)
        if known is not None and known.kind != column.kind:
            kind: Kind = "number" if {known.kind, column.kind} <= _NUMBERS else "text"
            column = Column(known.name, kind, known.unit, known.description)
        elif known is not None:
            continue
        found[column.name] = column
    return list(found.values())


_NUMBERS = {"integer", "number", "single"}


def schema_of(columns: Sequence[Column]) -> pa.Schema:
    """Return the schema of a table with these columns."""
    return pa.schema([column.field for column in columns])


def row_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> pa.Table:
    """Return a table of rows; a value that a row lacks is null."""
    arrays = [
        pa.array([_as(row.get(column.name), column.kind) for row in rows], column.field.type)
        for column in columns
    ]
    return pa.Table.from_arrays(arrays, schema=schema_of(columns))


def _as(value: Any, kind: Kind) -> Any:
    if value is None:
        return None
    if kind == "text":
        return str(value)
    return float(value) if kind in ("number", "single") else value


def number_table(
    episode: str, counts: Sequence[tuple[Column, Any]], values: Any, columns: Sequence[Column]
) -> pa.Table:
    """Return a table of many numbers, a row per moment of one episode.

    Args:
        episode: The key of the episode, its first column.
        counts: Columns that come next, with their (T,) values.
        values: (T, C) numbers.
        columns: The C columns of them.
    """
    n = len(values)
    first = Column("episode", "text", "", "The episode; a key of the table episodes")
    arrays = [pa.array([episode] * n, pa.string())]
    arrays += [pa.array(np.asarray(given), column.field.type) for column, given in counts]
    arrays += [
        pa.array(np.ascontiguousarray(values[:, i]), column.field.type)
        for i, column in enumerate(columns)
    ]
    return pa.Table.from_arrays(
        arrays, schema=schema_of([first, *(column for column, _ in counts), *columns])
    )
