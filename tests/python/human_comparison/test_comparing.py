"""Users beside people: persons, totals, differences, fatigue."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_rounds import strikes

from sim2vr_harness.games.registry import behaviour_of
from sim2vr_harness.human_comparison.comparing import compare, left_out
from sim2vr_harness.human_comparison.contrasts import contrasts, fatigue_of
from sim2vr_harness.human_comparison.persons import RecordedPerson, measure_round, persons_of
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Source

WHACAMOLE = behaviour_of("whacamole")
EASY = ("constrained", "easy")


def people_of(onsets: dict[str, tuple[float, ...]]):
    """Persons with rounds of these onsets."""
    rounds = [
        measure_round(replace(strikes(onset_s=onset, seed=i), person=name), WHACAMOLE)
        for name, own in onsets.items()
        for i, onset in enumerate(own)
    ]
    return persons_of(rounds, WHACAMOLE)


PEOPLE = people_of({"p": (0.2,), "q": (0.25,), "r": (0.3,)})


def row_of(compared, measure: str):
    return next(row for row in compared.rows if row.measure.name == measure)


def test_a_user_inside_and_one_outside() -> None:
    good = row_of(compare("u", people_of({"u": (0.25,)}), PEOPLE, WHACAMOLE), "vm_latency")
    assert (good.inside, good.people) == (1.0, 3)
    assert good.distance == pytest.approx(0.0, abs=1e-6)
    assert (good.people_low, good.people_high) == (pytest.approx(0.18), pytest.approx(0.28))
    # People are 0.075, 0 and 0.075 from the mean of the others; the user is 0.2 from theirs.
    bad = row_of(compare("u", people_of({"u": (0.05,)}), PEOPLE, WHACAMOLE), "vm_latency")
    assert bad.inside == 0.0
    assert bad.distance == pytest.approx(0.2 / 0.05)
    assert (bad.spread, bad.persons_inside) == (None, None)
    # Latencies 0.18, 0.23 and 0.28 s: SD 0.05; two below, and itself counts half.
    third = row_of(compare("u", people_of({"r": (0.3,)}), PEOPLE, WHACAMOLE), "vm_latency")
    assert (third.percentile, third.deviations) == pytest.approx((250 / 3, 1.0))
    # Cells of a grid count as proportions of its cells.
    (person,) = people_of({"u": (0.25,)})[EASY]
    rates = person.cell_rates.copy()
    people = {EASY: [replace(person, name=n, cell_rates=rates) for n in "pqr"]}
    moved = rates + np.repeat([0.5, 0.0], [3, 6])
    compared = compare("u", {EASY: [replace(person, cell_rates=moved)]}, people, WHACAMOLE)
    assert row_of(compared, "cell_hit_rates").inside == pytest.approx(6 / 9)


def test_persons_of_a_user_are_no_rounds() -> None:
    """Two persons whose mean is inside, though neither is; one of them has played twice."""
    user = people_of({"0": (0.05, 0.05), "1": (0.45,)})
    row = row_of(compare("u", user, PEOPLE, WHACAMOLE), "tth_median")
    assert row.persons == 2
    assert row.value == pytest.approx((0.25 + 0.65) / 2), "each person counts once"
    assert row.spread == pytest.approx(0.4 / np.sqrt(2.0))
    assert (row.inside, row.persons_inside) == (1.0, 0.0)
    assert [person.rounds for person in user[EASY]] == [2, 1]


def test_left_out_person_is_compared_with_the_others_only() -> None:
    found = left_out(PEOPLE, WHACAMOLE)["constrained"]
    assert {name: row_of(each, "vm_latency").inside for name, each in found.items()} == {
        "p": 0.0,
        "q": 1.0,
        "r": 0.0,
    }
    assert row_of(found["q"], "vm_latency").people == 2
    assert left_out(people_of({"p": (0.2,), "q": (0.3,)}), WHACAMOLE) == {}


def person(name: str, **values: float) -> RecordedPerson:
    return RecordedPerson(
        name, values, {}, np.zeros(9), None, 1, {"misses": values.get("misses", 0.0)}
    )


def test_differences_are_person_by_person() -> None:
    people = {
        EASY: [person("p", hits=70.0), person("q", hits=80.0), person("r", hits=60.0)],
        ("constrained", "medium"): [
            person("q", hits=150.0),
            person("p", hits=150.0),
            person("r", hits=150.0),
        ],
    }
    user = {EASY: [person("u", hits=100.0)], ("constrained", "medium"): [person("u", hits=90.0)]}
    (row,) = [row for row in contrasts(user, people, WHACAMOLE) if row.measure == "hits"]
    assert (row.value, row.people_mean) == (-10.0, pytest.approx(80.0))
    assert (row.people_least, row.people_most) == (70.0, 90.0)
    # Student's t for 95 % and two degrees of freedom: 4.303; standard deviation 10.
    assert row.people_high - row.people_mean == pytest.approx(4.303 * 10 / np.sqrt(3), abs=0.01)
    assert not row.same_sign
    assert not row.within


def test_fatigue_by_placement() -> None:
    tired = {
        ("constrained", "low"): {"0": 0.20, "1": 0.22},
        ("constrained", "medium"): {"0": 0.21, "1": 0.19},
        ("constrained", "high"): {"0": 0.24, "1": 0.28},
    }
    rows, more = fatigue_of(tired, WHACAMOLE)
    assert {row.condition: row.mean for row in rows} == pytest.approx(
        {"low": 0.21, "medium": 0.20, "high": 0.26}
    )
    assert [each.contrast for each in more] == ["high - low", "high - medium"]
    assert more[0].mean == pytest.approx(0.05)
    assert more[0].effect == pytest.approx(0.05 / (0.02 / np.sqrt(2.0)))
    assert fatigue_of({}, WHACAMOLE) == ([], [])


def test_cells_and_differences_are_counted_over_both_rules() -> None:
    """Hits and misses, medium - easy: hits fall where people's rise; misses are 0 for both."""

    def source(name: str, groups: Any, persons: str, easy: float, medium: float) -> Source:
        hits = {"easy": easy, "medium": medium}
        cells = {
            (g, c): tuple(person(n, hits=hits[c] + i) for i, n in enumerate(persons))
            for g in groups
            for c in hits
        }
        return Source(name, cells)

    people = source("people", WHACAMOLE.groups, "pqr", 70.0, 150.0)
    one = source("a", ["constrained"], "u", 71.0, 60.0)
    other = source("b", ["unconstrained"], "u", 71.0, 151.0)
    report = ComparisonReport(WHACAMOLE, people, [one])
    assert [row.inside for row in report.rows()] == [1.0, 0.0]
    assert report.together is None
    assert [row.same_sign for row in report.contrasts(one)] == [False, True]
    report = ComparisonReport(WHACAMOLE, people, [one, other])
    assert report.together is not None
    assert (report.together.cells, report.together.inside) == (4, 0.75)
    assert [row.same_sign for row in report.contrasts(other)] == [True, True]
    # Between rules people's hits and misses are alike, ours of hits in easy (71 and 71)
    # and not in medium (60 and 151).
    assert {name for name, _ in report.group_contrasts()} == {"a and b"}
    assert [row.same_sign for _, row in report.group_contrasts()] == [True, True, False, True]
