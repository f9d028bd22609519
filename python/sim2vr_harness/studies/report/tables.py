"""The tables of a report, as HTML."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from sim2vr_harness.client import Measure
from sim2vr_harness.figures.html import table
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.methods import PlayedBy
from sim2vr_harness.studies.report.sentences import (
    counted_units,
    difference_words,
    number,
    p_words,
    place_among,
    place_of,
)
from sim2vr_harness.studies.report.source import ReportSource, summary_of, with_spread


def measure_table(source: ReportSource, published: Published) -> Markup:
    """Every measure, a column per group; people's mean and range below ours."""
    rows: list[list[str]] = []
    for measure in source.measures:
        cells = []
        for group in source.groups:
            text = _pieces(
                with_spread(summary_of(group, measure.name), measure, len(set(group.units)))
            )
            people = published.people_in(group.condition, measure.name)
            if people:
                told = _pieces(*_people(people, measure), between="<br>")
                text += Markup('<br><span class="small">people {}</span>').format(told)
            cells.append(text)
        heading = measure.heading
        if measure.better != "none":
            arrow = "↑" if measure.better == "higher" else "↓"
            heading = Markup('{} <span class="small">{}</span>').format(heading, arrow)
        rows.append([heading, *cells])
    counts = [
        f"{len(set(group.units))} × {len(group.episodes) // max(1, len(set(group.units)))}"
        for group in source.groups
    ]
    rows.insert(0, ["Players × rounds", *counts])
    return table(["", *(group.label for group in source.groups)], rows)


def group_table(source: ReportSource, measures: Sequence[Measure]) -> Markup:
    """A row per group and a column per measure."""
    rows = [
        [g.label, *(_pieces(with_spread(summary_of(g, m.name), m)) for m in measures)]
        for g in source.groups
    ]
    return table(["", *(measure.heading for measure in measures)], rows)


def _pieces(*texts: str, between: str = " ") -> Markup:
    """Texts that stay in a line each."""
    return Markup(between).join(Markup('<span class="whole">{}</span>').format(t) for t in texts)


def _people(people: Sequence[float], measure: Measure) -> tuple[str, str]:
    """Mean and range."""
    digits = measure.digits
    mean = float(np.mean(people))
    return f"{mean:,.{digits}f}", f"[{min(people):,.{digits}f} to {max(people):,.{digits}f}]"


def beside_tables(source: ReportSource, published: Published) -> Iterator[tuple[str, Markup]]:
    """Yield each measure that others have values of, too, with a column for each of them."""
    for measure in source.measures:
        if found := _beside(source, published, measure):
            yield measure.heading, found


def _beside(source: ReportSource, published: Published, measure: Measure) -> Markup | None:
    digits = measure.digits
    rows: list[tuple[list[str], dict[str, float]]] = []
    own_means: list[float] = []
    for group in source.groups:
        own = summary_of(group, measure.name)
        people = published.people_in(group.condition, measure.name)
        others = published.beside(measure.name, dict(group.episodes.iloc[0]))
        if own is None or not (people or others):
            continue
        beside = ["", ""]
        if people:
            mean, extent = _people(people, measure)
            difference = own.mean - float(np.mean(people))
            beside = [
                _pieces(f"{mean} {extent},", f"n = {len(people)}"),
                _pieces(f"{difference:+,.{digits}f},", place_among(own.mean, people)),
            ]
        here = _pieces(with_spread(own, measure, len(set(group.units))))
        rows.append(([group.label, here, *beside], dict(others)))
        own_means.append(own.mean)
    if not rows:
        return None
    sources = [one.source for one in published.values]
    used = [name for name in dict.fromkeys(sources) if any(name in others for _, others in rows)]
    with_people = any(row[2] for row, _ in rows)
    headings = ["", "Here"]
    if with_people:
        headings += ["People: mean [range]", "Here − people, and place among them"]
    headings += [f"{name[:1].upper()}{name[1:]} (here − it)" for name in used]
    cells = [
        [
            *(row if with_people else row[:2]),
            *(
                f"{others[name]:,.{digits}f} ({mean - others[name]:+,.{digits}f})"
                if name in others
                else ""
                for name in used
            ),
        ]
        for (row, others), mean in zip(rows, own_means, strict=True)
    ]
    return table(headings, cells)


def published_tests(published: Published) -> Markup | None:
    """Tests that others made; None without any."""
    if not published.tests:
        return None
    rows = [
        [one.source, one.what, one.test, str(one.n), f"{one.z:.3f}", p_words(one.p)]
        for one in published.tests
    ]
    return table(["Source", "What", "Test", "n", "Z", "p"], rows)


def test_table(source: ReportSource) -> Markup | None:
    """The results of a study's comparisons, those that were refused with the reason."""
    if not source.comparisons:
        return None
    rows = []
    notes: list[str] = []
    for result in source.comparisons:
        measure = source.measure(str(result["measure"]))
        counted = counted_units(result)
        note = result.get("note")
        if note:
            if note not in notes:
                notes.append(note)
            counted = Markup("{} <sup>{}</sup>").format(counted, notes.index(note) + 1)
        sign = {"less": " < ", "greater": " > "}.get(str(result.get("alternative")), " – ")
        means = ", ".join(
            "–" if m is None else number(m, measure) for m in result.get("means") or ()
        )
        detectable = (result.get("difference") or {}).get("detectable")
        test_row = [
            f"{measure.label if measure else result['measure']}{place_of(result)}",
            sign.join(map(str, result.get("levels") or ())),
            means,
            difference_words(result, measure),
            counted,
            str(result["test"]),
            *_outcome(result),
            "" if detectable is None else number(detectable, measure),
        ]
        rows.append(test_row)
    headings = ["Measure", "Compared", "Means", "Difference [95 %]", "n", "Test", "Statistic", "p"]
    found = table([*headings, "p, Holm (tests)", "Effect", "Found with power .8"], rows)
    items = Markup().join(Markup("<li>{}</li>").format(note) for note in notes)
    return found + Markup('<ol class="notes">{}</ol>').format(items) if notes else found


def _outcome(result: Mapping[str, Any]) -> list[str]:
    """Statistic, p, corrected p and effect size; or why there is no p."""
    if result.get("refused"):
        reason = Markup('<span class="refused">no p value: {}</span>').format(result["refused"])
        return [reason, "", "", ""]
    z, adjusted, value, effect = map(result.get, ("z", "p_holm", "statistic", "effect"))
    statistic = "" if value is None else f"{value:.4g}"
    return [
        statistic if z is None else f"Z = {z:.3f}",
        p_words(result["p"]) if result.get("p") is not None else "",
        "" if adjusted is None else f"{p_words(adjusted)} ({result.get('family', 1)})",
        "" if effect is None else f"{effect:.2f} ({result.get('effect_name', '')})",
    ]


def user_table(users: Sequence[PlayedBy]) -> Markup:
    """Return the table of users, with their hashes."""
    rows = [
        [
            user.name,
            "" if user.steps is None else f"{user.steps:,}",
            user.body,
            str(user.muscles) if user.body else "",
            user.effort,
            Markup("<code>{}</code>").format(user.contract),
            Markup("<code>{}</code>").format(user.weights),
        ]
        for user in users
    ]
    headings = ["User", "Trained steps", "Body", "Muscles", "Effort", "Contract", "Weights"]
    return table(headings, rows)


def glossary(source: ReportSource) -> Markup:
    """Return the table of measures, with their descriptions."""
    rows = [
        [m.label, m.unit, {"higher": "more", "lower": "less"}.get(m.better, ""), m.description]
        for m in (*source.measures, *source.grids)
    ]
    return table(["Measure", "Unit", "Better", "What it is"], rows)
