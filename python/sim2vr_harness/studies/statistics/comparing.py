"""The comparisons that a study asks for, each with what its n is, or why there is no p value."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from sim2vr_harness.statistics import significance
from sim2vr_harness.statistics.mixed_models import mixed_model
from sim2vr_harness.studies.config import ComparisonConfig
from sim2vr_harness.studies.data import StudyData, factor_column
from sim2vr_harness.studies.statistics.units import (
    independent,
    other_factors,
    rows_of,
    strata,
    unit_table,
)

__all__ = ["compare", "compare_all"]

_EFFECTS = {
    "wilcoxon": "matched-pairs rank-biserial correlation",
    "mann-whitney": "rank-biserial correlation",
    "friedman": "Kendall's W",
    "kruskal-wallis": "epsilon squared",
}
_ROUNDS = (
    "n counts rounds of one policy, as in the publication that this is compared with; they are no "
    "sample of persons, and p says nothing of people"
)


def compare_all(data: StudyData, measures: Sequence[str]) -> list[dict[str, Any]]:
    """Return what comes out of all of a study's comparisons.

    Args:
        data: Of the study.
        measures: Those of comparisons that name none.
    """
    found = []
    for number, comparison in enumerate(data.study.comparisons):
        for result in compare(data, comparison, data.study.measures or tuple(measures)):
            found.append({"comparison": number, **result})
    return found


def compare(
    data: StudyData, comparison: ComparisonConfig, measures: Sequence[str]
) -> list[dict[str, Any]]:
    """Return what comes out of one comparison: a dictionary per measure, stratum and test.

    It has ``test``, ``factor``, ``levels``, ``by``, ``measure``, ``unit``, ``n``, ``means``, what
    the test gives (:mod:`.significance`), ``p_holm`` over the ``family`` of pairs of this
    comparison and measure, ``difference`` with its bootstrap interval (``low``, ``high``), and
    ``normality`` of the differences. Where there can be no p value ``refused`` says why, and ``p``
    is None; ``note`` is what a reader has to know.

    Args:
        data: Of the study.
        comparison: What is asked.
        measures: Those of a comparison that names none.
    """
    found = []
    for measure in comparison.measures or measures:
        if comparison.test == "mixed":
            own = [_mixed(data, comparison, measure)]
        else:
            own = [
                result
                for stratum in _strata(data, comparison)
                for result in _tests(data, comparison, measure, stratum)
            ]
        _adjust(own)
        found += own
    return found


def _levels(data: StudyData, comparison: ComparisonConfig) -> list[str]:
    return list(comparison.levels or data.study.factors[comparison.factor].levels)


def _strata(data: StudyData, comparison: ComparisonConfig) -> list[dict[str, str]]:
    by = comparison.by
    if by is None:
        by = tuple(other_factors(data.study, comparison.factor))
    return strata(data, by, comparison.where)


def _tests(
    data: StudyData, comparison: ComparisonConfig, measure: str, stratum: dict[str, str]
) -> list[dict[str, Any]]:
    by_round = comparison.unit == "round"
    rows = rows_of(data, {**comparison.where, **stratum})
    table = unit_table(rows, comparison.factor, measure, by_round=by_round)
    levels = _levels(data, comparison)

    def apart(compared: Sequence[str]) -> bool:
        if by_round:
            return data.study.seeds == "own"
        return independent(data.study, comparison.factor, compared)

    about = {
        "factor": comparison.factor,
        "by": {**comparison.where, **stratum},
        "measure": measure,
        "unit": "round" if by_round else data.about["unit"],
        "alternative": comparison.alternative,
        "note": _ROUNDS if by_round else None,
    }
    found = []
    if len(levels) > 2 or comparison.test == "friedman":
        found.append(about | {"alternative": "two-sided"} | _omnibus(table, levels, apart(levels)))
    if comparison.test != "friedman":
        found += [
            about | _pair(table, pair, comparison.alternative, apart(pair))
            for pair in combinations(levels, 2)
        ]
    return [result | {"note": _noted(result)} for result in found]


def _columns(table: Any, levels: Sequence[str], apart: bool) -> list[Any]:
    """Each level's values; of levels that are not independent only the units that all have."""
    known = [level for level in levels if level in table.columns]
    part = table[known] if apart else table[known].dropna()
    return [
        part[level].dropna().to_numpy(float) if level in known else np.zeros(0) for level in levels
    ]


def _omnibus(table: Any, levels: Sequence[str], apart: bool) -> dict[str, Any]:
    columns = _columns(table, levels, apart)
    test = "kruskal-wallis" if apart else "friedman"
    run = significance.kruskal_wallis if apart else significance.friedman
    about = _about(test, levels, columns, apart)
    return about | _tried(about, lambda: run(columns))


def _pair(
    table: Any, levels: Sequence[str], alternative: significance.Alternative, apart: bool
) -> dict[str, Any]:
    first, second = _columns(table, levels, apart)
    test = "mann-whitney" if apart else "wilcoxon"
    run = significance.mann_whitney if apart else significance.wilcoxon
    about = _about(test, levels, [first, second], apart)
    found = about | _tried(about, lambda: run(first, second, alternative))
    if len(first) and len(second):
        interval = (
            significance.bootstrap(first, second)
            if apart
            else significance.bootstrap(first - second)
        )
        found["difference"] = {
            "mean": float(first.mean() - second.mean()),
            "low": None if interval is None else interval[0],
            "high": None if interval is None else interval[1],
        }
        found["normality"] = None if apart else significance.normality(first - second)
    return found


def _about(test: str, levels: Sequence[str], columns: Sequence[Any], apart: bool) -> dict[str, Any]:
    counts = [len(column) for column in columns]
    return {
        "test": test,
        "levels": list(levels),
        "n": min(counts) if not apart else counts,
        "means": [float(column.mean()) if len(column) else None for column in columns],
        "sds": [float(np.std(column, ddof=1)) if len(column) > 1 else None for column in columns],
        "medians": [float(np.median(column)) if len(column) else None for column in columns],
        "effect_name": _EFFECTS[test],
        "statistic": None,
        "p": None,
        "effect": None,
        "refused": None,
    }


def _tried(about: dict[str, Any], run: Any) -> dict[str, Any]:
    n = about["n"] if isinstance(about["n"], int) else min(about["n"])
    if n == 0:
        return {"refused": "no unit has a value in every level: nothing is compared"}
    if n == 1:
        return {
            "refused": "n = 1: one unit shows no variation between units, however many rounds it "
            "played, so there is no p value; let persons play (people), or train with several seeds"
        }
    try:
        result: dict[str, Any] = run()
    except ValueError as error:
        return {"refused": f"{error}: there is nothing to test"}
    return result


def _noted(result: dict[str, Any]) -> str | None:
    """The note, with the smallest p that so few pairs can give, where that is no small one."""
    n = result["n"]
    if result["test"] != "wilcoxon" or not isinstance(n, int) or result["p"] is None:
        return result["note"]
    least = 2.0**-n * (2 if result["alternative"] == "two-sided" else 1)
    if least <= 0.05:
        return result["note"]
    words = f"with n = {n} no exact p can be below {least:.3g}"
    return words if result["note"] is None else f"{result['note']}; {words}"


def _mixed(data: StudyData, comparison: ComparisonConfig, measure: str) -> dict[str, Any]:
    study = data.study
    by = comparison.by
    others = other_factors(study, comparison.factor) if by is None else list(by)
    factors = [comparison.factor, *(name for name in others if name not in comparison.where)]
    levels = [
        _levels(data, comparison),
        *(list(study.factors[name].levels) for name in factors[1:]),
    ]
    rows = rows_of(data, comparison.where)
    n = rows.dropna(subset=[measure])["unit"].nunique()
    found: dict[str, Any] = {
        "test": "mixed",
        "factor": comparison.factor,
        "levels": levels[0],
        "by": dict(comparison.where),
        "measure": measure,
        "unit": data.about["unit"],
        "n": int(n),
        "p": None,
        "refused": None,
        "note": None,
    }
    if comparison.unit == "round" or n < 2:
        found["refused"] = (
            f"n = {n}: a mixed model tells units apart from rounds, and needs at least two; let "
            "persons play (people), or train with several seeds"
        )
        return found
    if n < 5:
        found["note"] = f"n = {n} units: their variance, and with it every p, is a rough estimate"
    try:
        return found | mixed_model(
            rows, measure, {name: factor_column(name) for name in factors}, levels
        )
    except ValueError as error:
        return found | {"refused": str(error)}


def _adjust(results: list[dict[str, Any]]) -> None:
    """Holm's correction over the pairs of one comparison and measure."""
    pairs = [r for r in results if r["test"] in ("wilcoxon", "mann-whitney") and r["p"] is not None]
    for result, p in zip(pairs, significance.holm([r["p"] for r in pairs]), strict=True):
        result |= {"p_holm": p, "family": len(pairs)}
