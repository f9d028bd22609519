"""Players of a study: cells joined where only the game's condition differs."""

from pathlib import Path

from sim2vr_harness.studies.data import StudyData, factor_column


def players_of(data: StudyData) -> dict[str, list[Path]]:
    """Name -> folders of a player's cells, in the order of the study.

    A player is a combination of levels of all factors but those that set the game's condition;
    named by these levels.
    """
    factors = data.study.factors
    who = [name for name, factor in factors.items() if factor.keys != {"condition"}]
    found: dict[str, list[Path]] = {}
    for _, row in data.cells.iterrows():
        levels = [str(row[factor_column(name)]) for name in who]
        found.setdefault(", ".join(levels) or data.study.name, []).append(data.root / row["folder"])
    return found
