"""A study's tables: those of its cells in one, with the factors as columns."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.files import file_name, read_json, write_atomically
from sim2vr_harness.client import Measure
from sim2vr_harness.evaluation.data import Column, EvaluationData, read_data
from sim2vr_harness.evaluation.data.columns import column_name, merged, row_table
from sim2vr_harness.evaluation.data.folder import (
    FOLDER,
    columns_in,
    data_frame,
    dictionary_bytes,
    joined,
    parquet_bytes,
    read_table,
)
from sim2vr_harness.studies.config import StudyConfig, content_hash, parse_study
from sim2vr_harness.studies.jobs import (
    CELLS,
    HASHES,
    TRAININGS,
    CellTask,
    changed_file,
    hashes_of,
    require_whole_cell,
)
from sim2vr_harness.studies.plan import StudyPlan
from sim2vr_harness.studies.search import Found

STUDY_FILE = "study.json"
"""The study and what is needed to read its tables: measures and units."""
STATISTICS_FILE = "statistics.json"
_CELL = Column("design_cell", "text", "", "Cell of the study's design; a key of the table cells")
_EXPECTED = "what a study wrote, or another folder"
_LONGEST_NAME = 120
"""Of a cell's folder of exported files, in characters."""
_UNCHANGED = "what the study wrote; run the study again, which writes its tables anew"


def factor_column(name: str) -> str:
    """Return the column name of a factor in the tables."""
    return f"factor_{column_name(name)}"


def write_data(plan: StudyPlan, root: Path, found: Found | None = None) -> None:
    """Write the study's tables from its cells, all of which are done.

    Args:
        plan: The study.
        root: Its folder.
        found: What its search found, if it was one.

    Raises:
        InputError: A cell's table cannot be read.
    """
    tables: dict[str, pa.Table] = {"cells": _cells_table(plan)}
    if found is not None:
        tables["trials"] = found.trials
    adapts = {task.key: task.adapts for task in plan.trainings}
    for name in ("episodes", "events"):
        parts = []
        for cell, task in zip(plan.cells, plan.tasks, strict=True):
            part = read_table(root / CELLS / task.key / FOLDER / f"{name}.parquet")
            levels = cell.levels if name == "episodes" else {}
            user = adapts.get(task.training or "")
            parts.append(_with_cell(part, cell.name, levels, plan.study, user))
        tables[name] = joined(parts)
    for name, table in tables.items():
        write_atomically(root / FOLDER / f"{name}.parquet", parquet_bytes(table))
    told = {name: columns_in(table.schema) for name, table in tables.items()}
    told |= _moment_columns(plan.tasks[0], root)
    write_atomically(root / FOLDER / "dictionary.csv", dictionary_bytes(told))
    about: dict[str, Any] = {
        "study": plan.study.model_dump(mode="json"),
        "game": plan.facts.name,
        "score": plan.facts.score,
        "unit": unit_of(plan.study),
        "measures": [_told(measure) for measure in plan.known
                     if measure.name in plan.measures],
        "grids": [_told(measure) for measure in plan.facts.grids],
        HASHES: hashes_of(root / FOLDER),
    }  # fmt: skip
    if found is not None:
        optimise = found.search.model_dump(mode="json", exclude_defaults=True)
        sought = {"optimise": optimise, "sampler": found.sampler}
        about |= {"search": sought | {"measures": list(found.search.measures)}}
    write_atomically(root / STUDY_FILE, (json.dumps(about, indent=2) + "\n").encode())


def results_in(folder: Path, condition: str) -> dict[str, Any]:
    """Return an evaluation's results of a condition; empty where the file was not passed on."""
    file = folder / "results.json"
    found = read_json(file, "results of an evaluation").get(condition) if file.is_file() else None
    return found if isinstance(found, dict) else {}


def unit_of(study: StudyConfig) -> str:
    """Return the unit that n counts: ``person``, the unit factor, or ``user`` by default."""
    return "person" if study.people is not None else study.unit_factor or "user"


def _told(measure: Measure) -> dict[str, Any]:
    keys = ("name", "label", "unit", "better", "digits", "description")
    told = {key: getattr(measure, key) for key in keys}
    return told | ({"grid": list(measure.grid)} if measure.grid else {})


def _cells_table(plan: StudyPlan) -> pa.Table:
    rows, columns = [], [_CELL]
    columns += [
        Column(factor_column(name), "text", "", f"Level of the factor {name}")
        for name in plan.study.factors
    ]
    columns += [
        Column("folder", "text", "", "Where its own tables, steps and frames are"),
        Column("user", "text", "", "The trained user; none where the study trained one of nothing"),
        Column("training", "text", "", "Folder of its training, where the study trained it"),
        Column("condition", "text", "", "The game's condition"),
        Column("settings", "text", "", "JSON object: everything that the cell sets"),
    ]
    for cell, task in zip(plan.cells, plan.tasks, strict=True):
        training = None if task.training is None else f"{TRAININGS}/{task.training}"
        rows.append(
            {
                "design_cell": cell.name,
                **{factor_column(name): label for name, label in cell.levels.items()},
                "folder": f"{CELLS}/{task.key}",
                "user": cell.settings.get("user"),
                "training": training,
                "condition": task.condition,
                "settings": json.dumps(dict(sorted(cell.settings.items()))),
            }
        )
    return row_table(rows, columns)


def _with_cell(
    table: pa.Table,
    cell: str,
    levels: Mapping[str, str],
    study: StudyConfig,
    adapted: str | None,
) -> pa.Table:
    """A cell's rows with the cell, its levels and the unit of analysis in front.

    A user that went on (``adapted``: its name before) is the same unit as before.
    """
    columns = [_CELL]
    values: list[Any] = [[cell] * len(table)]
    for name, label in levels.items():
        columns.append(Column(factor_column(name), "text", "", f"Level of the factor {name}"))
        values.append([label] * len(table))
    if levels:
        what = "What n counts: the participant, the level of the unit factor, or the user"
        columns.append(Column("unit", "text", "", what))
        factor = study.unit_factor
        if study.people is not None:
            persons = table["person"].to_pylist()
            of = f"{levels[factor]}, " if factor else ""
            values.append([f"{of}person {person}" for person in persons])
        elif factor is not None:
            values.append([levels[factor]] * len(table))
        else:
            values.append(table["user"].to_pylist() if adapted is None else [adapted] * len(table))
    arrays = [
        pa.array(given, column.field.type) for given, column in zip(values, columns, strict=True)
    ]
    fields = [column.field for column in columns] + list(table.schema)
    return pa.Table.from_arrays([*arrays, *table.columns], schema=pa.schema(fields))


def _moment_columns(task: CellTask, root: Path) -> dict[str, list[Column]]:
    found: dict[str, list[Column]] = {}
    for name in ("steps", "frames"):
        files = sorted((root / CELLS / task.key / FOLDER / name).glob("*.parquet"))
        if files:
            found[name] = merged(columns_in(read_table(files[0]).schema))
    return found


@dataclass(frozen=True)
class StudyData:
    """A study's tables as data frames of pandas, read when requested.

    Attributes:
        root: The study's folder.
        study: What it was.
        about: ``game``, ``score``, ``unit``, ``measures`` and ``grids`` as the game publishes them;
            of a search ``search``.
    """

    root: Path
    study: StudyConfig
    about: Mapping[str, Any]

    @cached_property
    def cells(self) -> Any:
        """A row per cell: its levels, folder, user. Key: ``design_cell``."""
        return data_frame(read_table(self.root / FOLDER / "cells.parquet"))

    @cached_property
    def trials(self) -> Any:
        """A row per trial of a search: parameters, measures, whether it is among the best.

        Key: ``trial``; ``design_cell`` of those that were played.

        Raises:
            InputError: The study was no search.
        """
        if "search" not in self.about:
            raise InputError(file_name(self.root), "a study without optimise", "a search")
        return data_frame(read_table(self.root / FOLDER / "trials.parquet"))

    @cached_property
    def episodes(self) -> Any:
        """A row per episode: levels (``factor_...``), ``unit``, measures.

        Keys: ``design_cell``, ``episode``.
        """
        return data_frame(read_table(self.root / FOLDER / "episodes.parquet"))

    @cached_property
    def events(self) -> Any:
        """A row per item that came and went.

        Keys: ``design_cell``, ``episode``, ``item``, ``item_id``.
        """
        return data_frame(read_table(self.root / FOLDER / "events.parquet"))

    @cached_property
    def dictionary(self) -> Any:
        """A row per column of every table: type, unit, description."""
        return EvaluationData(self.root / FOLDER).dictionary

    @cached_property
    def statistics(self) -> dict[str, Any]:
        """``summaries`` of each condition and measure, ``results`` of the comparisons.

        ``versions`` are those of the packages that worked them out.
        """
        file = self.root / STATISTICS_FILE
        found = read_json(file, _EXPECTED)
        if found.pop(HASHES, None) not in (None, content_hash(found)):
            raise InputError(file_name(file), "other content than the study wrote", _UNCHANGED)
        return found

    @cached_property
    def unpractised(self) -> dict[str, list[str]]:
        """Conditions that users were not trained for -> names of the cells."""
        found: dict[str, list[str]] = {}
        cells = self.cells
        for cell, place, condition in zip(
            cells["design_cell"], cells["folder"], cells["condition"], strict=True
        ):
            for line in results_in(self.root / place, str(condition)).get("unpractised", ()):
                found.setdefault(str(line), []).append(str(cell))
        return found

    def of_cell(self, cell: str) -> EvaluationData:
        """One cell's own tables, with steps and frames.

        Raises:
            InputError: There is no such cell.
        """
        folders = dict(zip(self.cells["design_cell"], self.cells["folder"], strict=True))
        if cell not in folders:
            raise unknown_name("cell", cell, folders)
        return read_data(self.root / folders[cell])

    def steps(self, cell: str, *episodes: str, columns: Sequence[str] | None = None) -> Any:
        """Steps of a cell; see :meth:`EvaluationData.steps`."""
        return self.of_cell(cell).steps(*episodes, columns=columns)

    def frames(self, cell: str, *episodes: str, columns: Sequence[str] | None = None) -> Any:
        """App frames of a cell; see :meth:`EvaluationData.frames`."""
        return self.of_cell(cell).frames(*episodes, columns=columns)

    def export(
        self,
        write: Callable[[EvaluationData, Path, Sequence[str]], list[Path]],
        out: Path,
        episodes: Sequence[str] = (),
    ) -> list[Path]:
        """Write every cell's episodes.

        Args:
            write: Writes those of one cell, such as :func:`.export_opensim` or
                :meth:`.EvaluationData.export_csv`.
            out: Folder for a folder per cell, named as the cell; characters that are unusual in
                names of files become ``_``.
            episodes: Which, in the cells that have them; all without any.

        Returns:
            The files.

        Raises:
            InputError: No cell has such an episode, or a cell kept no steps.
        """
        there = self.episodes.groupby("design_cell")["episode"].agg(list)
        for key in episodes:
            if not any(key in keys for keys in there):
                raise unknown_name("episode", key, sorted(set(self.episodes["episode"])))
        files: list[Path] = []
        taken: set[str] = set()
        for number, cell in enumerate(self.cells["design_cell"]):
            chosen = [key for key in there[cell] if not episodes or key in episodes]
            name = re.sub(r"[^\w.,=+-]+", "_", cell)[:_LONGEST_NAME]
            name = f"{name}_{number}" if name in taken else name
            taken.add(name)
            if chosen:
                files += write(self.of_cell(cell), out / name, chosen)
        return files


def read_study(folder: str | Path) -> StudyData:
    """Return what a study has measured, and check that no file of it has changed since.

    Args:
        folder: Of a study that is done.

    Raises:
        InputError: There is none, or a file of it or of a cell is not what the study wrote.
    """
    data = open_study(folder)
    changed = changed_file(data.root / FOLDER, data.about.get(HASHES, {}))
    if changed is not None:
        raise InputError(file_name(data.root / FOLDER / changed[0]), changed[1], _UNCHANGED)
    for cell, place in zip(data.cells["design_cell"], data.cells["folder"], strict=True):
        if (data.root / place).is_dir():  # tables alone can be passed on
            require_whole_cell(cell, data.root / place)
    return data


def open_study(folder: str | Path) -> StudyData:
    """Return what a study has measured, whose files this program has just checked or written.

    Raises:
        InputError: There is none.
    """
    root = Path(folder)
    if not (root / STUDY_FILE).is_file():
        raise InputError(
            file_name(root), f"no {STUDY_FILE} in it", "the folder of a study that is done"
        )
    about = read_json(root / STUDY_FILE, _EXPECTED)
    if not isinstance(about.get("study"), dict):
        raise InputError(file_name(root / STUDY_FILE), "no study in it", _EXPECTED)
    if not isinstance(about.get(HASHES, {}), dict):
        raise InputError(file_name(root / STUDY_FILE), f"no hashes as {HASHES!r}", _EXPECTED)
    return StudyData(root, parse_study(about.pop("study")), about)


def players_of(data: StudyData) -> dict[str, list[Path]]:
    """Name -> folders of a player's cells, in the order of the study.

    A player is a combination of levels of all factors but those that set the game's condition;
    named by these levels.
    """
    factors = data.study.factors
    who = [name for name, factor in factors.items() if factor.keys != {"condition"}]
    found: dict[str, list[Path]] = {}
    for _, row in data.cells.iterrows():
        levels = [str(row[factor_column(name)]) for name in who]
        found.setdefault(", ".join(levels) or data.study.name, []).append(data.root / row["folder"])
    return found
