"""Check results against expected values and against a baseline.

``evaluate`` and ``study`` share the checks. A group is a condition of an evaluation, or a cell of a
study.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from sim2vr_harness.base.errors import InputError, closest, printable, shown, unknown_name
from sim2vr_harness.base.files import file_name, read_json, write_atomically
from sim2vr_harness.client import Condition, GameFacts, Measure
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.play.exertion import fatigue_names
from sim2vr_harness.play.round import measures_of
from sim2vr_harness.statistics.intervals import Moments, welch_interval_of_moments

ENDS = ("diverged", "app_left", "app_failed")
"""Counts of rounds in the results of an evaluation."""

_SYNTAX = re.compile(
    r"(?:(?P<group>.+):)?\s*(?P<measure>[^\s:<>=!]+)\s*(?P<sign>>=|<=|==|>|<)\s*(?P<number>\S+)"
)
_FORM = "[CONDITION_OR_CELL:]MEASURE OP NUMBER with OP one of >= <= > < =="
_BASELINE = "results.json of an evaluation, or statistics.json of a study"
_SAME = 1e-9
"""Relative difference of numbers that count as equal."""
_FEWEST = 2
"""Least number of units whose spread can be estimated."""


def _equal(first: float, second: float) -> bool:
    return math.isclose(first, second, rel_tol=_SAME)


_COMPARE: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": _equal,
}


@dataclass(frozen=True)
class Estimate:
    """A measure in one group.

    Attributes:
        mean: Over units; None without a value.
        sd: Over units, ddof 1; None of fewer than two.
        n: Units with a value.
        unit: ``round``, ``person``, or the unit factor of a study.
    """

    mean: float | None
    sd: float | None
    n: int
    unit: str

    def __str__(self) -> str:
        mean = "no value" if self.mean is None else f"{self.mean:.4g}"
        return f"{mean} (n = {self.n}, unit: {self.unit})"


Results = Mapping[str, Mapping[str, Estimate]]
"""Group -> measure -> estimate."""


@dataclass(frozen=True)
class Planned:
    """Planned rounds and measures.

    Attributes:
        groups: Conditions or cells.
        known: Names of the measures that an expectation can name.
        compared: Measures that are compared with a baseline.
        complete: True if ``known`` has all names; an app that publishes no measures adds those of
            its log while it runs.
    """

    groups: tuple[str, ...]
    known: tuple[str, ...]
    compared: tuple[Measure, ...]
    complete: bool = True

    @classmethod
    def of_evaluation(
        cls, facts: GameFacts, conditions: Sequence[Condition], env: ResolvedEnv
    ) -> Planned:
        """Return the measures of an evaluation; fatigue of single muscles is not compared."""
        compared = measures_of(facts)
        names = (*(measure.name for measure in compared), *fatigue_names(env), *ENDS)
        groups = tuple(condition.name for condition in conditions)
        return cls(groups, names, compared, facts.published)


@dataclass(frozen=True)
class Expectation:
    """A bound of a measure.

    Attributes:
        text: As written.
        group: The only condition or cell that it is about; None: all.
        measure: Its name.
        number: The bound.
    """

    text: str
    group: str | None
    measure: str
    sign: str
    number: float

    @classmethod
    def of(cls, text: str) -> Expectation:
        """Parse ``[CONDITION_OR_CELL:]MEASURE OP NUMBER``.

        Raises:
            InputError: The text has another form, or the number is not finite.
        """
        found = _SYNTAX.fullmatch(text.strip())
        if found is None:
            raise InputError("--expect", shown(text), _FORM)
        try:
            number = float(found["number"])
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise InputError("--expect", shown(text), f"a finite number behind {found['sign']}")
        group = None if found["group"] is None else found["group"].strip()
        return cls(text.strip(), group, found["measure"], found["sign"], number)

    def check(self, group: str, estimate: Estimate) -> CheckResult:
        """Return whether an estimate of that group keeps the bound."""
        bound = f"{self.sign} {self.number:g}"
        kept = estimate.mean is not None and _COMPARE[self.sign](estimate.mean, self.number)
        verb = "has" if estimate.mean is None else "is"
        words = f"{group}: {self.measure} {verb} {estimate}, expected {bound}"
        return CheckResult(group, f"{self.measure} {bound}", None if kept else words)


@dataclass(frozen=True)
class CheckResult:
    """The result of one check in one group.

    Attributes:
        group: The condition or cell.
        name: The checked measure.
        failure: A sentence; None: not failed.
        skipped: Reason why nothing was checked; None: it was.
    """

    group: str
    name: str
    failure: str | None = None
    skipped: str | None = None


@dataclass
class Checks:
    """The checks of one command.

    Attributes:
        expectations: Bounds.
        baseline: Stored results; None: no comparison.
        source: The file of the baseline.
    """

    expectations: tuple[Expectation, ...] = ()
    baseline: Results | None = None
    source: str = ""
    _planned: Planned | None = field(default=None, init=False)

    @classmethod
    def of(cls, expect: Sequence[str], against: Path | None) -> Checks:
        """Parse expectations and read the baseline.

        Raises:
            InputError: An expectation has another form, or the file has no such results.
        """
        expectations = tuple(Expectation.of(text) for text in expect)
        if against is None:
            return cls(expectations)
        content = read_json(against, _BASELINE)
        try:
            summaries = content.get("summaries")
            found = of_study(summaries) if isinstance(summaries, list) else of_evaluation(content)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InputError(file_name(against), "JSON of another form", _BASELINE) from error
        if not any(found.values()):
            raise InputError(file_name(against), "no measure", _BASELINE)
        return cls(expectations, found, file_name(against))

    def prepare(self, planned: Planned) -> None:
        """Check names before anything is played.

        Raises:
            InputError: No such measure, condition or cell will be played, or the baseline lacks a
                condition or cell.
        """
        for one in self.expectations:
            if one.group is not None and one.group not in planned.groups:
                raise unknown_name("--expect", one.group, planned.groups)
            if planned.complete and one.measure not in planned.known:
                raise _unknown_measure(one.measure, planned.known)
        if self.baseline is not None:
            for group in planned.groups:
                if group not in self.baseline:
                    has = ", ".join(self.baseline) or "none"
                    expected = f"all conditions or cells that are played; it has {has}"
                    raise InputError("--against", f"{self.source} without {group!r}", expected)
        self._planned = planned

    def run(self, results: Results) -> list[CheckResult]:
        """Return the result of every check in every group, expectations first.

        Args:
            results: Of all groups that were planned.

        Raises:
            InputError: An app that publishes no measures has no such measure.
        """
        planned = self._planned
        if planned is None:
            raise RuntimeError("prepare() has not been called")
        found = []
        for one in self.expectations:
            for group in planned.groups if one.group is None else (one.group,):
                if one.measure not in results[group]:
                    raise _unknown_measure(one.measure, results[group])
                found.append(one.check(group, results[group][one.measure]))
        if self.baseline is not None:
            for group in planned.groups:
                found += _compared(planned.compared, group, results[group], self.baseline[group])
        return found


def _unknown_measure(name: str, known: Iterable[str]) -> InputError:
    """Name the nearest of the measures, which are too many for a sentence; all without one."""
    best = closest(name, known)
    if best is None:
        return unknown_name("--expect", name, known)
    return InputError("--expect", repr(name), f"a measure (did you mean {best!r}?)")


def _compared(
    measures: Sequence[Measure],
    group: str,
    results: Mapping[str, Estimate],
    baseline: Mapping[str, Estimate],
) -> list[CheckResult]:
    """Compare the measures of a group that have a good direction with those of the baseline."""
    found = [
        _not_worse(measure, group, results[measure.name], baseline[measure.name])
        for measure in measures
        if measure.better != "none"
        and all(measure.name in one for one in (results, baseline))
        and any(one[measure.name].n for one in (results, baseline))
    ]
    if all(one.skipped for one in found):
        why = found[0].skipped if found else "no measure in common"
        failure = f"{group}: nothing can be compared with the baseline ({why})"
        found.append(CheckResult(group, "comparison with the baseline", failure))
    return found


def _not_worse(measure: Measure, group: str, now: Estimate, before: Estimate) -> CheckResult:
    """Fail if the 95 % Welch interval of the loss lies above 0."""
    name = f"{measure.name} against the baseline"
    if now.unit != before.unit:
        why = f"units are {now.unit} and in the baseline {before.unit}"
        return CheckResult(group, name, skipped=why)
    first, second = _moments(now), _moments(before)
    if first is None or second is None:
        why = f"n = {now.n} and in the baseline {before.n}, at least {_FEWEST} are needed"
        return CheckResult(group, name, skipped=why)
    if _equal(first.mean, second.mean):
        return CheckResult(group, name)
    worse, better = (second, first) if measure.better == "higher" else (first, second)
    low, high = welch_interval_of_moments(worse, better)
    if low <= 0.0:
        return CheckResult(group, name)
    loss = worse.mean - better.mean
    return CheckResult(
        group,
        name,
        f"{group}: {measure.name} is {now}, worse than the baseline {before} by {loss:.4g} with "
        f"95 % interval {low:.4g} to {high:.4g}, expected an interval that includes 0",
    )


def _moments(estimate: Estimate) -> Moments | None:
    if estimate.mean is None or estimate.sd is None or estimate.n < _FEWEST:
        return None
    return Moments(estimate.mean, estimate.sd, estimate.n)


def of_evaluation(summaries: Mapping[str, Mapping[str, Any]]) -> Results:
    """Return the estimates of an evaluation's summaries, over participants where they differ."""
    return {condition: _of_summary(summary) for condition, summary in summaries.items()}


def _of_summary(summary: Mapping[str, Any]) -> dict[str, Estimate]:
    rounds = summary["rounds"]
    person = "persons" in summary
    found = {}
    for name in (key.removesuffix("_sd") for key in summary if key.endswith("_sd")):
        known = [one for one in rounds if one.get(name) is not None]
        n = len({one["person"] for one in known}) if person else len(known)
        unit = "person" if person else "round"
        found[name] = Estimate(_number(summary[name]), _number(summary[f"{name}_sd"]), n, unit)
    for name in ENDS:
        found[name] = Estimate(float(summary[name]), None, len(rounds), "round")
    return found


def of_study(summaries: Sequence[Mapping[str, Any]]) -> Results:
    """Return the estimates of a study's ``summaries``.

    Of one user there is no spread over units: its rounds are the units then.
    """
    found: dict[str, dict[str, Estimate]] = {}
    for row in summaries:
        n, sd, unit = int(row["n"]), row["sd"], str(row["unit"])
        if n == 1 and unit != "person":
            n, sd, unit = int(row["rounds"]), row["rounds_sd"], "round"
        estimate = Estimate(_number(row["mean"]), _number(sd), n, unit)
        found.setdefault(study_group(row["levels"]), {})[str(row["measure"])] = estimate
    return found


def study_group(levels: Mapping[str, str]) -> str:
    """Return the name of a study's cell, its unit factor left out: ``difficulty=easy,life=0.5``."""
    return ",".join(f"{factor}={label}" for factor, label in levels.items()) or "all"


def _number(value: Any) -> float | None:
    if value is not None and not math.isfinite(value):
        raise ValueError("not finite")
    return None if value is None else float(value)


# --- JUnit XML ------------------------------------------------------------------------------------


def write_junit(file: Path, suite: str, results: Sequence[CheckResult], seconds: float) -> None:
    """Write a test suite with a test case per check and condition or cell.

    Args:
        file: To write; its folder is made.
        suite: Name of the suite.
        results: Of the checks.
        seconds: The time that playing and checking took.
    """
    counts = {
        "tests": len(results),
        "failures": sum(one.failure is not None for one in results),
        "errors": 0,
        "skipped": sum(one.skipped is not None for one in results),
    }
    root = ElementTree.Element("testsuites")
    about = {key: str(count) for key, count in counts.items()} | {"time": f"{seconds:.3f}"}
    cases = ElementTree.SubElement(root, "testsuite", {"name": printable(suite), **about})
    for one in results:
        names = {"classname": printable(one.group), "name": printable(one.name), "time": "0"}
        case = ElementTree.SubElement(cases, "testcase", names)
        if one.failure is not None:
            message = printable(one.failure)
            failure = ElementTree.SubElement(case, "failure", {"message": message, "type": "check"})
            failure.text = message
        elif one.skipped is not None:
            ElementTree.SubElement(case, "skipped", {"message": printable(one.skipped)})
    ElementTree.indent(root)
    content = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    write_atomically(file, content + b"\n")
