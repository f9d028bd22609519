"""What is asked of users who are to pass for people."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from made_rounds import strikes
from rich.console import Console

from sim2vr_harness.games.behaviour import Bounds
from sim2vr_harness.games.registry import behaviour_of
from sim2vr_harness.human_comparison.contrasts import fatigue_of
from sim2vr_harness.human_comparison.files import as_json
from sim2vr_harness.human_comparison.goals import GoalRow
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson, measure_round, persons_of
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Source
from sim2vr_harness.human_comparison.tables import report_tables
from sim2vr_harness.statistics.intervals import effect_interval
from sim2vr_harness.statistics.significance import wilcoxon

WHACAMOLE = behaviour_of("whacamole")
EASY = ("constrained", "easy")


def played(onsets: dict[str, float]) -> dict[Cell, tuple[RecordedPerson, ...]]:
    """A round each, struck so long after the spawn."""
    rounds = [
        measure_round(replace(strikes(onset_s=onset, seed=i), person=name), WHACAMOLE)
        for i, (name, onset) in enumerate(onsets.items())
    ]
    return persons_of(rounds, WHACAMOLE)


def made(cells: dict[Cell, dict[str, dict[str, float]]]) -> dict[Cell, tuple[RecordedPerson, ...]]:
    """Condition -> person -> numbers, as if measured."""
    return {
        cell: tuple(
            RecordedPerson(
                name, values, {}, np.zeros(9), None, 1, {"misses": values.get("misses", 0.0)}
            )
            for name, values in persons.items()
        )
        for cell, persons in cells.items()
    }


def rows_of(report: ComparisonReport) -> dict[tuple[str, str], GoalRow]:
    return {(row.group, row.what): row for row in report.goals}


PEOPLE = Source("people", played({"p": 0.2, "q": 0.25, "r": 0.3}))


def test_who_waits_for_targets_and_who_does_not() -> None:
    late = Source("late", played({"0": 0.2, "1": 0.25}))
    early = Source("early", played({"0": 0.0}))
    rows = rows_of(ComparisonReport(WHACAMOLE, PEOPLE, [late]))
    latency = rows["constrained", "vm_latency, easy (s)"]
    # The place shows 20 ms before the onset, at 10 % of the peak of straight lines on 20 Hz.
    assert latency.value == pytest.approx(0.205, abs=1e-6)
    assert latency.spread == pytest.approx(0.05 / np.sqrt(2.0), abs=1e-6)
    assert (latency.bar, latency.bar_met) == ("0.17 to 0.22", True)
    assert (latency.aim, latency.aim_met) == ("each", True)
    assert (latency.people_low, latency.people_high) == (pytest.approx(0.18), pytest.approx(0.28))
    strikes_ = rows["constrained", "strike_early, easy"]
    assert (strikes_.value, strikes_.bar_met, strikes_.aim_met) == (0.0, True, True)
    rows = rows_of(ComparisonReport(WHACAMOLE, PEOPLE, [early]))
    assert rows["constrained", "vm_latency, easy (s)"].bar_met is False
    strikes_ = rows["constrained", "strike_early, easy"]
    assert (strikes_.value, strikes_.bar_met, strikes_.aim_met) == (1.0, False, False)


def test_one_person_out_of_range_misses_the_aim_and_not_the_bar() -> None:
    user = Source("user", played({"0": 0.15, "1": 0.3}))
    latency = rows_of(ComparisonReport(WHACAMOLE, PEOPLE, [user]))[
        "constrained", "vm_latency, easy (s)"
    ]
    assert latency.value == pytest.approx(0.205, abs=1e-6)
    assert (latency.bar_met, latency.aim_met) == (True, False)


def test_cells_and_differences_are_counted_over_both_rules() -> None:
    cells = [(g, c) for g in WHACAMOLE.groups for c in ("easy", "medium")]
    hits = {"easy": 70.0, "medium": 150.0}
    people = made(
        {(g, c): {n: {"hits": hits[c] + i} for i, n in enumerate("pqr")} for g, c in cells}
    )
    constrained = made(
        {("constrained", c): {"u": {"hits": 71.0 if c == "easy" else 60.0}} for g, c in cells}
    )
    other = made({("unconstrained", c): {"u": {"hits": hits[c] + 1.0}} for g, c in cells})
    report = ComparisonReport(WHACAMOLE, Source("people", people), [Source("a", constrained)])
    rows = rows_of(report)
    assert rows["", "inside people's range, of 2 cells"].value == 0.5
    assert rows["", "inside people's range, of 2 cells"].bar_met is False
    # Hits and misses, medium - easy: hits fall where people's rise; misses are 0 for both.
    assert rows["", "people's sign, of 2 differences"].value == 0.5
    report = ComparisonReport(
        WHACAMOLE, Source("people", people), [Source("a", constrained), Source("b", other)]
    )
    rows = rows_of(report)
    assert rows["", "inside people's range, of 4 cells"].value == 0.75
    assert rows["", "inside people's range, of 4 cells"].aim_met is True
    # Twice medium - easy and twice the rules, of hits and misses: hits are wrong in one of the
    # first; between rules people's hits and misses are alike, ours in easy and not in medium.
    assert rows["", "people's sign, of 8 differences"].value == pytest.approx(6 / 8)
    assert report.goals[0].user == "a and b"


def test_rates_of_every_condition_and_their_spread() -> None:
    people = {n: {"hit_rate": rate} for n, rate in {"p": 0.8, "q": 0.9, "r": 1.0}.items()}
    cells = {("constrained", condition): people for condition in ("easy", "hard")}
    # Standard deviation .1; F(11, 2) leaves .23 to 39.4 of its square's ratio: .05 to .63.
    wide = {str(i): {"hit_rate": 0.9 + (0.1 if i % 2 else -0.1)} for i in range(12)}
    narrow = {str(i): {"hit_rate": 0.7 + (0.01 if i % 2 else -0.01)} for i in range(12)}
    own = {("constrained", "easy"): wide, ("constrained", "hard"): narrow}
    rows = rows_of(
        ComparisonReport(WHACAMOLE, Source("people", made(cells)), [Source("u", made(own))])
    )
    inside = rows["constrained", "hit_rate in range, of 2 conditions"]
    assert (inside.value, inside.bar_met) == (0.5, False)
    spread = rows["constrained", "its spread as people's, of 2 conditions"]
    assert (spread.value, spread.aim_met) == (0.5, False)


def test_effect_sizes_by_hand() -> None:
    # Ranks 1, 2.5, 2.5, 4, one of the middle ones negative: W+ = 7.5 of 10, z = 2.5 over half the
    # root of 1 + 6.25 + 6.25 + 16; the pair without a difference counts in n.
    z = 2.5 / (np.sqrt(29.5) / 2.0)
    differences = np.array([0.1, -0.2, 0.2, 0.4, 0.0])
    assert wilcoxon(differences, np.zeros(5))["r"] == pytest.approx(z / np.sqrt(5.0))
    assert wilcoxon(-differences, np.zeros(5))["r"] == pytest.approx(-z / np.sqrt(5.0))
    # People's low and high: z = 2.213 of twelve, r = .639; atanh .756 +- .653.
    assert effect_interval(2.213, 12) == pytest.approx((0.103, 0.887), abs=1e-3)


def test_the_high_area_tires_most() -> None:
    own: dict[Cell, dict[str, float]] = {
        ("constrained", c): {str(i): value + slope * i for i in range(4)}
        for c, value, slope in (("low", 0.2, 0.001), ("medium", 0.21, 0.001), ("high", 0.26, 0.003))
    }
    _, more = fatigue_of(own, WHACAMOLE)
    assert [(each.contrast, each.rank_effect) for each in more] == [
        ("high - low", pytest.approx(5.0 / np.sqrt(7.5) / 2.0)),  # all ranks: z = 1.83 of four
        ("high - medium", pytest.approx(5.0 / np.sqrt(7.5) / 2.0)),
    ]
    cells = {("constrained", c): {n: {"hits": 1.0} for n in "pqr"} for c in ("low", "high")}
    user = {cell: {str(i): {"hits": 1.0} for i in range(4)} for cell in cells}
    source = Source("u", made(user), own)
    report = ComparisonReport(WHACAMOLE, Source("people", made(cells)), [source])
    rows = [row for row in report.goals if "fatigue" in row.what or "effect" in row.what]
    assert [row.what for row in rows] == [
        "fatigue, high - low",
        "its effect size, z / sqrt(n)",
        "fatigue, high - medium",
        "its effect size, z / sqrt(n)",
    ]
    assert [row.bar_met for row in rows] == [True, None, True, None]
    assert rows[0].value == pytest.approx(0.063)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(report_tables(report))
    text = " ".join(console.export_text().split())
    assert (
        "12 people, constrained (Borg's scale of exertion, 6 to 20, whole body, medians):" in text
    )
    assert "low 9, medium 9, high 9.5" in text
    assert len(as_json(report)["goals"]) == len(report.goals)


def test_bounds_say_what_they_are() -> None:
    assert [str(b) for b in (Bounds(high=0.27), Bounds(low=1.5), Bounds(0.17, 0.22))] == [
        "<= 0.27",
        ">= 1.5",
        "0.17 to 0.22",
    ]
    assert Bounds(0.17, 0.22).hold(0.22)
    assert not Bounds(0.17, 0.22).hold(0.2201)
    assert not Bounds(low=1.5).hold(1.49)
