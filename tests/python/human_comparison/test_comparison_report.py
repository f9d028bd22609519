"""Users beside people: ranges, cells of both rules, signs of differences, fatigue."""

import io
from dataclasses import replace

import numpy as np
import pytest
from made_rounds import strikes
from rich.console import Console

from sim2vr_harness.games.registry import behaviour_of
from sim2vr_harness.human_comparison.comparing import ComparisonRow
from sim2vr_harness.human_comparison.contrasts import fatigue_of
from sim2vr_harness.human_comparison.persons import Cell, RecordedPerson, measure_round, persons_of
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Source
from sim2vr_harness.human_comparison.tables import report_tables
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


def easy(user: Source, measure: str) -> ComparisonRow:
    (row,) = (
        row
        for row in ComparisonReport(WHACAMOLE, PEOPLE, [user]).rows()
        if (row.group, row.condition, row.measure.name) == (*EASY, measure)
    )
    return row


PEOPLE = Source("people", played({"p": 0.2, "q": 0.25, "r": 0.3}))


def test_who_waits_for_targets_and_who_does_not() -> None:
    late = Source("late", played({"0": 0.2, "1": 0.25}))
    early = Source("early", played({"0": 0.0}))
    latency = easy(late, "vm_latency")
    # The place shows 20 ms before the onset, at 10 % of the peak of straight lines on 20 Hz.
    assert latency.value == pytest.approx(0.205, abs=1e-6)
    assert latency.spread == pytest.approx(0.05 / np.sqrt(2.0), abs=1e-6)
    assert (latency.people_low, latency.people_high) == (pytest.approx(0.18), pytest.approx(0.28))
    assert (latency.inside, latency.persons_inside) == (1.0, 1.0)
    assert (easy(late, "strike_early").value, easy(late, "strike_early").inside) == (0.0, 1.0)
    assert easy(early, "vm_latency").inside == 0.0
    assert (easy(early, "strike_early").value, easy(early, "strike_early").inside) == (1.0, 0.0)


def test_a_mean_is_inside_though_one_person_is_not() -> None:
    latency = easy(Source("user", played({"0": 0.15, "1": 0.3})), "vm_latency")
    assert latency.value == pytest.approx(0.205, abs=1e-6)
    assert (latency.inside, latency.persons_inside) == (1.0, 0.5)


def test_cells_and_differences_are_counted_over_both_rules() -> None:
    cells = [(g, c) for g in WHACAMOLE.groups for c in ("easy", "medium")]
    hits = {"easy": 70.0, "medium": 150.0}
    people = Source(
        "people",
        made({(g, c): {n: {"hits": hits[c] + i} for i, n in enumerate("pqr")} for g, c in cells}),
    )
    one = Source(
        "a",
        made(
            {("constrained", c): {"u": {"hits": 71.0 if c == "easy" else 60.0}} for g, c in cells}
        ),
    )
    other = Source(
        "b", made({("unconstrained", c): {"u": {"hits": hits[c] + 1.0}} for g, c in cells})
    )
    report = ComparisonReport(WHACAMOLE, people, [one])
    assert [row.inside for row in report.rows()] == [1.0, 0.0]
    assert report.together is None
    # Hits and misses, medium - easy: hits fall where people's rise; misses are 0 for both.
    assert [row.same_sign for row in report.contrasts(one)] == [False, True]
    report = ComparisonReport(WHACAMOLE, people, [one, other])
    assert report.together is not None
    assert (report.together.cells, report.together.inside) == (4, 0.75)
    assert [row.same_sign for row in report.contrasts(other)] == [True, True]
    # Between rules people's hits and misses are alike, ours of hits in easy (71 and 71)
    # and not in medium (60 and 151).
    assert {name for name, _ in report.group_contrasts()} == {"a and b"}
    assert [row.same_sign for _, row in report.group_contrasts()] == [True, True, False, True]


def test_effect_sizes_by_hand() -> None:
    # Ranks 1, 2.5, 2.5, 4, one of the middle ones negative: W+ = 7.5 of 10, z = 2.5 over half the
    # root of 1 + 6.25 + 6.25 + 16; the pair without a difference counts in n.
    z = 2.5 / (np.sqrt(29.5) / 2.0)
    differences = np.array([0.1, -0.2, 0.2, 0.4, 0.0])
    assert wilcoxon(differences, np.zeros(5))["r"] == pytest.approx(z / np.sqrt(5.0))
    assert wilcoxon(-differences, np.zeros(5))["r"] == pytest.approx(-z / np.sqrt(5.0))


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
    assert [each.mean for each in report.fatigue(source)[1]] == pytest.approx([0.063, 0.053])
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(report_tables(report))
    text = " ".join(console.export_text().split())
    assert (
        "12 people, constrained (Borg's scale of exertion, 6 to 20, whole body, medians):" in text
    )
    assert "low 9, medium 9, high 9.5" in text
