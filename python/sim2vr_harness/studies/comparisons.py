"""Comparisons of a study's conditions; n counts participants or trainings, never rounds."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.statistics import power, significance
from sim2vr_harness.statistics.intervals import mean_interval
from sim2vr_harness.statistics.mixed_models import mixed_model
from sim2vr_harness.statistics.power import STANDARDISED, units_needed
from sim2vr_harness.studies.config import ComparisonConfig, StudyConfig
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


def other_factors(study: StudyConfig, factor: str) -> list[str]:
    """Return the factors beside one, units left out."""
    return [name for name in study.factors if name not in (factor, study.unit_factor)]


def independent(study: StudyConfig, factor: str, levels: Sequence[str]) -> bool:
    """Return whether the units of these levels are independent samples.

    Units are independent if the levels differ in the user or in the training, even where the seeds
    are equal. They are not independent if participants are the units, because they
    play all levels, or if one user plays all levels.
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
    column = factor_column(factor)
    known = episodes[[unit, column, measure]].dropna(subset=[measure])
    return known.pivot_table(index=unit, columns=column, values=measure, aggfunc="mean")


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
    has = episodes[measure].notna()
    units = list(dict.fromkeys(map(str, episodes["unit"])))
    present = set(map(str, episodes["unit"][has]))
    missing = [unit for unit in units if unit not in present]
    notes = []
    if missing:
        known = episodes[has]
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
    if measure == "throughput_bps" and {"hits", "errors"} <= set(episodes):
        known = episodes[has]
        selections = known.assign(n=known["hits"] + known["errors"]).groupby("unit")["n"].sum()
        few = [str(unit) for unit, n in selections.items() if n < 2 * _BLOCK]
        if few:
            notes.append(
                f"throughput of {len(few)} of {len(units)} comes from one block of {_BLOCK} "
                f"movements or less ({some_units(few)}), which is too few for its end points' "
                "standard deviation: play more episodes"
            )
    return notes


# --- summaries -------------------------------------------------------------------------------


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
            values = rows[measure].dropna()
            units = values.groupby(rows["unit"]).mean().to_numpy(float)
            rounds = values.to_numpy(float)
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


# --- tests -----------------------------------------------------------------------------------

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
    "sample of people, and p says nothing about people"
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
    by = other_factors(data.study, comparison.factor) if comparison.by is None else comparison.by
    for measure in comparison.measures or measures:
        if comparison.test == "mixed":
            found.append(_mixed(data, comparison, measure, by))
        else:
            for stratum in strata(data, by, comparison.where):
                found += _tests(data, comparison, measure, stratum)
    # Correct by Holm's method over all measures, strata and pairs of one comparison.
    for tests in (_PAIRS, _OVERALL):
        _correct([r for r in found if r["test"] in tests and r["p"] is not None])
    effects = [effect for r in found for effect in r.get("effects", ())[1:]]
    _correct([effect for effect in effects if effect["p"] is not None])
    return [result | _read_with(result) for result in found]


def _tests(
    data: StudyData, comparison: ComparisonConfig, measure: str, stratum: dict[str, str]
) -> list[dict[str, Any]]:
    by_round = comparison.unit == "round"
    where = {**comparison.where, **stratum}
    rows = rows_of(data, where)
    everyone = with_failed(data, where)
    table = unit_table(rows, comparison.factor, measure, by_round=by_round)
    levels = list(comparison.levels or data.study.factors[comparison.factor].levels)

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
        columns = _columns(table, levels, apart(levels))
        test = "kruskal-wallis" if apart(levels) else "friedman"
        result = _about(test, levels, columns, apart(levels))
        result |= _tried(result, lambda: _OVERALL[test](columns))
        found.append(about | {"alternative": "two-sided"} | result)
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
        sd = None
        if min(len(first), len(second)) > 1:  # of the pairs' differences, or within two samples
            pooled = significance.pooled_sd
            sd = pooled(first, second) if apart else float(np.std(first - second, ddof=1))
        found["difference"] = {
            "mean": mean,
            "sd": sd,
            "estimate": found.pop("estimate", mean),
            "low": low,
            "high": high,
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
            "played, so there is no p value; set people, or train with several seeds"
        }
    try:
        result: dict[str, Any] = run()
    except ValueError as error:
        return {"refused": f"{error}: there is nothing to test"}
    return result


def _read_with(result: dict[str, Any]) -> dict[str, Any]:
    """Return the smallest p value and the smallest difference that n can show, for the reader."""
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


def _mixed(
    data: StudyData, comparison: ComparisonConfig, measure: str, by: Sequence[str]
) -> dict[str, Any]:
    study = data.study
    factors = [comparison.factor, *(name for name in by if name not in comparison.where)]
    levels = [
        list(comparison.levels or study.factors[comparison.factor].levels),
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
            "two; set people, or train with several seeds"
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


# --- sample sizes ----------------------------------------------------------------------------


@dataclass(frozen=True)
class SampleSize:
    """Sample size that a comparison needs to find a difference.

    Attributes:
        measure: Name of the measure; "any" without earlier results.
        levels: The two levels that are compared.
        standardised: Difference in standard deviations.
        difference: Difference in the measure's unit; None without earlier results.
        sd: SD of the paired differences, or within the levels; None without earlier results.
        units: Number of units, per level where the levels are independent.
        tests: Number of tests in the correction.
        paired: True if the same units have both levels.
    """

    measure: str
    levels: tuple[str, str]
    standardised: float
    difference: float | None
    sd: float | None
    units: int
    tests: int
    paired: bool


def wanted_differences(texts: Sequence[str], measures: Sequence[str]) -> dict[str, float]:
    """Read ``MEASURE=VALUE``.

    Raises:
        InputError: There is no such measure, or the value is no number above 0.
    """
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in measures:
            raise unknown_name("--difference", name, measures)
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = 0.0
        if not 0.0 < found[name] < float("inf"):
            raise InputError("--difference", shown(text), "MEASURE=VALUE with a number above 0")
    return found


def sample_sizes(
    study: StudyConfig,
    measures: Sequence[str],
    earlier: StudyData | None,
    wanted: Mapping[str, float],
) -> list[SampleSize]:
    """Return how many units each comparison of a study needs.

    Args:
        measures: Those of comparisons that name none.
        earlier: Its results, if it has been run.
        wanted: Measure -> difference; other measures have standardised ones.

    Raises:
        InputError: A difference is wanted, and no earlier results have its standard deviation.
    """
    found: list[SampleSize] = []
    for comparison in study.comparisons:
        if comparison.test in ("mixed", "friedman") or comparison.unit == "round":
            continue
        own = comparison.measures or tuple(measures)
        levels = list(comparison.levels or study.factors[comparison.factor].levels)
        by = other_factors(study, comparison.factor) if comparison.by is None else comparison.by
        apart = [len(study.factors[n].levels) for n in by if n not in comparison.where]
        tests = len(own) * math.prod(apart) * math.comb(len(levels), 2)
        spreads = {} if earlier is None else _spreads(earlier, comparison, own)
        sides = 2 if comparison.alternative == "two-sided" else 1
        for one, other in combinations(levels, 2):
            paired = not independent(study, comparison.factor, (one, other))
            for measure in own if spreads or wanted else ("any",):
                sd = spreads.get((measure, one, other))
                if measure in wanted and sd is None:
                    raise InputError(
                        "--difference",
                        f"{measure}={wanted[measure]:g} without a standard deviation",
                        "results in --out in which units differ; run the study first",
                    )
                for size in [wanted[measure] / (sd or 1.0)] if measure in wanted else STANDARDISED:
                    need = partial(units_needed, size, 1.0, paired=paired, tests=tests, sides=sides)
                    units = need()
                    # The test is the one that a comparison of so many units makes.
                    if comparison.test == "wilcoxon" or units >= significance.FEW:
                        units = need(ranks=True)
                    size_here = None if sd is None else size * sd
                    found.append(
                        SampleSize(measure, (one, other), size, size_here, sd, units, tests, paired)
                    )
    return found


def _spreads(
    earlier: StudyData, comparison: ComparisonConfig, measures: Sequence[str]
) -> dict[tuple[str, str, str], float]:
    """(measure, level, level) -> largest standard deviation over strata."""
    found: dict[tuple[str, str, str], float] = {}
    for result in compare(earlier, comparison, measures):
        sd = (result.get("difference") or {}).get("sd")
        if sd:
            one, other = map(str, result["levels"])
            key = str(result["measure"]), one, other
            found[key] = max(sd, found.get(key, 0.0))
    return found
