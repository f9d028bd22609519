"""From episodes to one value per unit: the person, or the training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sim2vr_harness.studies.config import StudyConfig
from sim2vr_harness.studies.data import StudyData, factor_column

VALUE = "value"
LEVEL = "level"


def other_factors(study: StudyConfig, factor: str) -> list[str]:
    """Return the factors beside one, units left out."""
    return [name for name in study.factors if name not in (factor, study.unit_factor)]


def independent(study: StudyConfig, factor: str, levels: Sequence[str]) -> bool:
    """Whether units of one of these levels have nothing to do with those of another.

    Users are other users, and trainings of two kinds other trainings, also where their seeds have
    the same number; unless persons are the units, who play with whatever was trained. Levels that
    one user plays are that user's.
    """
    if study.people is not None:
        return False
    players = []
    for level in levels:
        settings = study.factors[factor].settings(level)
        players.append({key: value for key, value in settings.items() if _decides_who(key)})
    return any(player != players[0] for player in players)


def _decides_who(key: str) -> bool:
    return key in ("user", "config") or key.startswith("training.")


def rows_of(data: StudyData, where: Mapping[str, str]) -> Any:
    """Return the episodes of chosen levels, with those whose app failed left out."""
    episodes = data.episodes
    episodes = episodes[episodes["ended"] != "app_failed"]
    for name, label in where.items():
        episodes = episodes[episodes[factor_column(name)] == label]
    return episodes


def strata(data: StudyData, names: Sequence[str], where: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the combinations of levels that a comparison is made in, in the study's order."""
    found: list[dict[str, str]] = []
    cells = data.cells
    for _, cell in cells.iterrows():
        if any(cell[factor_column(name)] != label for name, label in where.items()):
            continue
        chosen = {name: str(cell[factor_column(name)]) for name in names if name not in where}
        if chosen not in found:
            found.append(chosen)
    return found


def unit_table(episodes: Any, factor: str, measure: str, *, by_round: bool) -> Any:
    """Return the mean of a measure per unit and level: a row per unit, a column per level.

    Args:
        episodes: Rows of the table.
        factor: Whose levels are the columns.
        measure: Whose values.
        by_round: Rounds of the same seed are the units.
    """
    unit = "seed" if by_round else "unit"
    known = episodes.dropna(subset=[measure])
    return known.pivot_table(
        index=unit, columns=factor_column(factor), values=measure, aggfunc="mean"
    )
