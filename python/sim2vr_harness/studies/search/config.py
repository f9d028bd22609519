"""Configuration of a search: parameters, objectives and stopping rules."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from sim2vr_harness.base.errors import shown, unknown_name
from sim2vr_harness.base.settings import MOST_STEPS, Settings
from sim2vr_harness.studies.factors import FactorConfig, Name, check_key, value_error

_STEPS = 100
"""Of a range without a step of its own: at least so many, of a round length."""
_DIGITS = 3
"""Of values on a logarithmic scale."""
Value = bool | int | float | str
Limit = Annotated[float, Field(ge=-1e12, le=1e12)]


class ParameterConfig(Settings):
    """Something that a search chooses: a number of a range, or one of several levels."""

    key: str | None = None
    """What it sets, as a factor's: user, condition, env.KEY, training.KEY ... None: each level is a
    mapping of such keys."""
    low: float | None = None
    high: float | None = None
    """The range, both ends included."""
    step: float | None = Field(default=None, gt=0.0)
    """Between two numbers; None: some hundredth of the range, 1 of whole ones."""
    whole: bool = False
    """Whether only whole numbers make sense."""
    log: bool = False
    """Whether to search on a logarithmic scale, such as for learning rates."""
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
        """What levels it has; of a parameter with levels."""
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
        """What it sets for a value, a label of a parameter with levels."""
        if self.levels is not None:
            return self.factor.settings(str(value))
        return {str(self.key): self.rounded(float(value))}

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
    """What a trial has to keep to be chosen."""

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
    """When trainings that learn little are stopped: the ones behind most of the earlier trials."""

    report: str
    """A number of the training's reports, a column of metrics.jsonl such as rollout/return."""
    at: tuple[Annotated[int, Field(ge=1, le=MOST_STEPS)], ...]
    """User steps of the training's last stage at which it is judged."""
    better: Literal["higher", "lower"] = "higher"
    keep: float = Field(default=0.5, gt=0.0, lt=1.0)
    """The share of the earlier trials that it has to be among."""
    earlier: int = Field(default=4, ge=1, le=1000)
    """How many trials must have come so far before any is stopped there."""

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
        """What parameters of these values set, by key."""
        found: dict[str, Any] = {}
        for name, parameter in self.parameters.items():
            found |= parameter.settings(values[name])
        return found
