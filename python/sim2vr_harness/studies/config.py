"""What a study is made of, as its YAML file says it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field, field_validator, model_validator

from sim2vr_harness.errors import InputError, shown, unknown_name
from sim2vr_harness.files import file_name, read_yaml
from sim2vr_harness.settings import Settings, first_problem

__all__ = [
    "CELL_KEYS",
    "PREFIXES",
    "ComparisonConfig",
    "FactorConfig",
    "StudyConfig",
    "load_study",
    "parse_study",
]

CELL_KEYS = ("user", "config", "condition", "deterministic")
"""What a level may set beside dotted keys: the trained user, the configuration of a training, the
game's condition, whether actions are the policy's mean."""
PREFIXES = ("env.", "training.")
"""Dotted keys: of the environment that is played in, and of the training's configuration."""
_EXPECTED = "a study in YAML, a mapping of keys to values"
_Name = Annotated[str, Field(pattern=r"^[A-Za-z][\w-]{0,63}$")]
_MOST_LEVELS = 1000


class FactorConfig(Settings):
    """Something that a study varies."""

    key: str | None = None
    """What its levels set: user, config, condition, deterministic, env.KEY or training.KEY. None:
    each level says itself, as a mapping of such keys."""
    levels: dict[str, Any]
    """Label -> value. A list is taken for values that are their own labels."""
    unit: bool = False
    """Whether its levels are what the study samples from, such as seeds of trainings: n counts
    them. A factor of training.seed always is."""

    @field_validator("levels", mode="before")
    @classmethod
    def _list_of_values(cls, levels: Any) -> Any:
        if isinstance(levels, list):
            labels = [_label(value) for value in levels]
            twice = [label for label in labels if labels.count(label) > 1]
            if twice:
                raise ValueError(f"got {twice[0]!r} twice, expected every level once")
            return dict(zip(labels, levels, strict=True))
        return levels

    @model_validator(mode="after")
    def _usable(self) -> FactorConfig:
        if not self.levels:
            raise ValueError("levels: got none, expected at least one")
        if len(self.levels) > _MOST_LEVELS:
            raise ValueError(f"levels: got {len(self.levels)}, expected at most {_MOST_LEVELS}")
        if self.key is not None:
            _check_key(self.key, "key")
            return self
        for label, value in self.levels.items():
            if not isinstance(value, dict) or not value:
                raise ValueError(
                    f"levels.{label}: got {shown(value, 40)}, expected a mapping of keys to "
                    "values, or a key for the whole factor"
                )
            for key in value:
                _check_key(key, f"levels.{label}")
        return self

    def settings(self, label: str) -> dict[str, Any]:
        """What a level sets, by key."""
        value = self.levels[label]
        return dict(value) if self.key is None else {self.key: value}

    @property
    def keys(self) -> set[str]:
        """Everything that some level sets."""
        return {key for label in self.levels for key in self.settings(label)}

    @property
    def is_unit(self) -> bool:
        """Whether its levels are what the study samples from."""
        return self.unit or self.keys == {"training.seed"}


class ComparisonConfig(Settings):
    """A question to the numbers."""

    factor: str
    """Whose levels are compared."""
    levels: tuple[str, ...] | None = None
    """Which, in this order; None: all."""
    measures: tuple[str, ...] | None = None
    """None: those of the study."""
    by: tuple[str, ...] | None = None
    """Factors in each of whose levels the comparison is made anew; None: all others but units."""
    where: dict[str, str] = Field(default_factory=dict)
    """Other factors -> the one level that is looked at."""
    test: Literal["auto", "wilcoxon", "friedman", "mixed"] = "auto"
    """auto: Wilcoxon's signed-rank test for two levels, Friedman's for more, with all pairs."""
    alternative: Literal["two-sided", "less", "greater"] = "two-sided"
    """Of pairs: the first level is less, or greater, than the second."""
    unit: Literal["auto", "round"] = "auto"
    """What n counts. auto: persons, or the levels of the unit factor; ``round`` compares rounds of
    one policy, as papers have done, and says so wherever the number appears."""


class StudyConfig(Settings):
    """A study: what is varied, who plays how often, what is measured and compared."""

    name: _Name
    title: str = ""
    """For people, such as the question that it answers."""
    fixed: dict[str, Any] = Field(default_factory=dict)
    """What is the same in all cells, by the keys of factors."""
    factors: dict[_Name, FactorConfig]
    cells: tuple[dict[str, str], ...] | None = None
    """The cells, each a level of every factor; None: all combinations."""
    episodes: int = Field(default=10, ge=1, le=100_000)
    """Rounds per cell, and person."""
    people: int | None = Field(default=None, ge=1, le=10_000)
    """How many persons play each cell; None: whoever the user is."""
    seed: int = Field(default=1, ge=0, le=2**31 - 1)
    seeds: Literal["paired", "own"] = "paired"
    """paired: round k has the same seed in every cell, and person k is the same; own: not so."""
    deterministic: bool = False
    """Whether actions are the policy's mean instead of samples."""
    measures: tuple[str, ...] | None = None
    """Which to summarise and compare; None: all that the game and every player have."""
    comparisons: tuple[ComparisonConfig, ...] = ()
    steps: bool = True
    """Whether to keep tables of user steps and frames."""
    logs: bool = False
    """Whether to keep the game's own logs."""
    film_seconds: float = Field(default=0.0, ge=0.0, le=600.0)
    """How much of the first round of every cell is filmed; 0: nothing."""

    @model_validator(mode="after")
    def _usable(self) -> StudyConfig:
        if not self.factors:
            raise ValueError("factors: got none, expected at least one")
        for key in self.fixed:
            _check_key(key, "fixed")
        seen: dict[str, str] = dict.fromkeys(self.fixed, "fixed")
        for name, factor in self.factors.items():
            for key in sorted(factor.keys):
                if key in seen:
                    raise ValueError(
                        f"factors.{name}: got {key}, which {seen[key]} sets as well, expected "
                        "every key in one place"
                    )
                seen[key] = f"factors.{name}"
        units = [name for name, factor in self.factors.items() if factor.is_unit]
        if len(units) > 1:
            raise ValueError(f"factors: got units {', '.join(units)}, expected at most one")
        self._check_cells()
        for i, comparison in enumerate(self.comparisons):
            self._check_comparison(f"comparisons.{i}", comparison)
        return self

    def _check_cells(self) -> None:
        for i, cell in enumerate(self.cells or ()):
            for name, label in cell.items():
                self._check_level(f"cells.{i}", name, label)
            missing = [name for name in self.factors if name not in cell]
            if missing:
                raise ValueError(f"cells.{i}: got no {missing[0]}, expected a level of it")
        if self.cells is not None and not self.cells:
            raise ValueError("cells: got none, expected at least one, or no such key")
        if self.cells and len({json.dumps(cell, sort_keys=True) for cell in self.cells}) < len(
            self.cells
        ):
            raise ValueError("cells: got one twice, expected every cell once")

    def _check_comparison(self, field: str, comparison: ComparisonConfig) -> None:
        for name in (comparison.factor, *(comparison.by or ()), *comparison.where):
            if name not in self.factors:
                raise _value_error(unknown_name(f"{field}", name, self.factors))
        for label in comparison.levels or ():
            self._check_level(field, comparison.factor, label)
        for name, label in comparison.where.items():
            self._check_level(f"{field}.where", name, label)
        count = len(comparison.levels or self.factors[comparison.factor].levels)
        if count < 2 or (comparison.test == "wilcoxon" and comparison.levels and count != 2):
            raise ValueError(f"{field}.levels: got {count}, expected two, or more for friedman")

    def _check_level(self, field: str, name: str, label: str) -> None:
        if name not in self.factors:
            raise _value_error(unknown_name(field, name, self.factors))
        if label not in self.factors[name].levels:
            raise _value_error(unknown_name(f"{field}.{name}", label, self.factors[name].levels))

    @property
    def unit_factor(self) -> str | None:
        """The factor whose levels the study samples from."""
        return next((name for name, factor in self.factors.items() if factor.is_unit), None)


def _value_error(error: InputError) -> ValueError:
    return ValueError(f"{error.field}: got {error.got}, expected {error.expected}")


def _check_key(key: str, field: str) -> None:
    if key not in CELL_KEYS and not key.startswith(PREFIXES):
        raise _value_error(unknown_name(field, key, [*CELL_KEYS, "env.KEY", "training.KEY"]))


def _label(value: Any) -> str:
    if isinstance(value, str):
        return value
    return json.dumps(value)


def load_study(path: str | Path) -> StudyConfig:
    """Read and validate the file of a study.

    Raises:
        InputError: It is missing or not YAML, or a key or value cannot be used.
    """
    file = Path(path)
    tree = read_yaml(file, _EXPECTED)
    if not isinstance(tree, dict):
        raise InputError(file_name(file), f"YAML of {shown(tree, 40)}", _EXPECTED)
    return parse_study(tree)


def parse_study(tree: Mapping[str, Any]) -> StudyConfig:
    """Validate a study given as nested mappings.

    Raises:
        InputError: Names the first key that cannot be used.
    """
    try:
        return StudyConfig.model_validate(tree)
    except pydantic.ValidationError as error:
        raise first_problem(error, StudyConfig) from error
