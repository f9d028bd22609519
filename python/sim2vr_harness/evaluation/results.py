"""The file of an evaluation's results, to which later evaluations add."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_json, write_atomically

_WHO = ("user", "trained_steps")
_HOW = ("episodes", "seed", "deterministic", "overrides", "app")
_PLAYERS = "people"
"""A setting that results have only where several people played."""
_WORDS = {
    "people": "people",
    "user": "user",
    "trained_steps": "trained steps",
    "episodes": "rounds",
    "seed": "seed",
    "deterministic": "deterministic",
    "overrides": "changes",
    "app": "app",
}


class EvaluationResults:
    """``results.json`` of a folder: condition -> what was measured of one user.

    Args:
        folder: Where the file is, or will be.

    Raises:
        InputError: The file is there and cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self.file = folder / "results.json"
        self._there: dict[str, dict[str, Any]] = {}
        if self.file.exists() or self.file.is_symlink():
            expected = "results of an evaluation, or another --out"
            there = read_json(self.file, expected)
            for condition, summary in there.items():
                if not isinstance(summary, dict):
                    got = f"{shown(condition)} of {shown(summary, 40)}"
                    raise InputError(file_name(self.file), got, expected)
            self._there = there

    def require_room(self, conditions: Sequence[str], settings: Mapping[str, Any]) -> None:
        """Check that results with these settings can be added without losing others.

        Results of the same conditions and settings are the same numbers again, and are replaced.

        Args:
            conditions: To be added.
            settings: ``user``, ``trained_steps``, ``episodes``, ``seed``, ``deterministic``,
                ``overrides`` and ``app`` of all of them, and ``people`` where some were requested.

        Raises:
            InputError: There are results of another user, or of a condition with other settings.
        """
        for condition, summary in self._there.items():
            compared = (*_WHO, *_HOW, _PLAYERS) if condition in conditions else _WHO
            for key in compared:
                there, new = summary.get(key), settings.get(key)
                if there != new:
                    raise InputError(
                        "--out",
                        f"{str(self.file.parent)!r}, which has results of {condition} with "
                        f"{_WORDS[key]} {_short(there)}, not {_short(new)}",
                        "another folder, the same settings, or --overwrite to lose those results",
                    )

    def add(self, summaries: Mapping[str, dict[str, Any]], *, overwrite: bool = False) -> Path:
        """Write the file with these results beside those that it has.

        Args:
            summaries: condition -> results.
            overwrite: Leave out all other results.
        """
        kept = {} if overwrite else self._there
        content = {**kept, **summaries}
        write_atomically(self.file, (json.dumps(content, indent=2) + "\n").encode())
        return self.file


def _short(value: Any) -> str:
    text = str(value) if not isinstance(value, (list, dict)) else json.dumps(value)
    return text if len(text) <= 60 else f"...{text[-57:]}"
