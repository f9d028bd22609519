"""Checks of results: bounds, and comparisons with a baseline."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import Measure
from sim2vr_harness.evaluation.expectations import (
    CheckResult,
    Checks,
    Expectation,
    Planned,
    of_evaluation,
    write_junit,
)

HITS = Measure("hits", "Hits", better="higher")
ERROR = Measure("error_m", "Error", better="lower")
HEIGHT = Measure("height_m", "Height")
PLANNED = Planned(("easy", "hard"), ("hits", "error_m", "height_m"), (HITS, ERROR, HEIGHT))


def summary(persons: Sequence[int] | None = None, **values: Sequence[float | None]) -> dict:
    """An evaluation's summary of one condition, of values over rounds."""
    rounds = [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]
    found: dict[str, Any] = {"episodes": len(rounds), "diverged": 0, "app_left": 0}
    found["app_failed"] = 1
    for name, given in values.items():
        of_unit: dict[int, list[float]] = {}
        for number, value in enumerate(given):
            if value is not None:
                of_unit.setdefault(persons[number] if persons else number, []).append(value)
        means = [float(np.mean(each)) for each in of_unit.values()]
        found[name] = float(np.mean(means)) if means else None
        found[f"{name}_sd"] = float(np.std(means, ddof=1)) if len(means) > 1 else None
    if persons:
        found["persons"] = len(set(persons))
        rounds = [one | {"person": who} for one, who in zip(rounds, persons, strict=True)]
    return found | {"rounds": rounds}


def compare(tmp_path: Path, now: dict[str, Any], before: dict[str, Any]) -> list[CheckResult]:
    """Compare one condition with a stored one."""
    file = tmp_path / "results.json"
    file.write_text(json.dumps({"easy": before}))
    checks = Checks.of([], file)
    checks.prepare(Planned(("easy",), PLANNED.known, PLANNED.compared))
    return checks.run(of_evaluation({"easy": now}))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fatigue.ANC_r<=1e-1", (None, "fatigue.ANC_r", "<=", 0.1)),
        ("size=big,life=0.5: hits == -4", ("size=big,life=0.5", "hits", "==", -4.0)),
        ("hits", "[CONDITION_OR_CELL:]MEAS"),
        ("hits => 1", "[CONDITION_OR_CELL:]MEAS"),
        (">= 1", "[CONDITION_OR_CELL:]MEAS"),
        ("hits >= 80%", "a finite number behind >="),
        ("hits >= nan", "a finite number behind >="),
    ],
)
def test_expectations_are_parsed(text: str, expected: Any) -> None:
    if isinstance(expected, tuple):
        assert Expectation.of(text) == Expectation(text, *expected)
        return
    with pytest.raises(InputError, match=rf"^--expect: got .*, expected {re.escape(expected)}"):
        Expectation.of(text)


@pytest.mark.parametrize(
    ("text", "kept"),
    [(">= 3", True), ("> 3", False), ("<= 3", True), ("< 3", False), ("== 3", True), ("> 2", True)],
)
def test_bounds_hold_of_the_mean(text: str, kept: bool) -> None:
    checks = Checks.of([f"easy:hits {text}"], None)
    checks.prepare(PLANNED)
    found = checks.run(of_evaluation({"easy": summary(hits=[2.0, 4.0, None]), "hard": summary()}))
    expected = f"easy: hits is 3 (n = 2, unit: round), expected {text}"
    assert [one.failure for one in found] == [None if kept else expected]


def test_every_condition_is_checked_and_no_value_fails() -> None:
    checks = Checks.of(["hits >= 0", "app_failed == 0"], None)
    checks.prepare(Planned(("easy", "hard"), ("hits", "app_failed"), (HITS,)))
    results = of_evaluation({"easy": summary(hits=[1.0, 2.0]), "hard": summary(hits=[None, None])})
    assert [(one.group, one.failure) for one in checks.run(results)] == [
        ("easy", None),
        ("hard", "hard: hits has no value (n = 0, unit: round), expected >= 0"),
        ("easy", "easy: app_failed is 1 (n = 2, unit: round), expected == 0"),
        ("hard", "hard: app_failed is 1 (n = 2, unit: round), expected == 0"),
    ]


def test_names_are_checked_before_anything_is_played() -> None:
    with pytest.raises(
        InputError, match=r"got 'hit', expected a measure \(did you mean 'hits'\?\)$"
    ):
        Checks.of(["hit > 1"], None).prepare(PLANNED)
    with pytest.raises(InputError, match=r"got 'harder', .*\(did you mean 'hard'\?\)"):
        Checks.of(["harder:hits > 1"], None).prepare(PLANNED)
    # An app that publishes no measures has those of its log, once it has run.
    later = Checks.of(["hit > 1"], None)
    later.prepare(Planned(("easy",), ("return",), (), complete=False))
    with pytest.raises(InputError, match=r"did you mean 'hits'"):
        later.run(of_evaluation({"easy": summary(hits=[1.0])}))


@pytest.mark.parametrize(("measure", "sign"), [("hits", 1.0), ("error_m", -1.0)])
@pytest.mark.parametrize(("loss", "fails"), [(2.2, False), (2.3, True), (-9.0, False)])
def test_worse_by_more_than_noise_fails(
    tmp_path: Path, measure: str, sign: float, loss: float, fails: bool
) -> None:
    """SD 1 and n = 3 each: the interval is loss +- 2.776445 sqrt(2/3) = loss +- 2.267."""
    before, now = [9.0, 10.0, 11.0], [9.0 - sign * loss, 10.0 - sign * loss, 11.0 - sign * loss]
    found = compare(tmp_path, summary(**{measure: now}), summary(**{measure: before}))
    assert [one.failure is not None for one in found] == [fails]
    if fails:
        low, high = 2.3 - 2.26696, 2.3 + 2.26696
        assert found[0].failure == (
            f"easy: {measure} is {10.0 - sign * 2.3:.4g} (n = 3, unit: round), worse than the "
            f"baseline 10 (n = 3, unit: round) by 2.3 with 95 % interval {low:.4g} to {high:.4g}, "
            "expected an interval that includes 0"
        )


def test_persons_are_the_units_where_persons_differ(tmp_path: Path) -> None:
    """Two rounds each of two persons: n = 2, not 4."""
    who = [0, 0, 1, 1]
    now, before = summary(who, hits=[1.0, 1.0, 2.0, 2.0]), summary(who, hits=[9.0, 9.0, 8.0, 8.0])
    (found,) = compare(tmp_path, now, before)
    assert found.failure is not None and "1.5 (n = 2, unit: person)" in found.failure
    low, high = stats.ttest_ind([9.0, 8.0], [1.0, 2.0], equal_var=False).confidence_interval(0.95)
    assert f"by 7 with 95 % interval {low:.4g} to {high:.4g}" in found.failure


def test_what_cannot_be_compared_is_skipped_and_nothing_at_all_fails(tmp_path: Path) -> None:
    one_round = compare(
        tmp_path,
        summary(hits=[1.0, 1.0], error_m=[0.1, None]),
        summary(hits=[1.0, 1.0], error_m=[0.1, 0.2]),
    )
    assert [(one.failure, one.skipped) for one in one_round] == [
        (None, None),
        (None, "n = 1 and in the baseline 2, at least 2 are needed"),
    ]
    (same,) = compare(tmp_path, summary(hits=[4.0, 4.0]), summary(hits=[4.0, 4.0]))
    assert (same.failure, same.skipped) == (None, None)
    (lower,) = compare(tmp_path, summary(hits=[3.0, 3.0]), summary(hits=[4.0, 4.0]))
    assert lower.failure is not None, "without spread every difference is one"
    with pytest.raises(InputError, match=r"--against: got .* without 'hard', .*; it has easy$"):
        Checks.of([], tmp_path / "results.json").prepare(PLANNED)
    units = compare(tmp_path, summary([0, 1], hits=[1.0, 2.0]), summary(hits=[1.0, 2.0]))
    assert units[0].skipped == "units are person and in the baseline round"
    assert units[1].failure is not None and "nothing can be compared" in units[1].failure


@pytest.mark.parametrize(
    "content",
    ['{"easy": {"hits_sd": 1}}', '{"summaries": [{}]}', "[]", "{"],
)
def test_other_files_are_no_baseline(tmp_path: Path, content: str) -> None:
    file = tmp_path / "other.json"
    file.write_text(content)
    with pytest.raises(InputError, match=r"expected results.json of an evaluation, or statistics"):
        Checks.of([], file)


def test_junit_has_a_case_per_check(tmp_path: Path) -> None:
    results = [
        CheckResult("easy", "hits >= 1"),
        CheckResult("<hard>", "hits >= 1", 'hard: "hits" & \x00 is 0'),
        CheckResult("hard", "error_m against the baseline", skipped="n = 1"),
    ]
    write_junit(tmp_path / "new" / "out.xml", "sim2vr-harness evaluate", results, 1.25)
    (suite,) = ElementTree.parse(tmp_path / "new" / "out.xml").getroot()
    assert suite.tag == "testsuite"
    assert suite.attrib == {
        "name": "sim2vr-harness evaluate", "tests": "3", "failures": "1", "errors": "0",
        "skipped": "1", "time": "1.250",
    }  # fmt: skip
    assert [case.tag for case in suite] == ["testcase"] * 3
    assert [(case.get("classname"), [child.tag for child in case]) for case in suite] == [
        ("easy", []), ("<hard>", ["failure"]), ("hard", ["skipped"]),
    ]  # fmt: skip
    assert suite[1][0].get("message") == 'hard: "hits" & \\x00 is 0'
