"""Means, deviations and intervals of a study's conditions over its units."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim2vr_harness.statistics.intervals import mean_interval
from sim2vr_harness.studies.comparisons.units import missing_notes, rows_of, strata, with_failed
from sim2vr_harness.studies.data import StudyData


def summaries(data: StudyData, measures: Sequence[str]) -> list[dict[str, Any]]:
    """Return mean, deviation and interval of each measure in each condition.

    A condition is a level of every factor but the unit's. Mean and deviation are over units, each
    with the mean of its rounds; ``rounds_sd`` is over rounds, which says how much one user's rounds
    differ, and nothing of people. ``n`` of ``units`` have a value, and ``notes`` say who has none
    and why.

    Args:
        data: Of the study.
        measures: Names.
    """
    study = data.study
    names = [name for name in study.factors if name != study.unit_factor]
    found = []
    for levels in strata(data, names, {}):
        rows, everyone = rows_of(data, levels), with_failed(data, levels)
        for measure in measures:
            if measure not in rows:
                continue
            known = rows.dropna(subset=[measure])
            units = known.groupby("unit")[measure].mean().to_numpy(float)
            rounds = known[measure].to_numpy(float)
            interval = mean_interval(units)
            found.append(
                {
                    "levels": levels,
                    "measure": measure,
                    "unit": data.about["unit"],
                    "n": len(units),
                    "units": int(everyone["unit"].nunique()),
                    "notes": missing_notes(everyone, measure),
                    "rounds": len(rounds),
                    "mean": float(units.mean()) if len(units) else None,
                    "sd": float(np.std(units, ddof=1)) if len(units) > 1 else None,
                    "low": None if interval is None else interval[0],
                    "high": None if interval is None else interval[1],
                    "rounds_sd": float(np.std(rounds, ddof=1)) if len(rounds) > 1 else None,
                }
            )
    return found
