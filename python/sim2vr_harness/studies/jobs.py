"""Tasks of a study, and the folders of their results."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name, read_json

if TYPE_CHECKING:
    from sim2vr_harness.envs.config import EnvConfig
    from sim2vr_harness.studies.config import StopConfig

CELLS, TRAININGS = "cells", "trainings"
"""Folders of a study, with a folder per task, named by its key."""


@dataclass(frozen=True)
class Pruning:
    """Earlier trials that a training is compared with, and the rule by which it stops.

    Attributes:
        earlier: Per completed trial, pairs of user step and reported value.
    """

    stop: StopConfig
    earlier: tuple[tuple[tuple[int, float], ...], ...]


@dataclass(frozen=True)
class TrainingTask:
    """A user to be trained.

    Attributes:
        key: Hash of its configuration; the name of the run's folder.
        config: The complete configuration, YAML.
        label: For people.
        pruning: When it is stopped early; None: never.
        may_diverge: Whether one whose numbers become infinite is taken for stopped, as in a search
            that tries what no one would; otherwise it has failed.
        adapts: Name of the trained user that goes on; None: it begins with nothing.
    """

    key: str
    config: str
    label: str
    pruning: Pruning | None = None
    may_diverge: bool = False
    adapts: str | None = None


@dataclass(frozen=True)
class CellTask:
    """A cell to be played.

    Attributes:
        key: Hash of all that decides about its bytes; the name of its folder.
        cell: Whose key in the study's tables.
        user: A trained user as ``evaluate`` takes it; None: the one of ``training``.
        training: Key of the training that it waits for.
        condition: Of the game.
        overrides: ``env.key=value``.
        env: What these make, whose app this user was asked about.
        trust_app: Whether this user trusts whatever app its files name.
        episodes, seed, people, deterministic, steps, logs: As of an evaluation.
        film_seconds: Of the first round, to be filmed; 0: no film.
    """

    key: str
    cell: str
    user: str | None
    training: str | None
    condition: str
    overrides: tuple[str, ...]
    env: EnvConfig
    trust_app: bool
    episodes: int
    seed: int
    people: int | None
    deterministic: bool
    steps: bool
    logs: bool
    film_seconds: float


Task = CellTask | TrainingTask


def folder_of(task: Task, root: Path) -> Path:
    """Return the folder of a task's results; it need not exist yet."""
    return root / (CELLS if isinstance(task, CellTask) else TRAININGS) / task.key


def mark_of(task: Task) -> str:
    """The file in a task's folder that says that it is done."""
    return "cell.json" if isinstance(task, CellTask) else "trained.json"


def is_done(task: Task, root: Path) -> bool:
    """Return whether a task is complete."""
    return (folder_of(task, root) / mark_of(task)).is_file()


HASHES = "sha256"
"""Key of a JSON file: name -> hash of the files that it vouches for."""
_MARK = "cell.json"


def hashes_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file in a folder but locks, by its name relative to it."""
    found = {}
    files = (file for file in folder.rglob("*") if file.is_file() and file.name != ".lock")
    for file in sorted(files):
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256")
        found[file.relative_to(folder).as_posix()] = digest.hexdigest()
    return found


def changed_file(folder: Path, hashes: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first file that is missing or has changed, and which; None: all are as written."""
    there = hashes_of(folder)
    for name, digest in hashes.items():
        if there.get(name) != digest:
            return name, "other content than the study wrote" if name in there else "no such file"
    return None


def require_whole_cell(cell: str, folder: Path) -> None:
    """Refuse a finished cell with a file that is not what the study wrote.

    Args:
        cell: Its name.
        folder: Where its files are.

    Raises:
        InputError: Names the cell, the file and what to do.
    """
    expected = (
        "the file that the study wrote: put it back from a copy, or play the cell again with "
        "sim2vr-harness study --replay-damaged"
    )
    try:
        about = read_json(folder / _MARK, expected)
    except InputError as error:
        raise InputError(f"cell {cell}: {error.field}", error.got, expected) from error
    hashes = about.get(HASHES)
    if about.get("key") != folder.name or not isinstance(hashes, dict):
        damage: tuple[str, str] | None = (_MARK, "other content than the study wrote")
    else:
        damage = changed_file(folder, hashes)
    if damage is not None:
        raise InputError(f"cell {cell}: {file_name(folder / damage[0])}", damage[1], expected)
