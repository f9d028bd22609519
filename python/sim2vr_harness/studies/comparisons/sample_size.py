"""Sample sizes of a study's comparisons for given differences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.statistics.power import STANDARDISED, units_needed
from sim2vr_harness.statistics.significance import FEW
from sim2vr_harness.studies.comparisons.comparing import compare
from sim2vr_harness.studies.comparisons.units import independent, other_factors
from sim2vr_harness.studies.config import ComparisonConfig, StudyConfig
from sim2vr_harness.studies.data import StudyData


@dataclass(frozen=True)
class SampleSize:
    """What a difference of a comparison needs.

    Attributes:
        measure: Name; "any" without earlier results.
        levels: The two.
        standardised: The difference in standard deviations.
        difference: In the measure's unit; None without earlier results.
        sd: Of the pairs' differences, or within the levels; None without earlier results.
        units: How many, of each level where these are independent.
        tests: How many are corrected for.
        paired: Whether the same units have both levels.
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
        tests = len(own) * _strata(study, comparison) * (len(levels) * (len(levels) - 1) // 2)
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
                    if comparison.test == "wilcoxon" or units >= FEW:
                        units = need(ranks=True)
                    size_here = None if sd is None else size * sd
                    found.append(
                        SampleSize(measure, (one, other), size, size_here, sd, units, tests, paired)
                    )
    return found


def _strata(study: StudyConfig, comparison: ComparisonConfig) -> int:
    """How often a comparison is made: once per combination of other factors' levels."""
    by = comparison.by
    names = other_factors(study, comparison.factor) if by is None else by
    count = 1
    for name in names:
        if name not in comparison.where:
            count *= len(study.factors[name].levels)
    return count


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
