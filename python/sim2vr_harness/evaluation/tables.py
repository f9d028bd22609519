"""Results as a table for people."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from sim2vr_harness.client import GameFacts, Measure
from sim2vr_harness.play.fatigue import FATIGUE, fatigue_measures, full_name
from sim2vr_harness.play.round import ARM_MEASURES, measures_of

_COLUMNS = 4
"""Number of conditions that fit 80 columns together with the labels."""

_LABEL_COLUMNS = 28
"""Width of labels; longer ones continue in the next line. Four numbers with deviations fit
beside."""

_CONDITION_COLUMNS = 12
"""Longer names of conditions are broken at hyphens, where they have any."""


def results_table(
    summaries: Mapping[str, Mapping[str, Any]], facts: GameFacts, title: str
) -> RenderableType:
    """Return tables of means and standard deviations over rounds or people, a column a condition.

    Args:
        summaries: condition -> :func:`~sim2vr_harness.play.round.summarise`.
        title: Shown above.
    """
    facts = facts.with_log(
        {
            key: 0.0
            for s in summaries.values()
            for key in [key for result in s.get("rounds", ()) for key in result["log"]]
        }
    )
    conditions = list(summaries)
    parts: list[RenderableType] = [Text(title, style="bold"), Text(_over_what(summaries))]
    for first in range(0, len(conditions), _COLUMNS):
        chosen = conditions[first : first + _COLUMNS]
        parts.append(_table({condition: summaries[condition] for condition in chosen}, facts))
    parts += [
        Text(f"{measure.label}: {_lower(measure.description)}.", style="dim")
        for measure in (*facts.scalars, *facts.grids, *measures_of(GameFacts("")))
        if measure.description and any(_has(s, measure) for s in summaries.values())
    ]
    return Group(*parts)


def _table(summaries: Mapping[str, Mapping[str, Any]], facts: GameFacts) -> Table:
    tight = len(summaries) == _COLUMNS
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 0) if tight else (0, 1))
    table.add_column("Per round", max_width=_LABEL_COLUMNS, no_wrap=False)
    for condition in summaries:
        heading = fill(condition, _CONDITION_COLUMNS) if tight else condition
        table.add_column(heading, justify="right", overflow="fold")
    rounds = (len(s["rounds"]) if "rounds" in s else s["episodes"] for s in summaries.values())
    table.add_row("Rounds", *map(str, rounds))
    for measure in (
        *measures_of(facts),
        *fatigue_measures(name for s in summaries.values() for name in s.get("fatigue_parts", ())),
    ):
        if measure in ARM_MEASURES and not any(_has(s, measure) for s in summaries.values()):
            continue  # an arm that the body does not have
        cells = [
            cell(
                summary.get(measure.name),
                summary.get(f"{measure.name}_sd"),
                measure.digits,
                tight=tight,
            )
            for summary in summaries.values()
        ]
        table.add_row(measure.heading, *cells)
    if any("fatigue_parts" in summary for summary in summaries.values()):
        worst = [_most_fatigued(summary, tight=tight) for summary in summaries.values()]
        table.add_row("Most fatigued muscle", *worst)
    labels = {term.log_key: term.label for term in facts.reward_terms}
    labels |= {"rest": facts.reward_rest, "effort": "effort"}
    terms = list(
        dict.fromkeys(term for s in summaries.values() for term in s.get("return_terms", {}))
    )
    for term in terms if len(terms) > 2 else ():
        values = (summary.get("return_terms", {}).get(term) for summary in summaries.values())
        table.add_row(
            f"  from {labels.get(term, term)}", *(cell(value, None, 1) for value in values)
        )
    for measure in facts.grids:
        if any(_has(summary, measure) for summary in summaries.values()):
            worst = [
                _worst(summary.get(measure.name, []), measure, tight=tight)
                for summary in summaries.values()
            ]
            table.add_row(f"{measure.label}, worst", *worst)
    for key, heading in (
        ("diverged", "Diverged"),
        ("app_left", "App left VR by itself"),
        ("app_failed", "App failed (not counted)"),
    ):
        counts = [summary.get(key, 0) for summary in summaries.values()]
        if any(counts):
            table.add_row(heading, *map(str, counts))
    return table


def _most_fatigued(summary: Mapping[str, Any], *, tight: bool) -> str:
    """Return the muscle with the highest mean fatigue, by its full name."""
    parts = summary.get("fatigue_parts", ())
    muscles = [
        (summary[measure.name], measure.name)
        for measure in fatigue_measures(summary)
        if measure.name not in parts and not measure.name.endswith("_sd")
    ]
    known = [(value, name) for value, name in muscles if value is not None]
    if not known:
        return "-"
    value, name = max(known)
    words = full_name(name.removeprefix(FATIGUE))
    return f"{fill(words, _CONDITION_COLUMNS)}\n{value:.3f}" if tight else f"{words} {value:.3f}"


def _over_what(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a sentence on the samples of the means and deviations."""
    people = {summary.get("persons") for summary in summaries.values()}
    if people != {None}:
        several = len(people) > 1
        number = "several" if several else str(next(iter(people)))
        return f"Mean ± SD over {number} participants, each counts with the mean of its rounds."
    counts = {summary["episodes"] for summary in summaries.values()}
    if counts == {1}:
        return "One round of one user for each condition."
    rounds = str(counts.pop()) if len(counts) == 1 else "the"
    return f"Mean ± SD over {rounds} rounds of this one user; other users may differ more."


def _has(summary: Mapping[str, Any], measure: Measure) -> bool:
    found = summary.get(measure.name)
    if measure.grid is None:
        return found is not None
    return any(value is not None for value in found or ())


def _worst(values: Sequence[float | None], measure: Measure, *, tight: bool = False) -> str:
    known = [(value, item) for item, value in enumerate(values) if value is not None]
    if not known:
        return "-"
    value, item = max(known) if measure.better == "lower" else min(known)
    between = "\n" if tight else " "
    return f"{value:.{measure.digits}f}{between}(no. {item})"


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


def cell(value: float | None, deviation: float | None, digits: int, *, tight: bool = False) -> str:
    """Return a number, with its deviation if there is one; "-" for none."""
    if value is None:
        return "-"
    between = "±" if tight else " ± "
    spread = "" if deviation is None else f"{between}{deviation:.{digits}f}"
    return f"{value:.{digits}f}{spread}"
