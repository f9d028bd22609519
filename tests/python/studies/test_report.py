import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import strange_game

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.games.published import Published, PublishedPeople, published_of
from sim2vr_harness.human_comparison.agreement import (
    cell_name,
    fatigue_order,
    order_agreement,
)
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.studies.config import load_study
from sim2vr_harness.studies.plan import plan_of
from sim2vr_harness.studies.report import write_report
from sim2vr_harness.studies.report.body import load_of
from sim2vr_harness.studies.report.methods import PlayedBy, methods_of, varied_in
from sim2vr_harness.studies.report.sentences import (
    dropout_sentences,
    headline,
    sentences_of,
)
from sim2vr_harness.studies.report.source import ReportSource, read_source, summary_of
from sim2vr_harness.studies.report.strategy import depth_of
from sim2vr_harness.studies.report.tables import measure_table
from sim2vr_harness.studies.report.tables import test_table as table_of_tests

REPORT = Path(__file__).parents[3] / "python" / "sim2vr_harness" / "studies" / "report"
NOBODY = published_of("strange")


def test_an_unknown_game_is_told_by_its_data_dictionary(source: ReportSource) -> None:
    assert [group.label for group in source.groups] == list(strange_game.CONDITIONS)
    sparks = source.measure("sparks")
    assert sparks is not None and sparks.label == "Sparks" and sparks.unit == "V"


def test_a_single_user_s_spread_is_over_its_rounds(source: ReportSource) -> None:
    found = summary_of(source.groups[0], "sparks")  # 10 and 14
    assert found is not None and (found.mean, found.n, found.rounds) == (12.0, 1, 2)
    assert found.spread == pytest.approx(np.sqrt(8.0))


def test_persons_count_with_the_mean_of_their_rounds(source: ReportSource) -> None:
    group = source.groups[0]
    rows = group.episodes.iloc[[0, 0, 1]].copy()
    rows["person"], rows["sparks"] = [1, 1, 2], [1.0, 3.0, 8.0]
    found = summary_of(replace(group, episodes=rows), "sparks")
    assert found is not None and (found.mean, found.n, found.rounds) == (5.0, 2, 3)  # 2 and 8
    assert found.spread == pytest.approx(np.sqrt(18.0))


def test_depth_is_the_tool_s_distance_behind_the_items_plane(source: ReportSource) -> None:
    depths = depth_of(source.groups[0])
    assert len(depths) == 2
    np.testing.assert_allclose(depths[0].values_m, -0.1, atol=1e-6)
    assert "wand" in depths[0].what and "plane" in depths[0].what
    assert depths[0].times_s[0] == 0.0  # the log's first row is from before the round


def test_fatigue_of_a_round_is_the_one_at_its_end(source: ReportSource) -> None:
    load = load_of(source.groups[0])
    assert load is not None and load.fatigue and load.names == strange_game.MUSCLES
    np.testing.assert_allclose(load.values, [0.1, 0.3, 0.2], atol=1e-6)


def test_an_evaluation_is_described_without_a_claim(source: ReportSource) -> None:
    told = sentences_of(source, NOBODY)
    # The return is 2 sparks - 2: 22 and 44, rounds 18, 26 and 38, 50.
    assert told[0].startswith("Return: 22.0 in calm; 44.0 in wild <!--<script>; whether the groups")
    assert headline(source) == "Return: 22.0 in calm; 44.0 in wild <!--<script>."
    assert not any(word in " ".join(told) for word in ("highest", "lowest", "most", "fatigue"))
    assert any(text.startswith("n is 1") and "no p value" in text for text in told)


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
    assert "10 rounds of one policy (no sample of people)" in html
    assert "Z = -2.803" in html and "0.0020" in html and "0.0060 (3)" in html
    assert "1 trained user<" in html, "one is no plural"
    assert "12.00, 23.00" in html and "-11.00 [-13.00 to -9.00]" in html
    assert "calm – wild" in html
    directed = replace(source, comparisons=[by_round | {"alternative": "less"}])
    assert "calm &lt; wild" in str(table_of_tests(directed)), "one-sided tests say of what"
    assert [text for text in sentences_of(tested, NOBODY) if "than in" in text] == [
        "Sparks is 11.00 V (48 %) lower in calm than in wild: 12.00 against 23.00 V, 95 % interval "
        "-13.00 to -9.00 V, 10 rounds of one policy (no sample of people)."
    ]
    refused = replace(source, comparisons=[about])
    assert sentences_of(refused, NOBODY)[0] == (
        "Whether there is a difference was not tested: n = 1: one unit (Sparks in calm and wild)."
    )


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
        "4.97 V, 5 of 8 simulated persons."
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


def test_players_without_a_value_are_named_beside_the_others(source: ReportSource) -> None:
    group = source.groups[0]
    rows = group.episodes.iloc[[0, 0, 1, 1]].copy()
    rows["person"] = [1, 2, 3, 4]
    rows["sparks"] = [4.0, np.nan, 8.0, np.nan]
    rows["hit_rate"] = [0.5, 0.1, 0.7, 0.2]
    few = replace(source, groups=[replace(group, episodes=rows)], planned={"measures": ["sparks"]})
    (told,) = dropout_sentences(few)
    assert "2 of 4 have no sparks (person 2, person 4): none of their 2 rounds has" in told
    assert "they hit 15 % of the targets, the others 60 %" in told
    assert "6.00 ± 2.83 (n = 2 of 4)" in measure_table(few, NOBODY)


def test_the_methods_name_the_versions_of_the_recording(source: ReportSource) -> None:
    then = {"sim2vr-harness": "0.1", "python": "3.10.1", "mujoco": "3.1", "gymnasium": "1.0"}
    tested = replace(source, analysed_with={"scipy": "1.2"})
    tested.__dict__["recorded_with"] = [then, {**then, "mujoco": "3.2"}]
    text = methods_of(tested, [PlayedBy("somebody", 1000)])
    assert "in sim2vr 0.1, in lockstep" in text
    assert text.endswith("Software: Python 3.10.1, MuJoCo 3.1 and 3.2, SciPy 1.2.")
    old = replace(source, groups=source.groups)
    old.__dict__["recorded_with"] = []
    text = methods_of(old, [PlayedBy("somebody", 1000)])
    assert "in sim2vr, in lockstep" in text and "Software" not in text


def test_the_page_has_everything_in_it(page: str) -> None:
    assert len(page.encode()) < 10_000_000
    before, _, _ = page.partition("<script>")
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", before)
    assert "wild &lt;!--&lt;script&gt;" in page and "wild <!--<script>" not in before
    assert "@inproceedings{Fischer2024SIM2VR" in page and "contract" in page.lower()


def test_the_page_s_panels_show_all_groups(page: str) -> None:
    found = re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)
    assert not any("<" in panel for panel in found), "a browser would take it for markup"
    panels = list(map(json.loads, found))
    assert len(panels) == page.count('class="plot"') > 0
    names = {trace["name"] for panel in panels for trace in panel["data"] if trace.get("name")}
    assert set(strange_game.CONDITIONS) <= names
    assert any(trace["type"] == "scatter3d" for panel in panels for trace in panel["data"])


def test_what_cannot_be_reported_is_said_in_one_sentence(
    strange_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"no data/episodes\.parquet in it"):
        write_report(tmp_path)
    with pytest.raises(InputError, match=r"--out: got .*a file name that ends in \.html"):
        write_report(strange_folder, tmp_path / "report.pdf")


def test_reports_know_no_game() -> None:
    games = [p.name for p in (REPORT.parents[1] / "games").iterdir() if (p / "game.py").is_file()]
    assert len(games) > 2
    named = [
        (file.name, game)
        for file in REPORT.glob("*.*")
        for game in games
        if re.search(rf"\b{game}\b", file.read_text(encoding="utf-8"))
    ]
    assert named == []


@pytest.mark.parametrize("name", ["paper_whacamole", "paper_beats"])
def test_the_paper_s_studies_can_be_played(name: str) -> None:
    root = Path(__file__).parents[3]
    plan = plan_of(load_study(root / "studies" / f"{name}.yaml"))
    assert len(plan.cells) == {"paper_whacamole": 12, "paper_beats": 2}[name]
    by_round = [one for one in plan.study.comparisons if one.unit == "round"]
    assert by_round and len(by_round) < len(plan.study.comparisons)


def test_persons_differ_in_what_is_switched_on() -> None:
    """Delays need late senses, noise a noise model, head movement the reflex."""
    plain = EnvConfig.model_validate({"user": {"people": {}}})
    assert varied_in(plain) == ("size", "arm proportions", "strength", "cost of effort")
    whole = load_config("whacamole_people").env
    assert varied_in(whole) == (
        "size", "arm proportions", "strength", "visual delay", "proprioceptive delay",
        "motor noise", "cost of effort", "head movement",
    )  # fmt: skip
    some = EnvConfig.model_validate(
        {"user": {"people": {"vary": ["strength", "motor_noise"]}, "effort": {"weight": 0.0}}}
    )
    assert varied_in(some) == ("strength",)
    assert varied_in(EnvConfig.model_validate({"user": {"people": {"spread": 0.0}}})) == ()


def test_methods_name_what_persons_differ_in(source: ReportSource) -> None:
    persons = replace(source, unit="person")
    text = methods_of(persons, [PlayedBy("somebody", 1000, differs=("size", "strength"))])
    assert "Users were simulated persons (n = 1); they differ in size and strength." in text
    assert "delays" not in text and "noise" not in text
    assert "they do not differ" in methods_of(persons, [PlayedBy("somebody", 1, differs=())])
    assert "differ" not in methods_of(persons, [PlayedBy("somebody", 1)])


def test_warnings_of_the_evaluation_are_in_the_report(tmp_path: Path) -> None:
    folder = strange_game.write_tables(tmp_path)
    lines = {"calm": ["people = yes", "torso = yes (trained: no)"]}
    results = {
        name: {"unpractised": lines.get(name, []), "score_measure": "sparks"}
        for name in strange_game.CONDITIONS
    }
    (folder / "results.json").write_text(json.dumps(results))
    told = read_source(folder)
    texts = sentences_of(told, NOBODY)
    assert texts[0].startswith("Sparks: 12.00 V in calm; 23.00 V"), "the score of the task leads"
    assert texts[1:3] == [
        "The users in calm were never trained on people: their policies have learned with one "
        "average body.",
        "The users in calm were not trained for torso = yes (trained: no).",
    ]
    assert texts[1] in methods_of(told, [PlayedBy("somebody", 1000)])


def test_users_have_a_place_among_people(source: ReportSource) -> None:
    people = PublishedPeople(title="", file="", citation="", duration_s=4.0)
    rows = tuple({"condition": "calm", "return": value} for value in (10.0, 20.0, 30.0, 40.0))
    published = Published(people=people, rows=rows)
    # 22 is above two of four; people 25 +- 12.9.
    text = "percentile 50 of 4 people, -0.2 SD (calm: 22.0, people 25.0, SD 12.9)."
    assert any(one.endswith(text) for one in sentences_of(source, published))


def test_disagreement_with_people_is_said_in_words() -> None:
    assert fatigue_order(
        {"low": 0.2, "mid": 0.3, "high": 0.4}, {"low": 9, "mid": 9, "high": 10}
    ) == (
        "fatigue of users is high > mid > low, people rate high > low = mid: users and people "
        "disagree about low and mid."
    )
    assert fatigue_order({"low": 0.2, "high": 0.4}, {"low": 9, "high": 10}).endswith(
        ": both agree."
    )
    words, r = order_agreement(np.array([0.9, 0.5, 0.4]), np.array([0.4, 0.5, 0.9]))
    assert (words, r) == ("disagree", "Spearman's r = -1.00, n = 3")
    assert [cell_name(i, 3, 3) for i in (0, 4, 8)] == ["top left", "the middle", "bottom right"]


def test_axes_have_units_and_words_have_number(page: str, source: ReportSource) -> None:
    assert "0-1" not in page.partition("<script>")[0]
    assert '"0-1"' not in "".join(re.findall(r'/json">(.*?)</script>', page, re.S))
    fatigue = source.measure("max_fatigued")
    assert fatigue is not None and fatigue.heading == "Muscle fatigue (proportion)"
    one = replace(
        source, groups=[replace(g, episodes=g.episodes.iloc[:1]) for g in source.groups[:1]]
    )
    assert "1 rounds" not in methods_of(one, [PlayedBy("somebody", 1000)])
