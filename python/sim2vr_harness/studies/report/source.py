"""Data of a report: the tables of an evaluation or a study, in groups to compare."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name
from sim2vr_harness.client import GameFacts, Measure, facts_of_outside
from sim2vr_harness.evaluation.data import EvaluationData, read_data
from sim2vr_harness.play.round import PLAYER_MEASURES
from sim2vr_harness.studies.config import OptimiseConfig
from sim2vr_harness.studies.data import (
    STUDY_FILE,
    factor_column,
    read_study,
    results_in,
)
from sim2vr_harness.studies.search import parameter_column

PROPORTION = "proportion"
"""Unit of numbers from 0 to 1."""
_MOST_SHOWN = 6
"""Trials of a search whose rounds are looked at closely."""


@dataclass(frozen=True)
class Group:
    """Episodes that are looked at together: a cell of a study, or a user in a condition.

    Attributes:
        label: What distinguishes it from the others, such as ``easy``.
        user: The trained user.
        condition: The game's condition.
        episodes: Its rows of the table of episodes.
        events: Its rows of the table of items.
        parts: Where its steps and frames are: tables, and which of their episodes.
    """

    label: str
    user: str
    condition: str
    episodes: Any
    events: Any
    parts: Sequence[tuple[EvaluationData, Sequence[str]]]

    @property
    def units(self) -> list[str]:
        """Unit of each episode, as counted by n: its user or participant."""
        if "unit" in self.episodes:
            return [str(unit) for unit in self.episodes["unit"]]
        persons = self.episodes["person"]
        if persons.notna().all():
            return [f"person {int(person)}" for person in persons]
        return [str(user) for user in self.episodes["user"]]

    def values(self, measure: str) -> list[float | None]:
        """A measure of every episode; None where it has none."""
        if measure not in self.episodes:
            return [None] * len(self.episodes)
        found = self.episodes[measure].to_numpy(dtype=np.float64, na_value=np.nan)
        return [float(value) if np.isfinite(value) else None for value in found]

    def moments(self, table: str, columns: Sequence[str]) -> list[Any]:
        """Steps or frames with these of their columns, a data frame per episode that has them.

        Args:
            table: ``steps`` or ``frames``.
            columns: Those that the table lacks are left out.
        """
        found = []
        for data, keys in self.parts:
            there = {file.stem for file in (data.root / table).glob("*.parquet")}
            wanted = [name for name in columns if name in _columns(data, table)]
            if wanted:
                read = getattr(data, table)
                found += [read(key, columns=wanted) for key in keys if key in there]
        return found

    def columns(self, table: str) -> list[str]:
        """Names of the columns of steps or frames."""
        return _columns(self.parts[0][0], table)


def _columns(data: EvaluationData, table: str) -> list[str]:
    rows = data.dictionary
    return list(rows[rows["table"] == table]["column"])


@dataclass(frozen=True)
class Search:
    """Result of a search.

    Attributes:
        wanted: Objectives and parameters of the search.
        trials: Table with a row per trial; see :attr:`.StudyData.trials`.
        sampler: Name of the sampler that suggested the trials.
    """

    wanted: OptimiseConfig
    trials: Any
    sampler: str

    def numbers(self, column: str) -> list[float | None]:
        """A column of the trials; None where a trial has no number."""
        found = self.trials[column].to_numpy(dtype=np.float64, na_value=np.nan)
        return [float(value) if np.isfinite(value) else None for value in found]

    def told(self, row: int) -> str:
        """A trial's number and parameters, for who points at it."""
        one = self.trials.iloc[row]
        values = ", ".join(
            f"{name} {one[parameter_column(name)]}" for name in self.wanted.parameters
        )
        return f"trial {one['trial']}: {values}"

    @property
    def shown(self) -> list[str]:
        """Labels of the trials that are looked at closely: the best, and where the search began."""
        played = self.trials[self.trials["design_cell"].notna()]
        best = played[played["chosen"]]
        if not len(best):
            best = played.iloc[-1:]
        # Evenly over a long front, its ends included.
        picked = np.unique(np.linspace(0, len(best) - 1, _MOST_SHOWN).round().astype(int))
        began = [1] if self.wanted.begin and (played["trial"] == 1).any() else []
        numbers = dict.fromkeys([*began, *best["trial"].iloc[picked].tolist()])
        return [f"trial {number}" for number in numbers]


@dataclass(frozen=True)
class ReportSource:
    """Everything that a report is about.

    Attributes:
        root: The folder.
        title: For people.
        groups: What is compared, in the order of the study or of the evaluation.
        facts: What the game publishes.
        measures: Numbers of an episode, in the order of the tables.
        grids: Measures with a number per place.
        comparisons: What a study's statistics came to, one each; empty of an evaluation.
        unit: What n counts.
        planned: The study's file, as it was read; empty of an evaluation.
        analysed_with: Package -> version that worked the comparisons out.
        search: What was found, of a search; its groups are the best trials.
    """

    root: Path
    title: str
    groups: Sequence[Group]
    facts: GameFacts
    measures: Sequence[Measure]
    grids: Sequence[Measure]
    comparisons: Sequence[Mapping[str, Any]] = ()
    unit: str = "user"
    planned: Mapping[str, Any] = field(default_factory=dict)
    analysed_with: Mapping[str, str] = field(default_factory=dict)
    search: Search | None = None

    @cached_property
    def unpractised(self) -> dict[str, list[str]]:
        """Conditions that users were not trained for -> labels of the groups."""
        found: dict[str, list[str]] = {}
        for group in self.groups:
            for line in dict.fromkeys(
                line
                for data, _ in group.parts
                for line in results_in(data.root.parent, group.condition).get("unpractised", ())
            ):
                found.setdefault(str(line), []).append(group.label)
        return found

    def leads(self, measure: str) -> bool:
        """Return whether a measure comes first: the score of a page or another outside app."""
        return not self.facts.measures and measure == self.facts.score

    @cached_property
    def recorded_with(self) -> list[dict[str, str]]:
        """Package -> version that rounds were recorded with, one entry for each difference."""
        found: list[dict[str, str]] = []
        for folder in {
            data.root: data for group in self.groups for data, _ in group.parts
        }.values():
            found += [versions for versions in folder.recorded_with if versions not in found]
        return found

    @property
    def score(self) -> Measure:
        """The measure by which the game is looked at first."""
        wanted = self.facts.score or "return"
        return next((m for m in self.measures if m.name == wanted), self.measures[0])

    def measure(self, name: str) -> Measure | None:
        """The measure of that name; None: no one has it."""
        return next((measure for measure in self.measures if measure.name == name), None)

    @cached_property
    def units(self) -> list[str]:
        """All players: what n counts."""
        return list(dict.fromkeys(unit for group in self.groups for unit in group.units))

    @cached_property
    def users(self) -> list[str]:
        """All trained users."""
        return list(dict.fromkeys(group.user for group in self.groups))


def read_source(folder: str | Path) -> ReportSource:
    """Read what a report of an evaluation or a study is made of.

    Args:
        folder: Of the evaluation or the study.

    Raises:
        InputError: There are no tables in it, or no episodes in the tables.
    """
    root = Path(folder)
    if (root / STUDY_FILE).is_file():
        return _of_study(root)
    data = read_data(root)
    if not len(data.episodes):
        raise InputError(file_name(root), "no episodes in its tables", "at least one")
    episodes, events = data.episodes, data.events
    several = episodes["user"].nunique() > 1
    groups = []
    for (user, condition), own in episodes.groupby(["user", "condition"], sort=False):
        label = f"{user}, {condition}" if several else str(condition)
        mine = events[events["episode"].isin(own["episode"])]
        parts = [(data, list(own["episode"]))]
        groups.append(Group(label, str(user), str(condition), own, mine, parts))
    facts = facts_of_outside(str(episodes["game"].iloc[0]))
    told = results_in(data.root.parent, groups[0].condition)
    facts = replace(facts, score=told.get("score_measure") or facts.score)
    known = [*facts.scalars, *PLAYER_MEASURES]
    found = [m for m in known if m.name in data.episodes and data.episodes[m.name].notna().any()]
    found = [replace(m, unit=_unit(m.unit)) for m in found]
    if facts.scalars:
        measures = found
    else:
        measures_own = PLAYER_MEASURES[0].name
        rows = data.dictionary[data.dictionary["table"] == "episodes"]
        names = list(rows["column"])
        begin, end = names.index("log_folder") + 1, names.index(measures_own)
        measures_told = {row.column: row for row in rows.itertuples()}
        of_game = [
            Measure(
                name,
                measures_told[name].description.partition(":")[0],
                unit=measures_told[name].unit,
                digits=2,
            )
            for name in names[begin:end]
            if measures_told[name].type in ("number", "integer")
            and not name.startswith(("option_", "person_"))
        ]
        measures = [*of_game, *found]
    title = f"{', '.join(map(str, episodes['user'].unique()))} in {facts.name}"
    grids = [grid for grid in facts.grids if f"{grid.name}_0" in episodes]
    persons = episodes["person"].notna().all()
    unit = "person" if persons else "user"
    return ReportSource(root, title, groups, facts, measures, grids, unit=unit)


def _of_study(root: Path) -> ReportSource:
    study = read_study(root)
    episodes, events = study.episodes, study.events
    unit_column = factor_column(study.study.unit_factor or "")
    # Levels of the unit factor, such as seeds of trainings, are repetitions of the same thing.
    factors = [c for c in study.cells if c.startswith("factor_") and c != unit_column]
    shown = [name for name in factors if study.cells[name].nunique() > 1] or factors
    cells = study.cells
    labels = [
        ", ".join(level_name(name, row[name]) for name in shown) for _, row in cells.iterrows()
    ]
    about = study.about.get("search")
    if about is None:
        search = None
    else:
        goal = OptimiseConfig.model_validate(about["optimise"])
        search = Search(goal, study.trials, str(about["sampler"]))
    wanted = list(dict.fromkeys(labels)) if search is None else search.shown
    groups = []
    for label in wanted:
        names = [
            cell for cell, other in zip(cells["design_cell"], labels, strict=True) if other == label
        ]
        own = episodes[episodes["design_cell"].isin(names)]
        if not len(own):
            continue
        parts = [
            (study.of_cell(cell), list(own[own["design_cell"] == cell]["episode"]))
            for cell in names
        ]
        user, condition = str(own["user"].iloc[0]), str(own["condition"].iloc[0])
        mine = events[events["design_cell"].isin(names)]
        groups.append(Group(label, user, condition, own, mine, parts))
    facts = facts_of_outside(str(study.about["game"]))
    facts = replace(facts, score=study.about.get("score") or facts.score)
    return ReportSource(
        root,
        study.study.title or study.study.name,
        groups,
        facts,
        [_measure(told) for told in study.about["measures"]],
        [_measure(told) for told in study.about["grids"]],
        comparisons=study.statistics["results"],
        unit=str(study.about["unit"]),
        planned=study.study.model_dump(mode="json", exclude_defaults=True),
        analysed_with=study.statistics.get("versions", {}),
        search=search,
    )


def level_name(column: str, label: Any) -> str:
    """A level's label; where it is a number alone, with its factor: ``weight 0.01``."""
    try:
        float(label)
    except ValueError:
        return str(label)
    return f"{column.removeprefix('factor_')} {label}"


def _measure(told: Mapping[str, Any]) -> Measure:
    grid = told.get("grid")
    made = Measure(**{**told, "grid": None if grid is None else tuple(grid)})
    return replace(made, unit=_unit(made.unit))


def _unit(unit: str) -> str:
    """Return the unit for people: a range of numbers is none."""
    return PROPORTION if unit == "0-1" else "" if unit == "0-2" else unit


def changes_of(group: Group) -> list[str]:
    """Return the differences between a group's episodes and the user's training."""
    texts = group.episodes["changes"].dropna().unique()
    return [change for text in texts for change in json.loads(text)]


MOST_GROUPS = 6
"""So many groups are named in a sentence."""


@dataclass(frozen=True)
class Summary:
    """A measure of a group.

    Attributes:
        mean: Over the players, each counts with the mean of its rounds.
        spread: Standard deviation (ddof 1): over the players; of a single player, over its rounds.
        n: Players with the number.
        rounds: Rounds with the number.
    """

    mean: float
    spread: float | None
    n: int
    rounds: int


def summary_of(group: Group, measure: str) -> Summary | None:
    """Return a measure's mean over the players of a group; None where no round has it."""
    by_unit: dict[str, list[float]] = {}
    for unit, value in zip(group.units, group.values(measure), strict=True):
        if value is not None:
            by_unit.setdefault(unit, []).append(value)
    if not by_unit:
        return None
    means = [float(np.mean(values)) for values in by_unit.values()]
    rounds = [value for values in by_unit.values() for value in values]
    over = means if len(means) > 1 else rounds
    spread = float(np.std(over, ddof=1)) if len(over) > 1 else None
    return Summary(float(np.mean(means)), spread, len(means), len(rounds))


def known(values: Sequence[float | None]) -> list[float]:
    """The values that there are."""
    return [value for value in values if value is not None and math.isfinite(value)]


def in_words(value: float, measure: Measure) -> str:
    """A number with its unit, as many digits as the game publishes."""
    unit = f" {measure.unit}" if measure.unit and measure.unit != PROPORTION else ""
    return f"{value:,.{measure.digits}f}{unit}"


def with_spread(found: Summary | None, measure: Measure, units: int | None = None) -> str:
    """``12.3 ± 1.2 (n = 5 of 8)``; a dash without a number.

    Args:
        found: The number.
        units: How many players there are; None: n is not written.
    """
    if found is None:
        return "–"
    text = f"{found.mean:,.{measure.digits}f}"
    text = text if found.spread is None else f"{text} ± {found.spread:,.{measure.digits}f}"
    return text if units is None else f"{text} (n = {of_units(found.n, units)})"


def of_units(n: int, units: int) -> str:
    """``8``, or ``5 of 8`` where some have no value."""
    return str(n) if n == units else f"{n} of {units}"


def some_of(told: Sequence[str]) -> str:
    """Join words on groups; of many only the first ones."""
    more = len(told) - MOST_GROUPS
    return "; ".join([*told[:MOST_GROUPS], *([f"and {more} more below"] if more > 0 else [])])
