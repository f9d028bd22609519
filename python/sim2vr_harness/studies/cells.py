"""The cells of a study: a level of every factor each, what it sets, and its content's hash."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

from sim2vr_harness.studies.config import StudyConfig

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
