import json
import re
from dataclasses import replace

import numpy as np
import pytest
import strange_game

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.games.published import published_of
from sim2vr_harness.studies.report.body import load_of
from sim2vr_harness.studies.report.methods import varied_in
from sim2vr_harness.studies.report.sentences import (
    headline,
    sentences_of,
)
from sim2vr_harness.studies.report.source import ReportSource, summary_of
from sim2vr_harness.studies.report.strategy import depth_of
from sim2vr_harness.studies.report.tables import test_table as table_of_tests

NOBODY = published_of("strange")


def test_persons_count_with_the_mean_of_their_rounds(source: ReportSource) -> None:
    group = source.groups[0]
    rows = group.episodes.iloc[[0, 0, 1]].copy()
    rows["person"], rows["sparks"] = [1, 1, 2], [1.0, 3.0, 8.0]
    found = summary_of(replace(group, episodes=rows), "sparks")
    assert found is not None and (found.mean, found.n, found.rounds) == (5.0, 2, 3)  # 2 and 8
    assert found.spread == pytest.approx(np.sqrt(18.0))
    alone = summary_of(group, "sparks")  # one user: over its rounds, 10 and 14
    assert alone is not None and (alone.mean, alone.n, alone.rounds) == (12.0, 1, 2)
    assert alone.spread == pytest.approx(np.sqrt(8.0))


def test_an_unknown_game_is_reported_by_its_data_dictionary(
    source: ReportSource, page: str
) -> None:
    sparks = source.measure("sparks")
    assert sparks is not None and (sparks.label, sparks.unit) == ("Sparks", "V")
    load = load_of(source.groups[0])  # fatigue at a round's end
    assert load is not None and load.fatigue and load.names == strange_game.MUSCLES
    np.testing.assert_allclose(load.values, [0.1, 0.3, 0.2], atol=1e-6)
    told = sentences_of(source, NOBODY)
    # The return is 2 sparks - 2: 22 and 44, rounds 18, 26 and 38, 50.
    assert told[0].startswith("Return: 22.0 in calm; 44.0 in wild <!--<script>; whether the groups")
    assert headline(source) == "Return: 22.0 in calm; 44.0 in wild <!--<script>."
    before, _, _ = page.partition("<script>")
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", before), "opens without a network"
    assert "wild &lt;!--&lt;script&gt;" in page and "wild <!--<script>" not in before
    found = re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)
    assert not any("<" in panel for panel in found), "a browser would take it for markup"
    panels = list(map(json.loads, found))
    names = {trace.get("name") for panel in panels for trace in panel["data"]}
    assert set(strange_game.CONDITIONS) <= names


def test_depth_is_the_tool_s_distance_behind_the_items_plane(source: ReportSource) -> None:
    depths = depth_of(source.groups[0])
    assert len(depths) == 2
    np.testing.assert_allclose(depths[0].values_m, -0.1, atol=1e-6)
    assert "wand" in depths[0].what and "plane" in depths[0].what
    assert depths[0].times_s[0] == 0.0  # the log's first row is from before the round


def test_the_answer_names_the_levels_with_the_lowest_and_the_highest_mean(
    source: ReportSource,
) -> None:
    sparks = {
        "factor": "size", "by": {}, "measure": "sparks", "levels": ["0.1", "0.2", "0.3"],
        "means": [3.0, 1.0, 2.0], "n": 8, "unit": "person", "test": "friedman", "p": 0.01,
    }  # fmt: skip
    height = {**sparks, "factor": "mood", "levels": ["low", "top"], "means": [2.0, 1.0], "p": 0.4}
    asked = replace(source, planned={"measures": ["sparks"]}, comparisons=[sparks, height])
    assert headline(asked) == (
        "Sparks is lowest with size 0.2 (1.00 V) and highest with size 0.1 (3.00 V); mood makes no "
        "clear difference."
    )
    assert headline(replace(asked, comparisons=[height])).startswith("Sparks shows no clear diff")
    some = replace(asked, comparisons=[{**sparks, "units": 10}])
    assert headline(some).endswith("(3.00 V), for 8 of 10 virtual participants.")


def test_comparisons_say_what_n_is_and_why_there_is_no_p(source: ReportSource) -> None:
    about = {
        "factor": "mood", "by": {}, "measure": "sparks", "levels": ["calm", "wild"],
        "means": [12.0, 23.0], "n": 1, "unit": "user", "test": "wilcoxon", "p": None,
        "refused": "n = 1: one unit", "note": None, "difference": None,
    }  # fmt: skip
    by_round = about | {
        "unit": "round", "n": 10, "p": 0.002, "z": -2.803, "refused": None, "p_holm": 0.006,
        "family": 3, "difference": {"mean": -11.0, "low": -13.0, "high": -9.0}, "effect": -1.0,
        "effect_name": "rank-biserial", "note": "no sample of persons",
    }  # fmt: skip
    tested = replace(source, comparisons=[about, by_round])
    html = table_of_tests(tested)
    assert html is not None and "no p value: n = 1: one unit" in html
    assert "Z = -2.803" in html and "0.0020" in html and "0.0060 (3)" in html
    assert "12.00, 23.00" in html and "-11.00 [-13.00 to -9.00]" in html
    assert [text for text in sentences_of(tested, NOBODY) if "than in" in text] == [
        "Sparks is 11.00 V (48 %) lower in calm than in wild: 12.00 against 23.00 V, 95 % interval "
        "-13.00 to -9.00 V, 10 rounds of one policy (no sample of people)."
    ]


def test_no_difference_is_said_only_within_a_bound_that_the_study_states(
    source: ReportSource,
) -> None:
    open_ = {
        "factor": "mood", "by": {}, "measure": "sparks", "levels": ["calm", "wild"],
        "means": [2.78, 0.54], "n": 5, "units": 8, "unit": "person", "test": "paired-t", "p": 0.08,
        "refused": None, "note": None,
        "difference": {"mean": 2.24, "low": -0.49, "high": 4.97, "detectable": 3.5},
    }  # fmt: skip

    def first(**more: object) -> str:
        told = replace(source, comparisons=[{**open_, **more}], unit="person")
        return sentences_of(told, NOBODY)[0]

    assert first() == (
        "Inconclusive: sparks in calm and wild, 2.78 against 0.54 V, 95 % interval -0.49 to "
        "4.97 V, 5 of 8 virtual participants."
    )
    assert first(equivalence=4.0).startswith("Inconclusive"), "the interval reaches beyond it"
    assert first(equivalence=5.0).startswith(
        "No difference in sparks between calm and wild that is as large as 5.00 V: 2.78 against"
    )


def test_the_answer_stands_first_and_statistics_last(page: str) -> None:
    order = [
        'class="answer">Return: 22.0',
        'class="plot"',
        "<table",
        "<h2>What limits",
        "<h2>n and",
    ]
    assert (places := list(map(page.index, order))) == sorted(places)


def test_persons_differ_in_what_is_switched_on() -> None:
    """Delays need late senses, noise a noise model, head movement the reflex."""
    plain = EnvConfig.model_validate({"user": {"people": {}}})
    assert varied_in(plain) == ("size", "arm proportions", "strength", "cost of effort")
    some = EnvConfig.model_validate(
        {"user": {"people": {"vary": ["strength", "motor_noise"]}, "effort": {"weight": 0.0}}}
    )
    assert varied_in(some) == ("strength",)
    assert varied_in(EnvConfig.model_validate({"user": {"people": {"spread": 0.0}}})) == ()
