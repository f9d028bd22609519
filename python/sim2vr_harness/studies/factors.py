"""Factors of a study: keys, and the levels that set them."""

from __future__ import annotations

import json
from collections import Counter
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.settings import Settings

CELL_KEYS = ("user", "adapt", "config", "condition", "deterministic")
"""What a level may set beside dotted keys: the trained user, the user steps for which it goes on in
what the cell plays, the configuration of a training, the game's condition, whether actions are the
policy's mean."""
PREFIXES = ("env.", "training.")
"""Dotted keys: of the environment that is played in, and of the training's configuration."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z][\w-]{0,63}$")]
"""Of a study, a factor, a parameter."""
_MOST_LEVELS = 1000


class FactorConfig(Settings):
    """Something that a study varies."""

    key: str | None = None
    """What its levels set: user, adapt, config, condition, deterministic, env.KEY or training.KEY.
    None: each level says itself, as a mapping of such keys."""
    levels: dict[str, Any]
    """Label -> value. A list is taken for values that are their own labels."""
    unit: bool = False
    """Whether its levels are what the study samples from, such as seeds of trainings: n counts
    them. A factor of training.seed always is."""

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
        """What a value is called that is its own label."""
        return value if isinstance(value, str) else json.dumps(value)

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


def value_error(error: InputError) -> ValueError:
    """What pydantic makes the same sentence of again."""
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
