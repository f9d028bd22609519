"""Comparisons of tables that were written by hand: what n counts, and when there is no p value."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests

from sim2vr_harness.statistics.mixed_models import mixed_model
from sim2vr_harness.studies.comparisons import compare, summaries
from sim2vr_harness.studies.config import ComparisonConfig, parse_study
from sim2vr_harness.studies.data import StudyData


def study_of(values: dict[tuple[str, str], list[list[float]]], **settings: Any) -> StudyData:
    """A study of two factors; (difficulty, version) -> per unit the values of its rounds."""
    rows = [
        {
            "design_cell": f"difficulty={difficulty},version={version}",
            "factor_difficulty": difficulty,
            "factor_version": version,
            "unit": f"person {unit}",
            "seed": 10 * unit + number,
            "ended": "finished",
            "coins": value,
        }
        for (difficulty, version), units in values.items()
        for unit, rounds in enumerate(units)
        for number, value in enumerate(rounds)
    ]
    episodes = pd.DataFrame(rows)
    labels = {
        "difficulty": list(dict.fromkeys(difficulty for difficulty, _ in values)),
        "version": list(dict.fromkeys(version for _, version in values)),
    }
    factors = {
        "difficulty": {"key": "condition", "levels": labels["difficulty"]},
        "version": {"key": "env.app.options.version", "levels": labels["version"]},
    }
    fixed = {"user": "somebody"}
    study = parse_study(
        {"name": "by_hand", "people": 3, "fixed": fixed, "factors": factors, **settings}
    )
    data = StudyData(Path("nowhere"), study, {"unit": "person"})
    cells = episodes.drop_duplicates("design_cell")
    data.__dict__.update(episodes=episodes, cells=cells)
    return data


def asked(**settings: Any) -> ComparisonConfig:
    return ComparisonConfig(factor="difficulty", **settings)


FOUR = {("easy", "A"): [4.0, 7.0, 9.0, 11.0], ("hard", "A"): [1.0, 5.0, 8.0, 7.0]}
THREE = {
    ("easy", "A"): [[4.0, 6.0], [7.0, 7.0], [9.0, 9.0]],
    ("hard", "A"): [[1.0, 1.0], [2.0, 4.0], [3.0, 5.0]],
}
"""Means of persons: 5, 7, 9 and 1, 3, 4."""


def test_n_counts_persons_and_rounds_are_averaged_first() -> None:
    (found,) = compare(study_of(THREE), asked(), ["coins"])
    assert (found["test"], found["n"], found["unit"]) == ("paired-t", 3, "person")
    assert found["means"] == pytest.approx([7.0, 8.0 / 3.0])
    assert found["medians"] == [7.0, 3.0]
    # Differences 4, 4, 5: mean 13/3, SD sqrt(1/3), error 1/3; t = 13 with two degrees of freedom,
    # whose distribution is 1/2 + t / (2 sqrt(2 + t^2)).
    assert found["statistic"] == pytest.approx(13.0)
    assert found["p"] == pytest.approx(1.0 - 13.0 / np.sqrt(171.0))
    assert found["difference"]["mean"] == pytest.approx(13.0 / 3.0)
    assert found["difference"]["low"] == pytest.approx(13.0 / 3.0 - 4.302653 / 3.0)
    assert found["difference"]["high"] == pytest.approx(13.0 / 3.0 + 4.302653 / 3.0)
    assert found["note"] is None
    (rounds,) = compare(study_of(THREE), asked(unit="round"), ["coins"])
    assert (rounds["unit"], rounds["n"]) == ("round", 6)
    assert rounds["note"].startswith("n counts rounds of one policy, as in the publication")
    # Differences 4, 4, 5: all positive, 2 / 2^3 two-sided.
    (ranks,) = compare(study_of(THREE), asked(test="wilcoxon"), ["coins"])
    assert (ranks["test"], ranks["p"], ranks["effect"]) == ("wilcoxon", 0.25, 1.0)
    assert ranks["note"] == "with n = 3 the smallest possible p is 0.25"
    (greater,) = compare(study_of(THREE), asked(test="wilcoxon", alternative="greater"), ["coins"])
    assert greater["p"] == pytest.approx(0.125)


NAN = float("nan")


@pytest.mark.parametrize(
    ("easy", "hard", "test", "refused"),
    [
        (THREE["easy", "A"], [[3.0], [5.0], [7.0]], "auto", "all pairs differ by the same: there"),
        ([[1.0], [2.0]], [[1.0], [2.0]], "auto", "no pair differs: there is nothing to test"),
        ([[1.0], [2.0]], [[NAN], [NAN]], "auto", "no unit has a value in every level"),
        ([[4.0, 6.0] * 25], [[1.0] * 50], "auto", "n = 1: one unit shows no variation between un"),
        ([[4.0, 6.0]], [[1.0, 1.0]], "mixed", "n = 1: a mixed model tells units apart from rounds"),
    ],
)
def test_without_a_sample_there_is_no_p(easy: Any, hard: Any, test: str, refused: str) -> None:
    values = {("easy", "A"): easy, ("hard", "A"): hard}
    (found,) = compare(study_of(values), asked(test=test, by=[]), ["coins"])
    assert found["refused"].startswith(refused) and found.get("p") is None


def test_the_difference_that_n_could_have_found() -> None:
    data = study_of({key: [[value] for value in values] for key, values in FOUR.items()})
    data.episodes["gems"] = data.episodes["coins"] ** 2
    both = compare(data, asked(), ["coins", "gems"])
    low, high = sorted(one["p"] for one in both)
    holm = [2 * low, max(2 * low, high)]
    assert sorted(one["p_holm"] for one in both) == pytest.approx(holm)
    (found,) = compare(data, asked(), ["coins"])
    detectable = found["difference"]["detectable"]
    # Noncentral t: with this mean difference a paired t test of four rejects 80 % of the time.
    shift = detectable / found["difference"]["sd"] * np.sqrt(4)
    limit = stats.t.ppf(0.975, 3)
    assert stats.nct.sf(limit, 3, shift) + stats.nct.cdf(-limit, 3, shift) == pytest.approx(
        0.8, abs=1e-3
    )


def test_three_levels_give_friedman_s_test_and_corrected_pairs() -> None:
    values = {**THREE, ("middle", "A"): [[3.0], [4.0], [6.0]]}
    found = compare(study_of(values), asked(), ["coins"])
    assert [one["test"] for one in found] == ["friedman", "paired-t", "paired-t", "paired-t"]
    assert [one["levels"] for one in found[1:]] == [
        ["easy", "hard"], ["easy", "middle"], ["hard", "middle"],
    ]  # fmt: skip
    assert found[0]["effect"] == pytest.approx(1.0)
    expected = multipletests([one["p"] for one in found[1:]], method="holm")[1]
    assert [one["p_holm"] for one in found[1:]] == pytest.approx(list(expected))
    assert {one["family"] for one in found[1:]} == {3}
    assert (found[0]["p_holm"], found[0]["family"]) == (found[0]["p"], 1)


def test_other_factors_are_looked_at_apart_or_together() -> None:
    values = {**THREE, ("easy", "B"): [[1.0], [1.0], [1.0]], ("hard", "B"): [[1.0], [2.0], [3.0]]}
    found = compare(study_of(values), asked(), ["coins"])
    assert [one["by"] for one in found] == [{"version": "A"}, {"version": "B"}]
    (only,) = compare(study_of(values), asked(where={"version": "B"}), ["coins"])
    assert only["by"] == {"version": "B"} and only["means"] == [1.0, 2.0]
    (both,) = compare(study_of(values), asked(by=[]), ["coins"])
    # Person 0 at easy: rounds 4, 6 and 1.
    assert both["means"][0] == pytest.approx(((4 + 6 + 1) + (7 + 7 + 1) + (9 + 9 + 1)) / 9)


def test_trainings_of_two_kinds_are_independent() -> None:
    factors = {
        "weight": {"key": "training.env.user.effort.weight", "levels": ["0.1", "0.2"]},
        "seed": {"key": "training.seed", "levels": ["1", "2", "3"]},
    }
    rows = [
        {"factor_weight": weight, "factor_seed": seed, "unit": seed, "seed": 1, "coins": value,
         "ended": "finished", "design_cell": f"{weight} {seed}"}
        for weight, values in (("0.1", [1.0, 2.0, 3.0]), ("0.2", [4.0, 5.0, 6.0]))
        for seed, value in zip("123", values, strict=True)
    ]  # fmt: skip
    study = parse_study({"name": "w", "fixed": {"config": "x.yaml"}, "factors": factors})
    data = StudyData(Path("nowhere"), study, {"unit": "seed"})
    data.__dict__.update(episodes=pd.DataFrame(rows), cells=pd.DataFrame(rows))
    (few,) = compare(data, ComparisonConfig(factor="weight"), ["coins"])
    assert (few["test"], few["n"], few["unit"]) == ("welch-t", [3, 3], "seed")
    # Variances 1 and 1: t = -3 / sqrt(2/3) with four degrees of freedom.
    assert few["p"] == pytest.approx(2 * stats.t.sf(3.0 / np.sqrt(2 / 3), 4))
    (found,) = compare(data, ComparisonConfig(factor="weight", test="wilcoxon"), ["coins"])
    assert (found["test"], found["n"], found["unit"]) == ("mann-whitney", [3, 3], "seed")
    # One of the 20 ways to choose three ranks is so low: two-sided 2 / 20.
    assert found["p"] == pytest.approx(0.1)
    assert found["effect"] == -1.0


def _responses(rng: np.random.Generator, people: int, rounds: int, slope: float) -> pd.DataFrame:
    """Rounds of persons who differ in how they respond to a condition without a mean effect."""
    unit = np.repeat(np.arange(people), 2 * rounds)
    hard = np.tile(np.repeat([0.0, 1.0], rounds), people)
    person, own = rng.normal(0.0, 1.0, people), rng.normal(0.0, slope, people)
    value = person[unit] + own[unit] * hard + rng.normal(0.0, 1.0, len(unit))
    level = np.where(hard > 0.0, "hard", "easy")
    return pd.DataFrame({"unit": unit, "factor_difficulty": level, "coins": value})


@pytest.mark.parametrize(("people", "slope"), [(6, 1.0), (8, 0.0)])
def test_a_mixed_model_keeps_its_error_rate(people: int, slope: float) -> None:
    """Nothing differs on average; a random intercept alone rejects in 15 to 37 % of these."""
    rng = np.random.default_rng(70)
    rejected = [
        mixed_model(
            _responses(rng, people, 10, slope),
            "coins",
            {"difficulty": "factor_difficulty"},
            [["easy", "hard"]],
        )["effects"][1]["p"]
        < 0.05
        for _ in range(300)
    ]
    # Binomial: 0.05 of 300 have an SD of 0.0126.
    assert 0.02 < np.mean(rejected) < 0.08


def test_a_mixed_model_of_two_factors_by_hand() -> None:
    """Effects are contrasts of each person's means, tested by t; rounds are averaged first."""
    rng = np.random.default_rng(5)
    values = {
        (difficulty, version): [list(rng.normal(size=4)) for _ in range(6)]
        for difficulty in ("easy", "hard")
        for version in ("A", "B")
    }
    (found,) = compare(study_of(values), asked(test="mixed"), ["coins"])
    assert found["formula"] == ("coins ~ difficulty * version + (1 + difficulty * version | unit)")
    assert (found["n"], found["rounds"], found["note"]) == (6, 96, None)
    mean = {cell: np.mean(units, axis=1) for cell, units in values.items()}
    base = mean["easy", "A"]
    own = {
        "Intercept": base,
        "difficulty=hard": mean["hard", "A"] - base,
        "version=B": mean["easy", "B"] - base,
        "difficulty=hard:version=B": mean["hard", "B"] - mean["hard", "A"] - mean["easy", "B"]
        + base,
    }  # fmt: skip
    effects = {effect["name"]: effect for effect in found["effects"]}
    assert sorted(effects) == sorted(own)
    for name, each in own.items():
        expected = stats.ttest_1samp(each, 0.0)
        assert effects[name]["estimate"] == pytest.approx(each.mean())
        assert effects[name]["statistic"] == pytest.approx(expected.statistic)
        assert effects[name]["p"] == pytest.approx(expected.pvalue)
        assert effects[name]["low"] == pytest.approx(expected.confidence_interval().low)
    data = study_of({**THREE, ("hard", "A"): [[1.0], [np.nan], [3.0]]})
    (found,) = compare(data, asked(test="mixed", by=[]), ["coins"])
    assert (found["n"], found["units"], found["left_out"]) == (2, 3, ["person 1"])


def test_who_has_no_value_is_said_with_the_reason() -> None:
    values = {**THREE, ("hard", "A"): [[1.0], [np.nan, np.nan], [3.0]]}
    data = study_of(values)
    data.episodes["throughput_bps"] = data.episodes["coins"]
    data.episodes["hits"], data.episodes["errors"] = 7.0, 2.0
    data.episodes["hit_rate"] = data.episodes["coins"].notna().astype(float)
    easy, hard = summaries(data, ["throughput_bps"])
    # Two rounds of nine selections in easy are two blocks, one round in hard is one.
    assert (easy["n"], easy["units"], easy["notes"]) == (3, 3, [])
    assert (hard["n"], hard["units"]) == (2, 3)
    missing, few = hard["notes"]
    assert missing.startswith("1 of 3 have no throughput_bps (person 1): none of their 2 rounds")
    assert missing.endswith("they hit 0 % of the targets, the others 100 %")
    assert few.startswith("throughput of 2 of 3 comes from one block of 9 movements or less")
    (found,) = compare(data, asked(), ["throughput_bps"])
    assert (found["n"], found["units"]) == (2, 3) and f"hard: {missing}" in found["note"]


def test_summaries_are_over_units() -> None:
    easy, hard = summaries(study_of(THREE), ["coins"])
    assert easy["levels"] == {"difficulty": "easy", "version": "A"}
    assert (easy["n"], easy["rounds"], easy["mean"]) == (3, 6, 7.0)
    assert easy["sd"] == pytest.approx(2.0)
    # The quantile of two degrees of freedom is 4.302653; the error 2 / sqrt 3.
    assert easy["high"] - easy["low"] == pytest.approx(2 * 4.302653 * 2.0 / np.sqrt(3))
    assert easy["rounds_sd"] == pytest.approx(np.std([4, 6, 7, 7, 9, 9], ddof=1))
    assert hard["mean"] == pytest.approx(8.0 / 3.0)
    data = study_of(THREE)  # rounds whose app failed count nowhere
    data.episodes.loc[0, ["ended", "coins"]] = "app_failed", 99.0
    assert summaries(data, ["coins"])[0]["mean"] == pytest.approx((6.0 + 7.0 + 9.0) / 3.0)
