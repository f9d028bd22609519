"""The sentences of a report: answers to what was asked, and what limits them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import counted
from sim2vr_harness.client import Measure
from sim2vr_harness.games.published import Published
from sim2vr_harness.games.registry import behaviour_of, behaviours
from sim2vr_harness.human_comparison.agreement import (
    Words,
    cell_disagreement,
    fatigue_order,
)
from sim2vr_harness.statistics.distances import percentile, standard_deviations
from sim2vr_harness.studies.comparisons import missing_notes
from sim2vr_harness.studies.report.source import (
    MOST_GROUPS,
    PROPORTION,
    ReportSource,
    in_words,
    known,
    level_name,
    some_of,
    summary_of,
)

_MOST_TESTS = 6
"""Of a kind that have a sentence each; the table of tests has all."""
_SIGNIFICANT = 0.05


def sentences_of(source: ReportSource, published: Published) -> list[str]:
    """Return the answer to the title, what limits it, and all other answers.

    Only requested measures have some.
    """
    answers = list(_answers(source) if source.comparisons else _described(source))
    people = [
        f"{text.removesuffix('.')} ({numbers})."
        for text, numbers in people_sentences(source, published, asked(source))
    ]
    return [*answers[:1], *limits_of(source), *answers[1:], *people]


def limits_of(source: ReportSource) -> list[str]:
    """Return missing values, what users were not trained for, and what n allows to conclude."""
    return [*dropout_sentences(source), *warnings_of(source), n_sentence(source)]


def headline(source: ReportSource) -> str:
    """Return the answer in a sentence: where the first requested measure is lowest and highest."""
    measure = asked(source)[0]
    clear: dict[str, str] = {}
    unclear: dict[str, str] = {}
    for result in source.comparisons:
        factor, means = str(result["factor"]), result.get("means") or (None,)
        if result["measure"] != measure.name or result.get("p") is None or None in means:
            continue
        at = {
            level_name(factor, level): mean
            for level, mean in zip(result["levels"], means, strict=True)
        }
        low, high = min(at, key=at.__getitem__), max(at, key=at.__getitem__)
        ends = [f"{name} ({_amount(at[name], measure)})" for name in (low, high)]
        told = clear if _p(result) < _SIGNIFICANT else unclear
        n, units = result["n"], result.get("units")
        some = (
            f", for {counted_units(result)}" if units and isinstance(n, int) and n < units else ""
        )
        told.setdefault(factor, f"lowest with {ends[0]} and highest with {ends[1]}{some}")
    if clear:
        more = [f"; {name} makes no clear difference" for name in unclear if name not in clear]
        return f"{measure.label} is {', and '.join(clear.values())}{''.join(more)}."
    if unclear:
        return f"{measure.label} shows no clear difference: {', and '.join(unclear.values())}."
    means = [(g.label, s.mean) for g in source.groups if (s := summary_of(g, measure.name))]
    return f"{measure.label}: {some_of([f'{_amount(m, measure)} in {n}' for n, m in means])}."


def dropout_sentences(source: ReportSource) -> Iterator[str]:
    """Say whose requested measures are missing or rest on little, in a sentence per measure."""
    for measure in asked(source):
        told = [
            (group.label, note)
            for group in source.groups
            for note in missing_notes(group.episodes.assign(unit=group.units), measure.name)
        ]
        if told:
            text = some_of([f"in {label} {note}" for label, note in told])
            yield f"{measure.label} rests on few values: {text}."


def warnings_of(source: ReportSource) -> Iterator[str]:
    """Yield what the users were not trained for, a sentence for each set of groups."""
    settings: dict[str, list[str]] = {}
    for line, labels in source.unpractised.items():
        where = "" if len(labels) == len(source.groups) else f" in {_groups(labels, len(labels))}"
        if line.startswith(("people = yes", "people: yes")):
            yield (
                f"The users{where} were not trained with a population: their policies have learned "
                "with one average body."
            )
        else:
            settings.setdefault(where, []).append(line)
    for where, lines in settings.items():
        yield f"The users{where} were not trained for {_list(lines)}."


def asked(source: ReportSource) -> list[Measure]:
    """Return the requested measures; the score if the study names none."""
    named = list(source.planned.get("measures") or ())
    for comparison in source.planned.get("comparisons", ()):
        named += comparison.get("measures") or ()
    found = [m for name in dict.fromkeys(named) if (m := source.measure(str(name)))]
    return found or [source.score]


def n_sentence(source: ReportSource) -> str:
    """Return a sentence that states n and the conclusions that it allows."""
    n = len(source.units)
    who = {"person": "virtual participant", "user": "trained user"}.get(source.unit)
    what = f"levels of {source.unit}" if who is None else counted(n, who).partition(" ")[2]
    if n == 1:
        return (
            f"n is 1: one {who or f'level of {source.unit}'}, whose rounds show how much it "
            "varies, not how much other users or people do, so there is no p value for differences "
            "between conditions."
        )
    if source.unit == "user":
        return (
            f"n is {n} trained users, each in its own right: differences between them are shown, "
            "but not whether another training of the same kind would have the same."
        )
    return f"n is {n} {what}; rounds of one of them count as one value, their mean."


def _described(source: ReportSource) -> Iterator[str]:
    """Describe the requested measures where nothing was compared."""
    for measure in asked(source):
        found = [(g, s) for g in source.groups if (s := summary_of(g, measure.name)) is not None]
        if not found:
            continue
        told = [f"{in_words(s.mean, measure)} in {group.label}" for group, s in found]
        text = f"{measure.label}: {some_of(told)}"
        if len(found) > 1:
            text += "; whether the groups differ was not tested, as no comparison was requested"
        yield f"{text}."


def _answers(source: ReportSource) -> Iterator[str]:
    """Answer the comparisons: the first requested one, then differences, then the others."""
    results = sorted(source.comparisons, key=lambda r: not source.leads(str(r["measure"])))
    questions = [one for result in results for one in _questions(result)]
    different = [one for one in questions[1:] if _p(one) < _SIGNIFICANT]
    alike = [one for one in questions[1:] if _p(one) >= _SIGNIFICANT]
    for one in (*questions[:1], *different[:_MOST_TESTS], *alike[:_MOST_TESTS]):
        yield _answer(one, source.measure(str(one["measure"])))
    for part, words in ((different, "show a difference"), (alike, "are inconclusive")):
        if len(part) > _MOST_TESTS:
            more = counted(len(part) - _MOST_TESTS, "more comparison")
            yield f"{more} {words}: see the table of tests."
    refused: dict[str, list[str]] = {}
    for result in results:
        if result.get("refused"):
            label = _label(result, source.measure(str(result["measure"])))
            question = f"{label} in {_list(result['levels'])}{place_of(result)}"
            refused.setdefault(str(result["refused"]), []).append(question)
    for reason, unanswered in refused.items():
        yield f"Whether there is a difference was not tested: {reason} ({some_of(unanswered)})."


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


def _answer(result: Mapping[str, Any], measure: Measure | None) -> str:
    """Answer a question as one would say it: the finding, both values, the interval and n."""
    difference = result.get("difference") or {}
    label, levels = _label(result, measure), list(map(str, result["levels"]))
    place = place_of(result)
    found = _p(result) < _SIGNIFICANT
    bound = result.get("equivalence")
    ends = (difference.get("low"), difference.get("high"))
    within = bound is not None and all(end is not None and abs(end) < bound for end in ends)
    if "name" in result:
        text = f"{result['name']} has an effect on {_lower(label)}{place}"
        text = text if found else f"Inconclusive: whether {text}"
        text = f"{text}: {_amount(difference['mean'], measure)}"
    elif len(levels) != 2 or not difference:
        text = f"{label} differs between {_list(levels)}{place}"
        text = text if found else f"Inconclusive: whether {_lower(text)}"
        text = f"{text}, p {_equal(p_words(_p(result)))}"
    else:
        values = _values(result, measure)
        if bound is not None and within:
            text = (
                f"No difference in {_lower(label)} between {_list(levels)}{place} that is as large "
                f"as {_amount(bound, measure)}: {values}"
            )
        elif found:
            size = difference.get("estimate", difference["mean"])
            amount = _amount(abs(size), measure) + _percentage(result, measure)
            word = "higher" if size > 0 else "lower"
            text = f"{label} is {amount} {word} in {levels[0]} than in {levels[1]}{place}: {values}"
        else:
            text = f"Inconclusive: {_lower(label)} in {_list(levels)}{place}, {values}"
    if any(end is not None for end in ends):
        text += f", 95 % interval {_ends(ends, measure)}"
    return f"{text}, {counted_units(result)}."


def _means(result: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Means of the first two levels; None where there is none."""
    first, second = (result.get("means") or (None, None))[:2]
    return first, second


def _values(result: Mapping[str, Any], measure: Measure | None) -> str:
    """Both levels' means: ``2.78 against 0.54 bit/s``."""
    first, second = _means(result)
    if first is None or second is None:
        return f"difference {_amount(result['difference']['mean'], measure)}"
    unit = _amount(second, measure)
    return f"{_amount(first, measure).removesuffix(' ' + unit.partition(' ')[2])} against {unit}"


def _amount(value: float, measure: Measure | None) -> str:
    """A number with its unit; of proportions in percent."""
    if measure is not None and measure.unit == PROPORTION:
        return f"{100.0 * value:,.{max(0, measure.digits - 2)}f} %"
    return number(value, None) if measure is None else in_words(value, measure)


def _percentage(result: Mapping[str, Any], measure: Measure | None) -> str:
    """Return the difference of positive means as a percentage of the second; proportions: empty."""
    first, second = _means(result)
    if measure is None or measure.unit == PROPORTION or first is None or second is None:
        return ""
    if first <= 0.0 or second <= 0.0 or not 0.005 <= abs(first / second - 1.0) < 10.0:
        return ""
    return f" ({abs(first / second - 1.0):.0%})".replace("%", " %")


def _ends(ends: Sequence[float | None], measure: Measure | None) -> str:
    low, high = (None if end is None else _amount(end, measure) for end in ends)
    if low is None or high is None:
        return f"at most {high}" if low is None else f"at least {low}"
    return f"{low.partition(' ')[0]} to {high}"


def place_of(result: Mapping[str, Any]) -> str:
    """Return the other factors' levels of a comparison: `` (game=easy)``; empty without any."""
    by = ", ".join(f"{name}={label}" for name, label in (result.get("by") or {}).items())
    return f" ({by})" if by else ""


def number(value: float, measure: Measure | None) -> str:
    """A number of a measure, with as many digits as the measure has."""
    return f"{value:.3g}" if measure is None else f"{value:,.{measure.digits}f}"


def difference_words(result: Mapping[str, Any], measure: Measure | None) -> str:
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
        return f"{text} [no interval]"
    inside = f"{low} to {high}"
    if low is None or high is None:
        inside = f"at most {high}" if low is None else f"at least {low}"
    return f"{text} [{inside}]"


def counted_units(result: Mapping[str, Any]) -> str:
    """Return n with its unit: ``12 virtual participants``."""
    n, unit = result["n"], str(result.get("unit"))
    one = {
        "round": "round{} of one policy (no sample of people)",
        "person": "virtual participant{}",
        "user": "trained user{}",
    }.get(unit, f"of {unit}")
    counts = ", ".join(map(str, n)) if isinstance(n, list) else str(n)
    units = result.get("units")
    if units is not None and units != n and not isinstance(n, list):
        return f"{counts} of {units} {one.format('s')}"
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


_FATIGUE = "max_fatigued"


def people_sentences(
    source: ReportSource, published: Published, measures: Sequence[Measure]
) -> Iterator[Words]:
    """Yield users' places among people, and where users and people disagree."""
    for measure in measures:
        yield from _places(source, published, measure)
    yield from _cells(source, published)
    duration_s = max(float(group.episodes["duration_s"].median()) for group in source.groups)
    if published.beside_rounds_of(duration_s) is published:  # fatigue grows with the round
        yield from _fatigue(source)


def place_among(value: float, people: Sequence[float]) -> str:
    """Return percentile and distance: ``percentile 35 of 12 people, -0.4 SD``."""
    away = standard_deviations(value, people)
    words = "people do not differ" if away is None else f"{away:+.1f} SD"
    return f"percentile {percentile(value, people):.0f} of {len(people)} people, {words}"


def _places(source: ReportSource, published: Published, measure: Measure) -> Iterator[Words]:
    told, numbers = [], []
    for group in source.groups:
        people = published.people_in(group.condition, measure.name)
        found = summary_of(group, measure.name)
        if len(people) < 2 or found is None:
            continue
        told.append(f"{group.label}: {place_among(found.mean, people)}")
        spread = f"{float(np.std(people, ddof=1)):.{measure.digits}f}"
        numbers.append(
            f"{group.label}: {in_words(found.mean, measure)}, people "
            f"{in_words(float(np.mean(people)), measure)}, SD {spread}"
        )
    if told:
        text = f"{measure.label} beside people (distance to their mean in their SD)"
        yield f"{text}: {some_of(told)}.", some_of(numbers)


def _cells(source: ReportSource, published: Published) -> Iterator[Words]:
    for grid in source.grids:
        rows, columns = grid.grid or (0, 0)
        told, numbers = [], []
        for group in source.groups:
            people = published.grid_of(group.condition, grid.name)
            own = [known(group.values(f"{grid.name}_{i}")) for i in range(rows * columns)]
            if people is None or len(people) != len(own) or not all(own):
                continue
            means = np.array([np.mean(values) for values in own])
            theirs = np.array(people)
            words, r = cell_disagreement(means, theirs, (rows, columns))
            told.append(f"{group.label}: {words}")
            numbers.append(f"{group.label}: {r}")
        if told:
            yield f"{grid.label}: {some_of(told)}.", some_of(numbers)


def _fatigue(source: ReportSource) -> Iterator[Words]:
    """Compare the order of users' fatigue with that of people's ratings."""
    game = source.facts.name
    behaviour = behaviour_of(game) if game in behaviours() else None
    if behaviour is None or behaviour.ratings is None:
        return
    own: dict[tuple[str, str], dict[str, float]] = {}
    for group in source.groups:
        cell, found = behaviour.recognise(group.condition), summary_of(group, _FATIGUE)
        if cell is not None and found is not None:
            own.setdefault((group.user, cell[0]), {})[cell[1]] = found.mean
    for (user, rule), means in own.items():
        medians = behaviour.ratings.medians.get(rule, {})
        both = [condition for condition in medians if condition in means]
        if len(both) > 1:
            rated = {condition: medians[condition] for condition in both}
            text = fatigue_order({c: means[c] for c in both}, rated)
            yield f"{user}: {text}", f"{behaviour.ratings.scale}; {behaviour.ratings.source}"
