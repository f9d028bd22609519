"""The summary of a report: answers to what was asked, each with its numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sim2vr_harness.base.errors import counted
from sim2vr_harness.client import Measure
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.numbers import MOST_GROUPS, in_words, some_of, summary_of
from sim2vr_harness.studies.report.people import people_sentences
from sim2vr_harness.studies.report.source import ReportSource

_MOST_TESTS = 6
"""Of a kind that have a sentence each; the table of tests has all."""
"""That are named one by one; of more the table has the numbers."""
_SIGNIFICANT = 0.05
_TESTS = {
    "paired-t": "paired t test",
    "welch-t": "Welch's t test",
    "wilcoxon": "Wilcoxon's signed-rank test",
    "mann-whitney": "Mann and Whitney's test",
    "friedman": "Friedman's test",
    "kruskal-wallis": "Kruskal and Wallis' test",
    "mixed": "linear mixed model",
}


@dataclass(frozen=True)
class Sentence:
    """A statement, and the numbers behind it."""

    text: str
    numbers: str


def sentences_of(source: ReportSource, published: Published) -> list[Sentence]:
    """Return the summary: the answer to the title first, only requested measures."""
    return [
        *(_answers(source) if source.comparisons else _described(source)),
        *(Sentence(*words) for words in people_sentences(source, published, _asked(source))),
        *(Sentence(text, "") for text in warnings_of(source)),
        n_sentence(source),
    ]


def warnings_of(source: ReportSource) -> Iterator[str]:
    """Yield what the users were not trained for, a sentence each."""
    for line, labels in source.unpractised.items():
        where = "" if len(labels) == len(source.groups) else f" in {_groups(labels, len(labels))}"
        if line.startswith(("people = yes", "people: yes")):
            yield (
                f"The users{where} were never trained on people: their policies have learned with "
                "one average body."
            )
        else:
            yield f"The users{where} were not trained for {line}."


def _asked(source: ReportSource) -> list[Measure]:
    """Return the requested measures; the score if the study names none."""
    named = list(source.planned.get("measures") or ())
    for comparison in source.planned.get("comparisons", ()):
        named += comparison.get("measures") or ()
    found = [m for name in dict.fromkeys(named) if (m := source.measure(str(name)))]
    return found or [source.score]


def n_sentence(source: ReportSource) -> Sentence:
    """What n is, and what it allows to say."""
    n, rounds = len(source.units), sum(len(group.episodes) for group in source.groups)
    who = {"person": "simulated person", "user": "trained user"}.get(source.unit)
    what = f"levels of {source.unit}" if who is None else counted(n, who).partition(" ")[2]
    if n == 1:
        text = (
            f"n is 1: one {who or f'level of {source.unit}'}. Its rounds show how much it varies, "
            "not how much other users or people do, so there is no p value for differences between "
            "conditions."
        )
    elif source.unit == "user":
        text = (
            f"n is {n} trained users, each in its own right: differences between them are shown, "
            "but not whether another training of the same kind would have the same."
        )
    else:
        text = f"n is {n} {what}; rounds of one of them count as one value, their mean."
    groups = counted(len(source.groups), "group")
    return Sentence(text, f"n = {n}, {counted(rounds, 'round')} in {groups}")


def _described(source: ReportSource) -> Iterator[Sentence]:
    """Describe the requested measures where nothing was compared."""
    for measure in _asked(source):
        found = [(g, s) for g in source.groups if (s := summary_of(g, measure.name)) is not None]
        if not found:
            continue
        told = [f"{in_words(s.mean, measure)} in {group.label}" for group, s in found]
        text = f"{measure.label}: {some_of(told)}."
        if len(found) > 1:
            text += " No comparison was requested: whether the groups differ was not tested."
        spreads = [
            "" if s.spread is None else f"SD {s.spread:.{measure.digits}f}, " for _, s in found
        ]
        yield Sentence(
            text,
            some_of([
                f"{group.label}: {spread}{counted(s.n, 'unit')}, {counted(s.rounds, 'round')}"
                for (group, s), spread in zip(found, spreads, strict=True)
            ]),
        )  # fmt: skip


def _answers(source: ReportSource) -> Iterator[Sentence]:
    """Answer the comparisons: the first requested one, then differences, then none."""
    results = sorted(source.comparisons, key=lambda r: not source.leads(str(r["measure"])))
    questions = [one for result in results for one in _questions(result)]
    different = [one for one in questions[1:] if _p(one) < _SIGNIFICANT]
    alike = [one for one in questions[1:] if _p(one) >= _SIGNIFICANT]
    for one in (*questions[:1], *different[:_MOST_TESTS], *alike[:_MOST_TESTS]):
        yield _answer(one, source.measure(str(one["measure"])))
    for part, words in ((different, "with"), (alike, "without")):
        if len(part) > _MOST_TESTS:
            more = counted(len(part) - _MOST_TESTS, "more comparison")
            yield Sentence(f"{more} {words} a difference: see the table of tests.", "")
    refused: dict[str, list[str]] = {}
    for result in results:
        if result.get("refused"):
            label = _label(result, source.measure(str(result["measure"])))
            question = f"{label} in {_list(result['levels'])}{place_of(result)}"
            refused.setdefault(str(result["refused"]), []).append(question)
    for reason, unanswered in refused.items():
        text = f"Whether there is a difference was not tested: {reason}."
        yield Sentence(text, some_of(unanswered))


def _questions(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """A result with a p; of a mixed model its effects, in the form of results."""
    if result.get("effects"):
        shared = {key: result[key] for key in ("measure", "by", "unit", "n", "test", "levels")}
        return [
            {**shared, **effect, "difference": {"mean": effect["estimate"], **effect}}
            for effect in result["effects"][1:]
        ]
    return [] if result.get("p") is None else [result]


def _p(result: Mapping[str, Any]) -> float:
    """The corrected p where there is one."""
    return float(result["p"] if result.get("p_holm") is None else result["p_holm"])


def _label(result: Mapping[str, Any], measure: Measure | None) -> str:
    return measure.label if measure else str(result["measure"])


def _answer(result: Mapping[str, Any], measure: Measure | None) -> Sentence:
    """Name a difference with its interval, p, correction and n, or say that none was found."""
    difference = result.get("difference") or {}
    label, levels = _label(result, measure), _list(result["levels"])
    found = _p(result) < _SIGNIFICANT
    if "name" in result:
        text = f"{'An' if found else 'No'} effect of {result['name']} on {_lower(label)} was found"
    elif not found:
        text = f"No difference in {_lower(label)} was found between {levels}"
    elif difference:
        size = difference.get("estimate", difference["mean"])
        amount = number(abs(size), None) if measure is None else in_words(abs(size), measure)
        word = "higher" if size > 0 else "lower"
        first, second = result["levels"][:2]
        text = f"{label} is {amount} {word} in {first} than in {second}"
    else:
        text = f"{label} differs between {levels}"
    text = f"{text}{place_of(result)} ({_evidence(result, measure)})."
    if not found and difference.get("detectable") is not None:
        detectable = number(difference["detectable"], measure)
        text += f" A difference of {detectable} would be found with power .8."
    note = str(result.get("note") or "")
    text = f"{text} {note[:1].upper()}{note[1:]}." if note else text
    return Sentence(text, test_numbers(result, measure))


def _evidence(result: Mapping[str, Any], measure: Measure | None) -> str:
    """Difference, interval, p with its correction, and n."""
    difference = difference_words(result, measure, "()")
    parts = [f"difference {difference}"] if difference else []
    tests = result.get("family", 1)
    p = f"p {_equal(p_words(_p(result)))}"
    parts.append(p if tests == 1 else f"{p} after Holm's correction for {tests} tests")
    return ", ".join([*parts, f"n = {counted_units(result)}"])


def place_of(result: Mapping[str, Any]) -> str:
    """Where a comparison was made: `` (game=easy)``; empty without other factors."""
    by = ", ".join(f"{name}={label}" for name, label in (result.get("by") or {}).items())
    return f" ({by})" if by else ""


def test_numbers(result: Mapping[str, Any], measure: Measure | None) -> str:
    """The numbers of a test, in a line."""
    parts = [_TESTS.get(str(result["test"]), str(result["test"]))]
    means = [m for m in result.get("means") or () if m is not None]
    if len(means) == 2:
        parts.append(f"means {number(means[0], measure)} and {number(means[1], measure)}")
    if result.get("z") is not None:
        parts.append(f"Z = {result['z']:.3f}")
    elif result.get("df") is not None:
        letter = "t" if str(result["test"]).endswith("-t") else "chi square"
        parts.append(f"{letter}({result['df']:.3g}) = {result['statistic']:.3f}")
    if result.get("p") is not None:
        parts.append(f"uncorrected p {_equal(p_words(result['p']))}")
    if result.get("effect") is not None:
        parts.append(f"{result.get('effect_name', 'effect')} {result['effect']:.2f}")
    return ", ".join(parts)


def number(value: float, measure: Measure | None) -> str:
    """A number of a measure, with as many digits as the measure has."""
    return f"{value:.3g}" if measure is None else f"{value:,.{measure.digits}f}"


def difference_words(
    result: Mapping[str, Any], measure: Measure | None, brackets: Literal["[]", "()"]
) -> str:
    """The difference of a comparison with its interval; empty without one."""
    difference = result.get("difference")
    if not difference:
        return ""
    text = number(difference.get("estimate", difference["mean"]), measure)
    low, high = (
        None if difference.get(end) is None else number(difference[end], measure)
        for end in ("low", "high")
    )
    if low is None and high is None:
        return f"{text} [no interval]" if brackets == "[]" else f"{text}, without a 95 % interval"
    inside = f"{low} to {high}"
    if low is None or high is None:
        inside = f"at most {high}" if low is None else f"at least {low}"
    return f"{text} [{inside}]" if brackets == "[]" else f"{text}, 95 % interval {inside}"


def counted_units(result: Mapping[str, Any]) -> str:
    """What n is and counts in a result: ``12 simulated persons``."""
    n, unit = result["n"], str(result.get("unit"))
    one = {
        "round": "round{} of one policy (no sample of people)",
        "person": "simulated person{}",
        "user": "trained user{}",
    }.get(unit, f"of {unit}")
    counts = ", ".join(map(str, n)) if isinstance(n, list) else str(n)
    return f"{counts} {one.format('' if n == 1 else 's')}"


def p_words(p: float) -> str:
    """A p value, not smaller than it is worth."""
    return "< .0001" if p < 1e-4 else f"{p:.4f}"


def _equal(p: str) -> str:
    return p if p.startswith("<") else f"= {p}"


def _lower(label: str) -> str:
    return label if label[:2].isupper() else label[:1].lower() + label[1:]


def _groups(names: Sequence[str], count: int) -> str:
    """Names of some of the groups, or their number where they are many."""
    return _list(names) if len(names) <= MOST_GROUPS else f"{len(names)} of {count} groups"


def _list(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
