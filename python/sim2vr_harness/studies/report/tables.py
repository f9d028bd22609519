"""The tables of a report, as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from sim2vr_harness.client import Measure
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.methods import PlayedBy
from sim2vr_harness.studies.report.numbers import summary_of, with_spread
from sim2vr_harness.studies.report.sentences import p_words, place_of, unit_words
from sim2vr_harness.studies.report.source import ReportSource

__all__ = [
    "Html",
    "beside_table",
    "glossary",
    "measure_table",
    "published_tests",
    "table",
    "test_table",
    "user_table",
]


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """Return a table; texts are escaped here, and may be marked by :class:`Html`."""
    head = "".join(f"<th>{_cell(text)}</th>" for text in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{_cell(text)}</td>" for text in row) + "</tr>" for row in rows
    )
    told = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table>{told}<thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def _cell(text: str) -> str:
    return text if isinstance(text, Html) else escape(text)


def measure_table(source: ReportSource, published: Published) -> str:
    """Every measure, a column per group; people's mean and range below ours."""
    rows: list[list[str]] = []
    for measure in source.measures:
        cells = []
        for group in source.groups:
            text = escape(with_spread(summary_of(group, measure.name), measure))
            people = published.people_in(group.condition, measure.name)
            if people:
                text += f'<br><span class="people">{escape(_people(people, measure))}</span>'
            cells.append(Html(text))
        heading = escape(measure.heading)
        if measure.better != "none":
            heading += ' <span class="people">' + ("↑" if measure.better == "higher" else "↓")
            heading += "</span>"
        rows.append([Html(heading), *cells])
    counts = [
        f"{len(set(group.units))} × {len(group.episodes) // max(1, len(set(group.units)))}"
        for group in source.groups
    ]
    rows.insert(0, ["Players × rounds", *counts])
    return table(["", *(group.label for group in source.groups)], rows)


def _people(people: Sequence[float], measure: Measure) -> str:
    digits = measure.digits
    mean = float(np.mean(people))
    return f"people {mean:,.{digits}f} [{min(people):,.{digits}f} to {max(people):,.{digits}f}]"


def beside_table(source: ReportSource, published: Published) -> str | None:
    """Ours, people's and published values side by side; None where nobody else has any."""
    sources = list(dict.fromkeys(one.source for one in published.values))
    rows = []
    used: set[str] = set()
    for measure in source.measures:
        for group in source.groups:
            own = summary_of(group, measure.name)
            people = published.people_in(group.condition, measure.name)
            others = published.beside(measure.name, dict(group.episodes.iloc[0]))
            if own is None or not (people or others):
                continue
            used |= set(others)
            digits = measure.digits
            mean = float(np.mean(people)) if people else None
            inside = ""
            if people:
                inside = "inside" if min(people) <= own.mean <= max(people) else "outside"
            rows.append(
                [
                    measure.heading,
                    group.label,
                    with_spread(own, measure),
                    "" if not people else f"{_people(people, measure)[7:]}, n = {len(people)}",
                    "" if mean is None else f"{own.mean - mean:+,.{digits}f}, {inside}",
                    *(
                        f"{others[name]:,.{digits}f} ({own.mean - others[name]:+,.{digits}f})"
                        if name in others
                        else ""
                        for name in sources
                    ),
                ]
            )
    if not rows:
        return None
    keep = [i for i, name in enumerate(sources) if name in used]
    rows = [[*row[:5], *(row[5 + i] for i in keep)] for row in rows]
    headings = ["Measure", "", "Here", "People: mean [range]", "Here − people, and their range"]
    headings += [f"{sources[i].capitalize()} (here − it)" for i in keep]
    if not any(row[3] for row in rows):
        rows = [[*row[:3], *row[5:]] for row in rows]
        headings = [*headings[:3], *headings[5:]]
    return table(headings, rows)


def published_tests(published: Published) -> str | None:
    """Tests that others made; None without any."""
    if not published.tests:
        return None
    rows = [
        [one.source, one.what, one.test, str(one.n), f"{one.z:.3f}", p_words(one.p)]
        for one in published.tests
    ]
    return table(["Source", "What", "Test", "n", "Z", "p"], rows)


def test_table(source: ReportSource) -> str | None:
    """What a study's comparisons came to, those that were refused with the reason."""
    if not source.comparisons:
        return None
    rows = []
    notes: list[str] = []
    for result in source.comparisons:
        measure = source.measure(str(result["measure"]))
        label = measure.label if measure else str(result["measure"])
        levels = " – ".join(map(str, result.get("levels") or ()))
        means = ", ".join("–" if m is None else f"{m:.3g}" for m in result.get("means") or ())
        if result.get("refused"):
            outcome: list[str] = [
                Html(f'<span class="refused">no p value: {escape(result["refused"])}</span>')
            ]
            outcome += ["", "", ""]
        else:
            statistic = (
                f"Z = {result['z']:.3f}" if result.get("z") is not None else _statistic(result)
            )
            adjusted = result.get("p_holm")
            outcome = [
                statistic,
                p_words(result["p"]) if result.get("p") is not None else "",
                p_words(adjusted) if adjusted is not None else "",
                _effect(result),
            ]
        counted = escape(f"{_n(result)} {unit_words(result)}")
        note = result.get("note")
        if note:
            if note not in notes:
                notes.append(note)
            counted += f" <sup>{notes.index(note) + 1}</sup>"
        rows.append(
            [
                f"{label}{place_of(result)}",
                levels,
                means,
                _difference(result),
                Html(counted),
                str(result["test"]),
                *outcome,
            ]
        )
    headings = ["Measure", "Compared", "Means", "Difference [95 %]", "n", "Test", "Statistic", "p"]
    told = "".join(f"<li>{escape(note)}</li>" for note in notes)
    below = f'<ol class="notes">{told}</ol>' if notes else ""
    return table([*headings, "p, Holm", "Effect"], rows) + below


def _n(result: Mapping[str, Any]) -> str:
    n = result["n"]
    return ", ".join(map(str, n)) if isinstance(n, list) else str(n)


def _statistic(result: Mapping[str, Any]) -> str:
    value = result.get("statistic")
    return "" if value is None else f"{value:.4g}"


def _effect(result: Mapping[str, Any]) -> str:
    value, name = result.get("effect"), result.get("effect_name", "")
    return "" if value is None else f"{value:.2f} ({name})"


def _difference(result: Mapping[str, Any]) -> str:
    difference = result.get("difference")
    if not difference:
        return ""
    text = f"{difference['mean']:.3g}"
    if difference.get("low") is not None:
        text += f" [{difference['low']:.3g} to {difference['high']:.3g}]"
    return text


def user_table(users: Sequence[PlayedBy]) -> str:
    """Who played, with the hashes."""
    rows = [
        [
            user.name,
            "" if user.steps is None else f"{user.steps:,}",
            user.body,
            str(user.muscles) if user.body else "",
            user.effort,
            Html(f"<code>{escape(user.contract)}</code>"),
            Html(f"<code>{escape(user.weights)}</code>"),
        ]
        for user in users
    ]
    headings = ["User", "Trained steps", "Body", "Muscles", "Effort", "Contract", "Weights"]
    return table(headings, rows)


def glossary(source: ReportSource) -> str:
    """What each measure is."""
    rows = [
        [m.label, m.unit, {"higher": "more", "lower": "less"}.get(m.better, ""), m.description]
        for m in (*source.measures, *source.grids)
    ]
    return table(["Measure", "Unit", "Better", "What it is"], rows)
