"""From episodes to one value per unit: the person, or the training."""

from collections.abc import Mapping, Sequence
from typing import Any

from sim2vr_harness.studies.config import StudyConfig
from sim2vr_harness.studies.data import StudyData, factor_column

_MOST_NAMED = 6
_BLOCK = 9
"""Movements of a block of aimed movements, which throughput is worked out from."""
_NEEDS = {
    "throughput_bps": "a block in which two targets or more are selected one after the other",
    "endpoint_spread_m": "a block in which two targets or more are selected one after the other",
    "effective_index_bits": "a block in which two targets or more are selected one after the other",
    "movement_time_s": "two targets that are selected one after the other",
    "index_of_difficulty_bits": "two targets that are selected one after the other",
}
"""Measure -> what a round must have in it, for measures that not every round has."""
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
        players.append(
            {
                key: value
                for key, value in settings.items()
                if (key in ("user", "config") or key.startswith("training."))
            }
        )
    return any(player != players[0] for player in players)


def rows_of(data: StudyData, where: Mapping[str, str]) -> Any:
    """Return the episodes of chosen levels, with those whose app failed left out."""
    episodes = with_failed(data, where)
    return episodes[episodes["ended"] != "app_failed"]


def with_failed(data: StudyData, where: Mapping[str, str]) -> Any:
    """Return all episodes of chosen levels, which is everyone who was to have a value."""
    episodes = data.episodes
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


def some_units(units: Sequence[str]) -> str:
    """Name units; of many the first ones."""
    more = len(units) - _MOST_NAMED
    return ", ".join([*units[:_MOST_NAMED], *([f"and {more} more"] if more > 0 else [])])


def missing_notes(episodes: Any, measure: str) -> list[str]:
    """Say who has no value of a measure and why, and whose value rests on little.

    Args:
        episodes: Rows of one condition, with ``unit``; several conditions count together.
        measure: A column, or the name of one that is not there.
    """
    if measure not in episodes:
        return []
    known = episodes.dropna(subset=[measure])
    units = list(dict.fromkeys(map(str, episodes["unit"])))
    present = set(map(str, known["unit"]))
    missing = [unit for unit in units if unit not in present]
    notes = []
    if missing:
        own = episodes[episodes["unit"].astype(str).isin(missing)]
        why = own[own["excluded"].fillna("") != ""] if "excluded" in own else own[:0]
        if len(why):
            reasons = list(why.groupby("unit", sort=False)["excluded"].first().items())
            # Notes are joined by semicolons.
            told = [f"{unit}: {reason.replace('; ', ', ')}" for unit, reason in reasons]
            return [
                f"{len(reasons)} of {len(units)} can do no step and are excluded "
                f"({some_units(told)})"
            ]
        text = (
            f"{len(missing)} of {len(units)} have no {measure} ({some_units(missing)}): none of "
            f"their {len(own)} rounds has {_NEEDS.get(measure, 'a value')}"
        )
        failed = int((own["ended"] == "app_failed").sum()) if "ended" in own else 0
        if failed:
            text += f", and in {failed} of them the app failed"
        if "hit_rate" in episodes and own["hit_rate"].notna().any() and len(known):
            theirs, others = own["hit_rate"].mean(), known["hit_rate"].mean()
            text += (
                f"; they hit {100 * theirs:.0f} % of the targets, the others {100 * others:.0f} %"
            )
        notes.append(text)
    if measure == "throughput_bps" and {"hits", "errors"} <= set(known):
        selections = known.assign(n=known["hits"] + known["errors"]).groupby("unit")["n"].sum()
        few = [str(unit) for unit, n in selections.items() if n < 2 * _BLOCK]
        if few:
            notes.append(
                f"throughput of {len(few)} of {len(units)} comes from one block of {_BLOCK} "
                f"movements or less ({some_units(few)}), which is too few for its end points' "
                "standard deviation: play more episodes"
            )
    return notes
