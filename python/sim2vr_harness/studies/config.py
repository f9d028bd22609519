"""Configuration of a study, read from its YAML file: factors, a search, comparisons."""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field, field_validator, model_validator

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.settings import MOST_STEPS, Settings, first_problem

CELL_KEYS = ("user", "adapt", "config", "condition", "deterministic")
"""Keys that a level may set beside dotted keys: the trained user, the user steps of further
training in the environment of the cell, the configuration of a training, the game's condition, and
whether actions are the policy's mean."""
PREFIXES = ("env.", "training.")
"""Dotted keys: of the environment that is played in, and of the training's configuration."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z][\w-]{0,63}$")]
"""Of a study, a factor, a parameter."""
_MOST_LEVELS = 1000


class FactorConfig(Settings):
    """Something that a study varies."""

    key: str | None = None
    """Key that the levels set: user, adapt, config, condition, deterministic, env.KEY or
    training.KEY. None: each level is a mapping of such keys."""
    levels: dict[str, Any]
    """Label -> value. A list is taken for values that are their own labels."""
    unit: bool = False
    """True if the levels are the study's sample, such as seeds of trainings: n counts them. A
    factor of training.seed always is."""

    @field_validator("levels", mode="before")
    @classmethod
    def _list_of_values(cls, levels: Any) -> Any:
        if isinstance(levels, list):
            labels = [cls.label(value) for value in levels]
            for label, count in Counter(labels).items():
                if count > 1:
                    raise ValueError(f"got {label!r} twice, expected every level once")
            return dict(zip(labels, levels, strict=True))
        return levels

    @model_validator(mode="after")
    def _usable(self) -> FactorConfig:
        if not self.levels:
            raise ValueError("levels: got none, expected at least one")
        if len(self.levels) > _MOST_LEVELS:
            raise ValueError(f"levels: got {len(self.levels)}, expected at most {_MOST_LEVELS}")
        if self.key is not None:
            check_key(self.key, "key")
            return self
        for label, value in self.levels.items():
            if not isinstance(value, dict) or not value:
                raise ValueError(
                    f"levels.{label}: got {shown(value, 40)}, expected a mapping of keys to "
                    "values, or a key for the whole factor"
                )
            for key in value:
                check_key(key, f"levels.{label}")
        return self

    @staticmethod
    def label(value: Any) -> str:
        """Return the label of a value that has no label of its own."""
        return value if isinstance(value, str) else json.dumps(value)

    def settings(self, label: str) -> dict[str, Any]:
        """Return the settings of a level, by key."""
        value = self.levels[label]
        return dict(value) if self.key is None else {self.key: value}

    @property
    def keys(self) -> set[str]:
        """Everything that some level sets."""
        return {key for label in self.levels for key in self.settings(label)}

    @property
    def is_unit(self) -> bool:
        """True if the levels are the study's sample."""
        return self.unit or self.keys == {"training.seed"}


def value_error(error: InputError) -> ValueError:
    """Return a ValueError that pydantic reports with the same sentence."""
    return ValueError(f"{error.field}: got {error.got}, expected {error.expected}")


def check_key(key: str, field: str) -> None:
    """Refuse what no level can set.

    Raises:
        ValueError: Names the nearest key.
    """
    if key not in CELL_KEYS and not key.startswith(PREFIXES):
        raise value_error(unknown_name(field, key, [*CELL_KEYS, "env.KEY", "training.KEY"]))


def check_key_once(field: str, keys: set[str], seen: dict[str, str]) -> None:
    """Refuse a key that something else sets, too; note these as set by ``field``.

    Args:
        field: What sets them.
        seen: Key -> what sets it.

    Raises:
        ValueError: One of them is in ``seen``.
    """
    for key in sorted(keys):
        if key in seen:
            raise ValueError(
                f"{field}: got {key}, which {seen[key]} sets as well, expected every key in one "
                "place"
            )
        seen[key] = field


# --- searches --------------------------------------------------------------------------------

_STEPS = 100
"""Of a range without a step of its own: at least so many, of a round length."""
_DIGITS = 3
"""Of values on a logarithmic scale."""
Value = bool | int | float | str
Limit = Annotated[float, Field(ge=-1e12, le=1e12)]


class ParameterConfig(Settings):
    """Something that a search chooses: a number of a range, or one of several levels."""

    key: str | None = None
    """Key that it sets, as of a factor: user, condition, env.KEY, training.KEY ... None: each level
    is a mapping of such keys."""
    low: float | None = None
    high: float | None = None
    """The range, both ends included."""
    step: float | None = Field(default=None, gt=0.0)
    """Between two numbers; None: some hundredth of the range, 1 of whole ones."""
    whole: bool = False
    """True if only integers are allowed."""
    log: bool = False
    """True for a search on a logarithmic scale, such as for learning rates."""
    levels: dict[str, Any] | list[Any] | None = None
    """Instead of a range, as of a factor: values, or label -> value."""

    @model_validator(mode="after")
    def _usable(self) -> ParameterConfig:
        ranged = self.low is not None or self.high is not None
        if ranged == (self.levels is not None):
            got = "both a range and levels" if ranged else "neither a range nor levels"
            raise ValueError(f"{got}, expected low and high, or levels")
        if not ranged:
            if len(self.factor.levels) < 2:
                raise ValueError("levels: got 1, expected two or more: nothing is chosen otherwise")
            return self
        if self.key is None:
            raise ValueError("key: got none, expected what the numbers set, such as env.KEY")
        check_key(self.key, "key")
        if self.low is None or self.high is None:
            raise ValueError("got one end of a range, expected low and high")
        if not self.low < self.high:
            raise ValueError(
                f"got an empty range, low {self.low:g} and high {self.high:g}, expected low below "
                "high"
            )
        if self.step is not None and self.step > self.high - self.low:
            raise ValueError(f"step: got {self.step:g}, expected one that fits into the range")
        if self.whole and not (self.low.is_integer() and self.high.is_integer()):
            raise ValueError(f"got {self.low:g} to {self.high:g}, expected whole numbers")
        if self.log and (self.low <= 0.0 or self.step is not None):
            raise ValueError("log: got true, expected low above 0, and no step")
        return self

    @property
    def factor(self) -> FactorConfig:
        """Levels of a parameter with levels, as a factor."""
        return FactorConfig.model_validate({"key": self.key, "levels": self.levels})

    @property
    def keys(self) -> set[str]:
        """Everything that it sets."""
        return self.factor.keys if self.levels is not None else {str(self.key)}

    @property
    def ends(self) -> list[str] | list[float]:
        """All labels, or both ends of the range."""
        if self.levels is not None:
            return list(self.factor.levels)
        assert self.low is not None and self.high is not None
        return [self.low, self.high]

    @property
    def spacing(self) -> float:
        """Between two numbers of a range that is not logarithmic: 1, 2 or 5 times a power of 10."""
        if self.step is not None:
            return self.step
        assert self.low is not None and self.high is not None
        if self.whole:
            return 1.0
        power: float = 10.0 ** math.floor(math.log10((self.high - self.low) / _STEPS))
        return max(
            size for size in (power, 2 * power, 5 * power) if _STEPS * size <= self.high - self.low
        )

    def settings(self, value: Value) -> dict[str, Any]:
        """Return the settings for a value; of a parameter with levels, the value is a label."""
        if self.levels is not None:
            return self.factor.settings(str(value))
        return {str(self.key): value}

    def rounded(self, value: float) -> int | float:
        """A number of a range as it is played and written: without digits that mean nothing."""
        if self.whole:
            return round(value)
        if self.log:
            return float(f"{value:.{_DIGITS}g}")
        # A dozen digits hide what binary fractions add to decimal ones.
        return float(f"{value:.12g}")

    def check(self, field: str, value: Any) -> Value:
        """Return a value that someone wrote, if it is one of this parameter's.

        Raises:
            ValueError: It is not.
        """
        if self.levels is not None:
            labels = self.factor.levels
            label = value if isinstance(value, str) else FactorConfig.label(value)
            if label not in labels:
                raise value_error(unknown_name(field, label, labels))
            return label
        assert self.low is not None and self.high is not None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f"{field}: got {shown(value, 40)}, expected a number")
        if not self.low <= value <= self.high:
            raise ValueError(f"{field}: got {value:g}, expected {self.low:g} to {self.high:g}")
        return value


class ConstraintConfig(Settings):
    """Limits that a trial has to keep to be selected."""

    least: Limit | None = None
    most: Limit | None = None

    @model_validator(mode="after")
    def _usable(self) -> ConstraintConfig:
        if self.least is None and self.most is None:
            raise ValueError("got no limit, expected least or most")
        if self.least is not None and self.most is not None and self.least > self.most:
            raise ValueError(
                f"got least {self.least:g} and most {self.most:g}, which nothing can keep, "
                "expected least below most"
            )
        return self

    def violations(self, value: float) -> list[float]:
        """By how much a value is beyond each limit; 0 or less: it keeps it."""
        found = [] if self.least is None else [self.least - value]
        return found if self.most is None else [*found, value - self.most]

    def words(self, name: str) -> str:
        """``hit_rate >= 0.8``."""
        low = "" if self.least is None else f"{name} >= {self.least:g}"
        high = "" if self.most is None else f"{name} <= {self.most:g}"
        return " and ".join(text for text in (low, high) if text)


class StopConfig(Settings):
    """Rule for early stopping: a training stops if it is not among the best earlier trials."""

    report: str
    """A number of the training's reports, a column of metrics.jsonl such as rollout/return."""
    at: tuple[Annotated[int, Field(ge=1, le=MOST_STEPS)], ...]
    """User steps of the training's last stage at which it is judged."""
    better: Literal["higher", "lower"] = "higher"
    keep: float = Field(default=0.5, gt=0.0, lt=1.0)
    """Proportion of best earlier trials: a training that is worse than these stops."""
    earlier: int = Field(default=4, ge=1, le=1000)
    """Number of earlier trials with a report at a step before any training is stopped there."""

    @model_validator(mode="after")
    def _usable(self) -> StopConfig:
        if not self.at or list(self.at) != sorted(set(self.at)) or self.at[0] < 1:
            raise ValueError(
                f"at: got {list(self.at)}, expected one or more numbers of user steps, ascending"
            )
        return self


class OptimiseConfig(Settings):
    """A search for the best parameters."""

    parameters: dict[Name, ParameterConfig]
    objectives: dict[str, Literal["min", "max"]]
    """Measure -> which way is better. Of several the search looks for the best compromises."""
    constraints: dict[str, ConstraintConfig] = Field(default_factory=dict)
    """Measure -> its limits."""
    trials: int = Field(default=40, ge=1, le=1000)
    at_once: int = Field(default=4, ge=1, le=100)
    """Trials that are chosen together, from the results of earlier ones, and may be played at the
    same time. The number of jobs and machines is separate: the result does not depend on it."""
    sampler: Literal["tpe", "gp", "nsga2", "random"] = "tpe"
    """Optuna's: Tree-structured Parzen Estimator; Gaussian processes; NSGA-II; chance."""
    begin: tuple[dict[str, Any], ...] = ()
    """The first trials: parameter -> value, such as what is used today."""
    stop: StopConfig | None = None

    @model_validator(mode="after")
    def _usable(self) -> OptimiseConfig:
        if not self.parameters:
            raise ValueError("parameters: got none, expected at least one")
        if not 1 <= len(self.objectives) <= 4:
            raise ValueError(f"objectives: got {len(self.objectives)}, expected 1 to 4")
        if self.stop is not None and len(self.objectives) > 1:
            raise ValueError("stop: got it with several objectives, expected one")
        if len(self.begin) > self.trials:
            raise ValueError(f"begin: got {len(self.begin)}, expected at most {self.trials} trials")
        for i, values in enumerate(self.begin):
            for name, value in values.items():
                if name not in self.parameters:
                    raise value_error(unknown_name(f"begin.{i}", name, self.parameters))
                self.parameters[name].check(f"begin.{i}.{name}", value)
        return self

    @property
    def measures(self) -> tuple[str, ...]:
        """Of objectives and constraints, each once."""
        return tuple(dict.fromkeys([*self.objectives, *self.constraints]))

    def settings(self, values: Mapping[str, Value]) -> dict[str, Any]:
        """Return the settings for these values of the parameters, by key."""
        found: dict[str, Any] = {}
        for name, value in self.values(values).items():
            found |= self.parameters[name].settings(value)
        return found

    def values(self, chosen: Mapping[str, Value]) -> dict[str, Value]:
        """Parameters as they are played and written."""
        return {
            name: chosen[name] if parameter.levels else parameter.rounded(float(chosen[name]))
            for name, parameter in self.parameters.items()
        }


# --- the study -------------------------------------------------------------------------------

_EXPECTED = "a study in YAML, a mapping of keys to values"
_MOST_CELLS = 10_000
"""A study checks every cell before it plays any: more of them take hours and gigabytes."""


class ComparisonConfig(Settings):
    """A question to the numbers."""

    factor: str
    """Factor whose levels are compared."""
    levels: tuple[str, ...] | None = None
    """Levels to compare, in this order; None: all."""
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
    """Unit that n counts. auto: participants, or the levels of the unit factor; ``round`` compares
    rounds of one policy, as papers have done, and the report says so beside each such number."""


class StudyConfig(Settings):
    """A study: what is varied, who plays how often, what is measured and compared."""

    name: Name
    title: str = ""
    """For people, such as the question that it answers."""
    fixed: dict[str, Any] = Field(default_factory=dict)
    """Settings that are the same in all cells, by the keys of factors."""
    factors: dict[Name, FactorConfig] = Field(default_factory=dict)
    optimise: OptimiseConfig | None = None
    """Search over parameters instead of factors; each trial is a cell."""
    cells: tuple[dict[str, str], ...] | None = None
    """The cells, each a level of every factor; None: all combinations."""
    episodes: int = Field(default=10, ge=1, le=100_000)
    """Rounds per cell and participant."""
    people: int | None = Field(default=None, ge=1, le=10_000)
    """Number of participants who play each cell; None: the user's own population."""
    seed: int = Field(default=1, ge=0, le=2**31 - 1)
    seeds: Literal["paired", "own"] = "paired"
    """paired: round k has the same seed in every cell, and participant k is the same; own: not."""
    deterministic: bool | None = None
    """True: actions are the policy's mean; False: they are sampled; None: as each user's own
    ``evaluation.deterministic`` says."""
    measures: tuple[str, ...] | None = None
    """Measures to summarise and compare; None: all measures that the game and every user have."""
    comparisons: tuple[ComparisonConfig, ...] = ()
    steps: bool = True
    """True if the tables of user steps and frames are kept."""
    logs: bool = False
    """True if the game's own logs are kept."""
    film_seconds: float = Field(default=0.0, ge=0.0, le=600.0)
    """Length of the video of each cell's first round, s; 0: no video."""

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


_SEEDS = 2**30


@dataclass(frozen=True)
class Cell:
    """One combination of levels.

    Attributes:
        name: ``difficulty=easy,life=0.5``: the key ``design_cell`` of a study's tables.
        levels: factor -> label.
        settings: Everything that it sets, ``fixed`` included, by key.
        seed: Of its first round, and of its people.
    """

    name: str
    levels: Mapping[str, str]
    settings: Mapping[str, Any]
    seed: int

    def of(self, prefix: str) -> list[str]:
        """Its dotted keys of one kind as ``key=value`` of a command line, without the prefix.

        Those of the environment keep ``env.``, as configurations have it.
        """
        cut = "" if prefix == "env." else prefix
        return [
            f"{key.removeprefix(cut)}={json.dumps(value, ensure_ascii=False)}"
            for key, value in sorted(self.settings.items())
            if key.startswith(prefix)
        ]


def cells_of(study: StudyConfig) -> list[Cell]:
    """Return the cells in the order of the study's file; the last factor changes fastest."""
    if study.cells is not None:
        chosen = [{name: cell[name] for name in study.factors} for cell in study.cells]
    else:
        names = list(study.factors)
        every = product(*(study.factors[name].levels for name in names))
        chosen = [dict(zip(names, labels, strict=True)) for labels in every]
    return [_cell(study, levels) for levels in chosen]


def _cell(study: StudyConfig, levels: Mapping[str, str]) -> Cell:
    name = ",".join(f"{factor}={label}" for factor, label in levels.items())
    settings = dict(study.fixed)
    for factor, label in levels.items():
        settings |= study.factors[factor].settings(label)
    seed = study.seed
    if study.seeds == "own":
        digest = hashlib.sha256(f"{study.seed} {name}".encode()).digest()
        seed = int.from_bytes(digest[:4], "big") % _SEEDS
    return Cell(name, levels, settings, seed)


def content_hash(content: Mapping[str, Any]) -> str:
    """Return 20 hexadecimal digits of what plain values are, in whatever order."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:20]
