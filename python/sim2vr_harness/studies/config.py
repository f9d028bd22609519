"""Configuration of a study, read from its YAML file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field, model_validator

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.studies.factors import (
    FactorConfig,
    Name,
    check_key,
    check_key_once,
    value_error,
)
from sim2vr_harness.studies.search.config import OptimiseConfig

_EXPECTED = "a study in YAML, a mapping of keys to values"
_MOST_CELLS = 10_000
"""A study checks every cell before it plays any: more of them take hours and gigabytes."""


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
    equivalence: dict[str, Annotated[float, Field(gt=0.0, le=1e9)]] = Field(default_factory=dict)
    """Measure -> the largest difference that does not matter, in its unit. "No difference" is said
    only where the whole 95 % interval is smaller; any other result that is not significant is
    inconclusive."""
    unit: Literal["auto", "round"] = "auto"
    """What n counts. auto: persons, or the levels of the unit factor; ``round`` compares rounds of
    one policy, as papers have done, and says so wherever the number appears."""


class StudyConfig(Settings):
    """A study: what is varied, who plays how often, what is measured and compared."""

    name: Name
    title: str = ""
    """For people, such as the question that it answers."""
    fixed: dict[str, Any] = Field(default_factory=dict)
    """What is the same in all cells, by the keys of factors."""
    factors: dict[Name, FactorConfig] = Field(default_factory=dict)
    optimise: OptimiseConfig | None = None
    """What is searched for, instead of factors: each trial is a cell."""
    cells: tuple[dict[str, str], ...] | None = None
    """The cells, each a level of every factor; None: all combinations."""
    episodes: int = Field(default=10, ge=1, le=100_000)
    """Rounds per cell, and person."""
    people: int | None = Field(default=None, ge=1, le=10_000)
    """How many persons play each cell; None: the user's own population."""
    seed: int = Field(default=1, ge=0, le=2**31 - 1)
    seeds: Literal["paired", "own"] = "paired"
    """paired: round k has the same seed in every cell, and person k is the same; own: not so."""
    deterministic: bool | None = None
    """Whether actions are the policy's mean instead of samples; None: as each user's own
    ``evaluation.deterministic`` says."""
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
        if not self.factors and self.optimise is None:
            raise ValueError("factors: got none, expected at least one, or optimise")
        for key in self.fixed:
            check_key(key, "fixed")
        seen: dict[str, str] = dict.fromkeys(self.fixed, "fixed")
        for name, factor in self.factors.items():
            check_key_once(f"factors.{name}", factor.keys, seen)
        if self.optimise is not None:
            self._check_search(self.optimise, seen)
        units = [name for name, factor in self.factors.items() if factor.is_unit]
        if len(units) > 1:
            raise ValueError(f"factors: got units {', '.join(units)}, expected at most one")
        self._check_cells()
        for i, comparison in enumerate(self.comparisons):
            field = f"comparisons.{i}"
            for comparison_name in (comparison.factor, *(comparison.by or ()), *comparison.where):
                if comparison_name not in self.factors:
                    raise value_error(unknown_name(f"{field}", comparison_name, self.factors))
            for label in comparison.levels or ():
                self._check_level(field, comparison.factor, label)
            for comparison_name, label in comparison.where.items():
                self._check_level(f"{field}.where", comparison_name, label)
            count = len(comparison.levels or self.factors[comparison.factor].levels)
            if count < 2 or (comparison.test == "wilcoxon" and comparison.levels and count != 2):
                raise ValueError(f"{field}.levels: got {count}, expected two, or more for friedman")
        return self

    def _check_search(self, search: OptimiseConfig, seen: dict[str, str]) -> None:
        """Refuse what a search has no use for: it finds its cells itself."""
        for name in ("factors", "cells", "comparisons"):
            if getattr(self, name):
                raise ValueError(f"{name}: got some, expected none together with optimise")
        for name, parameter in search.parameters.items():
            check_key_once(f"optimise.parameters.{name}", parameter.keys, seen)
        trained = any(key == "adapt" or key.startswith("training.") for key in seen)
        if search.stop is not None and not trained:
            raise ValueError(
                "optimise.stop: got it without a training, expected adapt, or parameters of "
                "training.KEY"
            )

    def _check_cells(self) -> None:
        lengths = [len(factor.levels) for factor in self.factors.values()]
        field, count = "factors", math.prod(lengths)
        got = f"{' x '.join(map(str, lengths))} levels, which are {count:,} cells"
        if self.cells is not None:
            field, count = "cells", len(self.cells)
            got = f"{count:,} cells"
        if count > _MOST_CELLS:
            expected = f"at most {_MOST_CELLS:,} cells; split the study into several"
            raise ValueError(f"{field}: got {got}, expected {expected}")
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

    def _check_level(self, field: str, name: str, label: str) -> None:
        if name not in self.factors:
            raise value_error(unknown_name(field, name, self.factors))
        if label not in self.factors[name].levels:
            raise value_error(unknown_name(f"{field}.{name}", label, self.factors[name].levels))

    @property
    def unit_factor(self) -> str | None:
        """The factor whose levels the study samples from."""
        return next((name for name, factor in self.factors.items() if factor.is_unit), None)


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
