"""The comparisons that a study asks for: which values of which units, and by which test."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from sim2vr_harness.statistics import power, significance
from sim2vr_harness.statistics.mixed_models import mixed_model
from sim2vr_harness.studies.comparisons.units import (
    independent,
    missing_notes,
    other_factors,
    rows_of,
    some_units,
    strata,
    unit_table,
    with_failed,
)
from sim2vr_harness.studies.config import ComparisonConfig
from sim2vr_harness.studies.data import StudyData, factor_column

_EFFECTS = {
    "paired-t": "Cohen's d of the differences",
    "welch-t": "Cohen's d",
    "wilcoxon": "matched-pairs rank-biserial correlation",
    "mann-whitney": "rank-biserial correlation",
    "friedman": "Kendall's W",
    "kruskal-wallis": "epsilon squared",
}
_PAIRS = {
    "paired-t": significance.paired_t,
    "welch-t": significance.welch_t,
    "wilcoxon": significance.wilcoxon,
    "mann-whitney": significance.mann_whitney,
}
_OVERALL = {"friedman": significance.friedman, "kruskal-wallis": significance.kruskal_wallis}
_ALPHA = 0.05
_ROUNDS = (
    "n counts rounds of one policy, as in the publication that this is compared with; they are no "
    "sample of persons, and p says nothing of people"
)


def compare_all(data: StudyData, measures: Sequence[str]) -> list[dict[str, Any]]:
    """Return the results of all of a study's comparisons.

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
    """Return the results of one comparison: a dictionary per measure, stratum and test.

    It has ``test``, ``factor``, ``levels``, ``by``, ``measure``, ``unit``, ``n``, ``means``, the
    test's numbers (:mod:`.significance`) and ``p_holm``, corrected over the ``family``: all pairs
    (or all overall tests, or effects) of this comparison, whatever their measure. Pairs have
    ``difference``: ``mean``, ``sd``, the ``estimate`` and interval (``low``, ``high``) that belong
    to the test, and ``detectable``, the difference that n finds with power 0.8; and ``normality``
    of the differences. ``p`` is None where ``refused`` says why; ``note`` is what a reader must
    know.

    Args:
        data: Of the study.
        comparison: What is asked.
        measures: Those of a comparison that names none.
    """
    found: list[dict[str, Any]] = []
    for measure in comparison.measures or measures:
        if comparison.test == "mixed":
            found.append(_mixed(data, comparison, measure))
        else:
            for stratum in _strata(data, comparison):
                found += _tests(data, comparison, measure, stratum)
    # Correct by Holm's method over all measures, strata and pairs of one comparison.
    for tests in (_PAIRS, _OVERALL):
        _correct([r for r in found if r["test"] in tests and r["p"] is not None])
    effects = [effect for r in found for effect in r.get("effects", ())[1:]]
    _correct([effect for effect in effects if effect["p"] is not None])
    return [result | _read_with(result) for result in found]


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
    where = {**comparison.where, **stratum}
    rows = rows_of(data, where)
    everyone = with_failed(data, where)
    table = unit_table(rows, comparison.factor, measure, by_round=by_round)
    levels = _levels(data, comparison)

    def apart(compared: Sequence[str]) -> bool:
        if by_round:
            return data.study.seeds == "own"
        return independent(data.study, comparison.factor, compared)

    everyone = everyone[everyone[factor_column(comparison.factor)].isin(levels)]
    about: dict[str, Any] = {
        "factor": comparison.factor,
        "by": where,
        "measure": measure,
        "unit": "round" if by_round else data.about["unit"],
        "units": int(everyone["seed" if by_round else "unit"].nunique()),
        "alternative": comparison.alternative,
        "note": _ROUNDS if by_round else None,
        "equivalence": comparison.equivalence.get(measure),
    }
    found = []
    if len(levels) > 2 or comparison.test == "friedman":
        found.append(about | {"alternative": "two-sided"} | _omnibus(table, levels, apart(levels)))
    if comparison.test != "friedman":
        found += [
            about | _pair(table, pair, comparison, apart(pair)) for pair in combinations(levels, 2)
        ]
    if not by_round:
        for result in found:
            notes = _others_notes(table, result, apart(result["levels"]))
            part = everyone[everyone[factor_column(comparison.factor)].isin(result["levels"])]
            for label in result["levels"]:
                own = part[part[factor_column(comparison.factor)] == label]
                notes += [f"{label}: {note}" for note in missing_notes(own, measure)]
            result["note"] = "; ".join(notes) or None
    return found


def _others_notes(table: Any, result: dict[str, Any], apart: bool) -> list[str]:
    """Say where a test compares other units than those of which a level has its mean."""
    if apart or not isinstance(result["n"], int):
        return []
    counts = {
        level: int(table[level].notna().sum()) for level in result["levels"] if level in table
    }
    more = [f"{count} in {level}" for level, count in counts.items() if count > result["n"]]
    if not more:
        return []
    return [
        f"the test compares the {result['n']} of {result['units']} with a value in every level, so "
        f"its means are of other units than those of the conditions ({', '.join(more)})"
    ]


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
    about = _about(test, levels, columns, apart)
    return about | _tried(about, lambda: _OVERALL[test](columns))


def _pair(
    table: Any, levels: Sequence[str], comparison: ComparisonConfig, apart: bool
) -> dict[str, Any]:
    first, second = _columns(table, levels, apart)
    few = comparison.test == "auto" and comparison.unit != "round"
    few = few and min(len(first), len(second)) < significance.FEW
    test = ("welch-t" if few else "mann-whitney") if apart else "paired-t" if few else "wilcoxon"
    about = _about(test, levels, [first, second], apart)
    found = about | _tried(about, lambda: _PAIRS[test](first, second, comparison.alternative))
    low, high = found.pop("interval", (None, None))
    mean = float(first.mean() - second.mean()) if len(first) and len(second) else None
    if mean is not None:
        found["difference"] = {
            "mean": mean,
            "sd": _spread(first, second, apart),
            "estimate": found.pop("estimate", mean),
            "low": low,
            "high": high,
        }
        found["normality"] = None if apart else significance.normality(first - second)
    return found


def _spread(first: Any, second: Any, apart: bool) -> float | None:
    """Standard deviation of the pairs' differences, or within two samples."""
    if min(len(first), len(second)) < 2:
        return None
    return significance.pooled_sd(first, second) if apart else float(np.std(first - second, ddof=1))


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


def _read_with(result: dict[str, Any]) -> dict[str, Any]:
    """What a result is read with: the smallest p and the smallest difference that n can show."""
    if result["test"] not in _PAIRS or result["p"] is None:
        return {}
    notes = [] if result["note"] is None else [result["note"]]
    alternative, tests = result["alternative"], result["family"]
    least = significance.smallest_p(result["test"], result["n"], alternative)
    reachable = least is None or least * tests < _ALPHA
    if least is not None and not reachable:
        n = result["n"] if isinstance(result["n"], int) else " and ".join(map(str, result["n"]))
        corrected = f", {min(1.0, tests * least):.3g} after correction" if tests > 1 else ""
        notes.append(f"with n = {n} the smallest possible p is {least:.3g}{corrected}")
    detectable = None
    spread = result["difference"]["sd"]
    if reachable and spread:
        sides = 2 if alternative == "two-sided" else 1
        ranks = result["test"] in ("wilcoxon", "mann-whitney")
        detectable = power.detectable(result["n"], spread, tests=tests, sides=sides, ranks=ranks)
    difference = result["difference"] | {"detectable": detectable}
    return {"note": "; ".join(notes) or None, "difference": difference}


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
    found: dict[str, Any] = {
        "test": "mixed",
        "factor": comparison.factor,
        "levels": levels[0],
        "by": dict(comparison.where),
        "measure": measure,
        "unit": data.about["unit"],
        "n": int(rows.dropna(subset=[measure])["unit"].nunique()),
        "units": int(data.episodes["unit"].nunique()),
        "p": None,
        "refused": None,
        "note": None,
    }
    if comparison.unit == "round" or found["n"] < 2:
        found["refused"] = (
            f"n = {found['n']}: a mixed model tells units apart from rounds, and needs at least "
            "two; let persons play (people), or train with several seeds"
        )
        return found
    own = [
        name
        for name, labels in zip(factors, levels, strict=True)
        if independent(study, name, labels)
    ]
    if own:
        found["refused"] = (
            f"each level of {own[0]} has units of its own, so that no unit shows its effect; use "
            "test: auto"
        )
        return found
    rows = rows[rows[factor_column(comparison.factor)].isin(levels[0])]
    try:
        found |= mixed_model(rows, measure, {name: factor_column(name) for name in factors}, levels)
    except ValueError as error:
        return found | {"refused": str(error)}
    found["n"] = found["groups"]
    if found["left_out"]:
        out = some_units(found["left_out"])
        notes = [f"left out, because a condition has no {measure} of them: {out}"]
        found["note"] = "; ".join([*notes, *missing_notes(rows, measure)])
    return found


def _correct(family: list[dict[str, Any]]) -> None:
    for result, p in zip(family, significance.holm([r["p"] for r in family]), strict=True):
        result |= {"p_holm": p, "family": len(family)}
