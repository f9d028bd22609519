"""Published results of people and of other authors' users, for comparison in reports.

``published.yaml`` in a game's room says it; ``people.csv`` beside it has a row per person and
condition with the game's measures.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from importlib import resources
from typing import Any

import pydantic
from pydantic import Field

from sim2vr_harness.base.files import read_text, read_yaml
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.games.registry import room_of

_EXPECTED = "what is published of a game"
_SAME_S = 2.0
"""Rounds end with a frame, and people's logs begin before."""


class PublishedPeople(Settings):
    """People's own rounds."""

    title: str
    file: str
    """CSV with ``person``, ``condition`` and columns named as measures."""
    citation: str
    duration_s: float = Field(gt=0.0)
    """Duration of their rounds, s."""
    same: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Condition of the file -> other names that the game has for it."""
    grids: dict[str, dict[str, tuple[float, ...]]] = Field(default_factory=dict)
    """Grid -> condition -> mean over people, place by place."""


class PublishedValues(Settings):
    """A measure of someone else's users."""

    source: str
    measure: str
    by: str = "condition"
    """The column of the table of episodes whose values ``values`` has as keys."""
    only: dict[str, tuple[Any, ...]] = Field(default_factory=dict)
    """Columns of that table -> the values for which they hold."""
    values: dict[str, float]


class PublishedTest(Settings):
    """A test that someone else made."""

    source: str
    what: str
    test: str
    n: int
    z: float
    p: float


class Published(Settings):
    """Published data of a game from other studies."""

    people: PublishedPeople | None = None
    values: tuple[PublishedValues, ...] = ()
    tests: tuple[PublishedTest, ...] = ()
    per_round: tuple[str, ...] = ()
    """Measures that grow with the round's length; they are compared for equal lengths only."""
    differences: tuple[str, ...] = ()
    """Reasons for which the simulated numbers may differ, one sentence each."""
    rows: tuple[dict[str, str | float | None], ...] = ()
    """Rows of the recorded people, from their file."""

    def beside_rounds_of(self, duration_s: float) -> Published:
        """Return the figures for rounds of this length, without per-round ones if it differs."""
        if self.people is None or abs(duration_s - self.people.duration_s) <= _SAME_S:
            return self
        told = (
            f"Length: rounds here lasted {duration_s:.0f} s, theirs "
            f"{self.people.duration_s:.0f} s; {', '.join(self.per_round)} are not compared."
        )
        rows = [
            {key: value for key, value in row.items() if key not in self.per_round}
            for row in self.rows
        ]
        values = [one for one in self.values if one.measure not in self.per_round]
        changed = {"rows": rows, "values": values, "differences": (told, *self.differences)}
        return self.model_copy(update=changed)

    def people_in(self, condition: str, measure: str) -> list[float]:
        """Return a measure of all recorded people in a condition, under any of its names."""
        own = self.people_s_name(condition)
        values = [row.get(measure) for row in self.rows if row["condition"] == own]
        return [value for value in values if isinstance(value, float)]

    def grid_of(self, condition: str, grid: str) -> tuple[float, ...] | None:
        """People's grid in a condition; None where it is not known."""
        if self.people is None:
            return None
        return self.people.grids.get(grid, {}).get(self.people_s_name(condition))

    def people_s_name(self, condition: str) -> str:
        """Return the name of a condition in the file of recorded people."""
        for own, others in (self.people.same if self.people else {}).items():
            if condition in others:
                return own
        return condition

    def beside(self, measure: str, row: Mapping[str, Any]) -> dict[str, float]:
        """Source -> published value of a measure, for an episode's row.

        Args:
            measure: Its name.
            row: Columns of the table of episodes.
        """
        found = {}
        for one in self.values:
            fits = all(row.get(key) in allowed for key, allowed in one.only.items())
            key = row.get(one.by)
            text = f"{key:g}" if isinstance(key, float) else str(key)
            if one.measure == measure and fits and text in one.values:
                found[one.source] = one.values[text]
        return found


def published_of(game: str) -> Published:
    """Return what a game's room knows of others; nothing of a game without a room.

    Raises:
        InputError: A file of the room is damaged.
    """
    room = room_of(game)
    folder = None if room is None else resources.files(room)
    if folder is None or not folder.joinpath("published.yaml").is_file():
        return Published()
    with resources.as_file(folder) as root:
        tree = read_yaml(root / "published.yaml", _EXPECTED)
        rows: list[dict[str, str | float | None]] = []
        if tree.get("people"):
            text = read_text(root / tree["people"]["file"], _EXPECTED)
            rows = [_row(row) for row in csv.DictReader(io.StringIO(text))]
    try:
        return Published.model_validate(tree | {"rows": rows})
    except pydantic.ValidationError as error:
        raise first_problem(error, Published) from error


def _row(row: Mapping[str, str]) -> dict[str, str | float | None]:
    named = ("person", "condition")
    return {
        key: value if key in named else (float(value) if value else None)
        for key, value in row.items()
    }
