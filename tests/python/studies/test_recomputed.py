"""Results of three small studies, worked out again by SciPy and statsmodels alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestPower

from sim2vr_harness.studies.comparisons import compare_all, summaries
from sim2vr_harness.studies.config import parse_study
from sim2vr_harness.studies.data import StudyData

LEVELS = ("low", "mid", "high")
MEASURES = ("speed", "hits")


def study_of(people: int, levels: tuple[str, ...], test: str = "auto") -> tuple[StudyData, Any]:
    """A study by random numbers, and its table: a row per person, a column per level."""
    rng = np.random.default_rng(people)
    rows = [
        {
            "design_cell": level, "factor_place": level, "unit": f"person {k}", "seed": 10 * k + i,
            "ended": "finished", "speed": rng.normal(1.0 + 0.3 * j + 0.1 * k, 0.3),
            "hits": float(rng.poisson(20 + 4 * j)),
        }
        for j, level in enumerate(levels) for k in range(people) for i in range(3)
    ]  # fmt: skip
    study = parse_study(
        {
            "name": "again", "fixed": {"user": "somebody"}, "people": people,
            "factors": {"place": {"key": "condition", "levels": list(levels)}},
            "measures": list(MEASURES), "comparisons": [{"factor": "place", "test": test}],
        }
    )  # fmt: skip
    data = StudyData(Path("nowhere"), study, {"unit": "person"})
    episodes = pd.DataFrame(rows)
    data.__dict__.update(episodes=episodes, cells=episodes.drop_duplicates("design_cell"))
    table = episodes.groupby(["unit", "factor_place"])[list(MEASURES)].mean().unstack()
    return data, table


def test_six_persons_and_two_levels() -> None:
    data, table = study_of(6, LEVELS[:2])
    results = compare_all(data, MEASURES)
    expected = [stats.ttest_rel(table[m]["low"], table[m]["mid"]) for m in MEASURES]
    assert [r["p"] for r in results] == pytest.approx([e.pvalue for e in expected])
    holm = multipletests([e.pvalue for e in expected], method="holm")[1]
    assert [r["p_holm"] for r in results] == pytest.approx(list(holm))
    for result, test, measure in zip(results, expected, MEASURES, strict=True):
        interval = test.confidence_interval(0.95)
        difference, each = result["difference"], table[measure]["low"] - table[measure]["mid"]
        assert (difference["low"], difference["high"]) == pytest.approx(tuple(interval))
        assert (difference["low"] > 0 or difference["high"] < 0) == (result["p"] < 0.05)
        effect = TTestPower().solve_power(nobs=6, alpha=0.025, power=0.8)
        assert difference["detectable"] == pytest.approx(effect * each.std(ddof=1))
    for summary in summaries(data, MEASURES):
        values = table[summary["measure"]][summary["levels"]["place"]]
        interval = stats.t.interval(0.95, 5, values.mean(), stats.sem(values))
        assert (summary["low"], summary["high"]) == pytest.approx(interval)


def test_twelve_persons_and_three_levels() -> None:
    data, table = study_of(12, LEVELS)
    results = compare_all(data, MEASURES)
    overall = [r for r in results if r["test"] == "friedman"]
    expected = [stats.friedmanchisquare(*(table[m][level] for level in LEVELS)) for m in MEASURES]
    assert [r["p"] for r in overall] == pytest.approx([e.pvalue for e in expected])
    pairs = [r for r in results if r["test"] == "wilcoxon"]
    assert len(pairs) == 6
    for result in pairs:
        one, other = (table[result["measure"]][level] for level in result["levels"])
        exact = stats.PermutationMethod(n_resamples=np.inf)
        p = stats.wilcoxon(one - other, method=exact, zero_method="wilcox").pvalue
        assert result["p"] == pytest.approx(p)
        i, j = np.triu_indices(12)
        each = (one - other).to_numpy()
        assert result["difference"]["estimate"] == pytest.approx(np.median((each[i] + each[j]) / 2))
    holm = multipletests([r["p"] for r in pairs], method="holm")[1]
    assert [r["p_holm"] for r in pairs] == pytest.approx(list(holm))
    assert {r["family"] for r in pairs} == {6}


def test_a_mixed_model_of_eight_persons() -> None:
    data, _ = study_of(8, LEVELS[:2], test="mixed")
    results = compare_all(data, MEASURES)
    effects = []
    for result, measure in zip(results, MEASURES, strict=True):
        means = data.episodes.groupby(["unit", "factor_place"])[measure].mean().unstack()
        expected = stats.ttest_rel(means[LEVELS[1]], means[LEVELS[0]])
        effect = result["effects"][1]
        assert effect["p"] == pytest.approx(expected.pvalue)
        assert effect["low"] == pytest.approx(expected.confidence_interval().low)
        effects.append(effect)
    holm = multipletests([e["p"] for e in effects], method="holm")[1]
    assert [e["p_holm"] for e in effects] == pytest.approx(list(holm))
