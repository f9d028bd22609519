"""Hashes of what a study wrote: a file that has changed since is not believed."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name, read_json
from sim2vr_harness.base.notices import notice_once

HASHES = "sha256"
"""Key of a JSON file: name -> hash of the files that it vouches for."""
_MARK = "cell.json"
_NO_HASHES = (
    "note: this study has cells from before hashes were kept; their files are taken as they are"
)


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
    hashes = about.get(HASHES, {})
    if about.get("key") != folder.name or not isinstance(hashes, dict):
        damage: tuple[str, str] | None = (_MARK, "other content than the study wrote")
    elif HASHES not in about:
        notice_once(_NO_HASHES)
        return
    else:
        damage = changed_file(folder, hashes)
    if damage is not None:
        raise InputError(f"cell {cell}: {file_name(folder / damage[0])}", damage[1], expected)
