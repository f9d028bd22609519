"""The folder of an evaluation's tables: written, added to, read again."""

import csv
import io
import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.files import file_name, read_bytes, read_json, write_atomically
from sim2vr_harness.evaluation.data.columns import Column, merged, row_table, schema_of
from sim2vr_harness.runs.run_folder import versions

FOLDER = "data"
"""In the folder of an evaluation."""
_DICTIONARY = "dictionary.csv"
_MANIFEST = "manifest.json"
"""File of the versions and settings that the episodes were recorded with."""
_ROW_TABLES = ("episodes", "events")
"""One file each."""
_MOMENT_TABLES = ("steps", "frames")
"""A file per episode, in a folder each."""
_EXPECTED = "a table that an evaluation wrote, or another folder"


class DataFolder:
    """Folder that tables are written to.

    ``episodes`` and ``events`` are one table each, ``steps`` and ``frames`` one per episode. Every
    table is a Parquet file, with units and descriptions of its columns as metadata;
    ``dictionary.csv`` has a line per column of all tables, ``manifest.json`` the versions that each
    episode was recorded with.

    Args:
        root: The folder; made when something is written.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._moments: dict[str, list[Column]] = {}

    def clear(self) -> None:
        """Remove all tables."""
        for name in (*_ROW_TABLES, *_MOMENT_TABLES):
            shutil.rmtree(self.root / name, ignore_errors=True)
            for file in self.root.glob(f"{name}.*"):
                file.unlink()
        for left in (_DICTIONARY, _MANIFEST):
            (self.root / left).unlink(missing_ok=True)

    def write_moments(self, name: str, episode: str, table: pa.Table) -> None:
        """Write the steps or frames of one episode, in the place of those that are there.

        Raises:
            OSError: names the file, on a full disk for example.
        """
        write_atomically(self.root / name / f"{episode}.parquet", parquet_bytes(table))
        self._moments[name] = merged([*self._moments.get(name, []), *columns_in(table.schema)])

    def add(
        self, tables: Mapping[str, tuple[Sequence[Mapping[str, Any]], Sequence[Column]]]
    ) -> None:
        """Add rows to ``episodes`` and ``events``; rows of the same episodes are replaced.

        Args:
            tables: name -> rows with an ``episode`` each, and their columns.

        Raises:
            InputError: An existing table, or the manifest, cannot be read.
        """
        new = {str(row["episode"]) for row in tables["episodes"][0]}
        # The manifest with episodes of now, which earlier ones of the same keys make room for.
        here, own, others = versions(), set(new), []
        for known in _recorded_with(self.root):
            with_kept = set(known["episodes"]) - new
            if known["versions"] == here:
                own |= with_kept
            elif with_kept:
                others.append({"versions": known["versions"], "episodes": sorted(with_kept)})
        manifest = {"recorded_with": [*others, {"versions": here, "episodes": sorted(own)}]}
        written = {}
        for name, (rows, columns) in tables.items():
            table = row_table(rows, columns)
            if (self.root / f"{name}.parquet").exists():
                there = read_table(self.root / f"{name}.parquet")
                kept = there.filter(pc.invert(pc.is_in(there["episode"], pa.array(list(new)))))
                table = joined([kept, table])
            written[name] = table
        for name, table in written.items():
            write_atomically(self.root / f"{name}.parquet", parquet_bytes(table))
        write_atomically(self.root / _MANIFEST, (json.dumps(manifest, indent=2) + "\n").encode())
        self._write_dictionary({name: columns_in(t.schema) for name, t in written.items()})

    def _write_dictionary(self, tables: Mapping[str, Sequence[Column]]) -> None:
        kept: dict[str, list[Column]] = {name: list(columns) for name, columns in tables.items()}
        for name in _MOMENT_TABLES:
            known = self._moments.get(name, [])
            file = next(iter(sorted((self.root / name).glob("*.parquet"))), None)
            if not known and file is not None:
                known = columns_in(pq.read_schema(file))
            if known:
                kept[name] = list(known)
        write_atomically(self.root / _DICTIONARY, dictionary_bytes(kept))


def _recorded_with(root: Path) -> list[dict[str, Any]]:
    """Return versions and the episodes that were recorded with them; none without a manifest.

    Raises:
        InputError: The manifest cannot be read.
    """
    file = root / _MANIFEST
    if not file.is_file():
        return []
    sets = read_json(file, _EXPECTED).get("recorded_with")
    if isinstance(sets, list) and all(isinstance(one, dict) for one in sets):
        usual = {"versions": dict, "episodes": list}
        if all(isinstance(one.get(key), kind) for one in sets for key, kind in usual.items()):
            return sets
    raise InputError(file_name(file), "no list 'recorded_with' of versions and episodes", _EXPECTED)


def parquet_bytes(table: pa.Table) -> bytes:
    """Return a table as a Parquet file; equal rows give equal bytes."""
    stream = io.BytesIO()
    singles = [field.name for field in table.schema if field.type == pa.float32()]
    words = [field.name for field in table.schema if field.type == pa.string()]
    pq.write_table(
        table,
        stream,
        compression="zstd",
        use_dictionary=words,
        use_byte_stream_split=singles,  # measurements do not repeat, their leading bytes do
    )
    return stream.getvalue()


def dictionary_bytes(tables: Mapping[str, Iterable[Column]]) -> bytes:
    """Return the data dictionary: a line per column of every table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["table", "column", "type", "unit", "description"])
    for name, columns in tables.items():
        for column in columns:
            writer.writerow([name, column.name, column.kind, column.unit, column.description])
    return text.getvalue().encode()


def columns_in(schema: pa.Schema) -> list[Column]:
    """Return the columns of a schema, as :attr:`Column.field` made them."""
    kinds = {
        "string": "text", "int64": "integer", "double": "number", "float": "single",
        "bool": "boolean",
    }  # fmt: skip
    found = []
    for field in schema:
        told = {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
        found.append(
            Column(
                field.name,
                kinds.get(str(field.type), "text"),  # type: ignore[arg-type]
                told.get("unit", ""),
                told.get("description", ""),
            )
        )
    return found


def joined(tables: Sequence[pa.Table]) -> pa.Table:
    """Concatenate tables; a column that one lacks is null there."""
    columns = merged(column for table in tables for column in columns_in(table.schema))
    schema = schema_of(columns)
    parts = []
    for table in tables:
        arrays = []
        for field in schema:
            if field.name in table.column_names:
                arrays.append(table[field.name].cast(field.type))
            else:
                arrays.append(pa.nulls(len(table), field.type))
        parts.append(pa.table(arrays, schema=schema))
    return pa.concat_tables(parts)


def read_table(file: Path, columns: Callable[[list[str]], list[str]] | None = None) -> pa.Table:
    """Return the table of a Parquet file.

    Args:
        columns: Chooses from the names of its columns; None: all.

    Raises:
        InputError: It is missing, damaged, or something else.
    """
    content = read_bytes(file, _EXPECTED)
    try:
        # Not `pq.read_table`: where that fails, threads of pyarrow go on, hold Python's bytes and
        # abort a program that ends meanwhile.
        with pq.ParquetFile(pa.BufferReader(content)) as parquet:
            names = parquet.schema_arrow.names
            wanted = names if columns is None else columns(names)
            return parquet.read(wanted, use_threads=False).select(wanted)
    except (pa.ArrowException, OSError) as error:
        raise InputError(file_name(file), "no Parquet, or a damaged one", _EXPECTED) from error


def data_frame(table: pa.Table) -> Any:
    """Return a table as pandas has it; truths that are missing are no obstacle to choosing rows."""
    import pandas as pd

    return table.to_pandas(types_mapper={pa.bool_(): pd.BooleanDtype()}.get)


@dataclass(frozen=True)
class EvaluationData:
    """The tables of an evaluation as data frames of pandas, read when requested.

    Attributes:
        root: The folder ``data`` of the evaluation.
    """

    root: Path

    @cached_property
    def episodes(self) -> Any:
        """Table with a row per episode: user, condition, every measure. Key: ``episode``."""
        return data_frame(read_table(self.root / "episodes.parquet"))

    @cached_property
    def events(self) -> Any:
        """Table with a row per item that appeared. Keys: ``episode``, ``item``, ``item_id``."""
        return data_frame(read_table(self.root / "events.parquet"))

    def steps(self, *episodes: str, columns: Sequence[str] | None = None) -> Any:
        """Return a row per user step of these episodes, or of all. Keys: ``episode``, ``step``.

        Args:
            episodes: Keys of the table ``episodes``.
            columns: Columns to read in addition to the keys; None: all.

        Raises:
            InputError: There is no such episode, or it has no steps.
        """
        return self._moments("steps", ("episode", "step", "time_s"), episodes, columns)

    def frames(self, *episodes: str, columns: Sequence[str] | None = None) -> Any:
        """A row per frame of the app, from its own log. Keys: ``episode``, ``frame``.

        ``step`` leads to the table of steps.

        Args:
            episodes: As of :meth:`steps`.
            columns: As of :meth:`steps`.

        Raises:
            InputError: There is no such episode, or it has no frames.
        """
        return self._moments("frames", ("episode", "frame", "step", "time_s"), episodes, columns)

    def episode_keys(self, wanted: Sequence[str] = ()) -> list[str]:
        """Return keys of the table ``episodes``: those that are wanted, or all.

        Raises:
            InputError: There is no such episode.
        """
        known = list(self.episodes["episode"])
        for key in wanted:
            if key not in known:
                raise unknown_name("episode", key, known)
        return list(wanted) or known

    @cached_property
    def dictionary(self) -> Any:
        """A row per column of every table: type, unit, description."""
        import pandas as pd

        content = read_bytes(self.root / _DICTIONARY, _EXPECTED)
        return pd.read_csv(io.BytesIO(content), keep_default_na=False)

    @cached_property
    def recorded_with(self) -> list[dict[str, str]]:
        """Versions of this package, Python and others at the time, one entry for each difference.

        Empty for tables without a manifest.
        """
        return [dict(one["versions"]) for one in _recorded_with(self.root)]

    def export_csv(self, out: Path, episodes: Sequence[str] = ()) -> list[Path]:
        """Write the tables as CSV files of the same names, empty if a value is missing.

        Args:
            out: Folder for the files; made if needed.
            episodes: Episodes whose steps and frames are written; empty: all. Other tables are
                complete.

        Returns:
            The files, and ``dictionary.csv``.

        Raises:
            InputError: There is no such episode, or a table cannot be read.
        """
        self.episode_keys(episodes)
        files = [out / _DICTIONARY]
        write_atomically(files[0], read_bytes(self.root / _DICTIONARY, _EXPECTED))
        for file in sorted(self.root.rglob("*.parquet")):
            if file.parent == self.root or not episodes or file.stem in episodes:
                stream = pa.BufferOutputStream()
                pyarrow.csv.write_csv(read_table(file), stream)
                place = (out / file.relative_to(self.root)).with_name(f"{file.stem}.csv")
                write_atomically(place, bytes(stream.getvalue().to_pybytes()))
                files.append(place)
        return files

    def _moments(
        self,
        name: str,
        keys: Sequence[str],
        episodes: Sequence[str],
        columns: Sequence[str] | None,
    ) -> Any:
        there = {file.stem: file for file in sorted((self.root / name).glob("*.parquet"))}
        known = [key for key in self.episodes["episode"] if key in there]
        if not known:
            expected = (
                f"an evaluation without --no-steps; of a study read_study(FOLDER).{name}(CELL)"
            )
            raise InputError(file_name(self.root / name), f"no {name}", expected)
        for key in episodes:
            if key not in known:
                raise unknown_name("episode", key, known)
        chosen = _chosen(keys, columns)
        return data_frame(joined([read_table(there[key], chosen) for key in episodes or known]))


def _chosen(keys: Sequence[str], columns: Sequence[str] | None) -> Callable[[list[str]], list[str]]:
    def choose(names: list[str]) -> list[str]:
        if columns is None:
            return names
        for column in columns:
            if column not in names:
                raise unknown_name("column", column, names)
        return list(dict.fromkeys([*keys, *columns]))

    return choose


def read_data(folder: str | Path) -> EvaluationData:
    """Return the tables of an evaluation, or of a study.

    Args:
        folder: Of the evaluation or the study, or its folder ``data``.

    Raises:
        InputError: There are none.
    """
    root = Path(folder)
    for place in (root, root / FOLDER):
        if (place / "episodes.parquet").is_file():
            return EvaluationData(place)
    raise InputError(
        file_name(root),
        f"no {FOLDER}/episodes.parquet in it",
        "the folder of an evaluation or of a study",
    )
