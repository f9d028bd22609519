"""A comparison as JSON and CSV."""

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.figures.figure import Figure
from sim2vr_harness.figures.html import Part, listed, save_page, table
from sim2vr_harness.human_comparison.comparing import (
    Compared,
    ComparisonRow,
    SampleRow,
    Total,
    by_family,
    total,
)
from sim2vr_harness.human_comparison.contrasts import ContrastRow
from sim2vr_harness.human_comparison.figures import main_rows, row_name
from sim2vr_harness.human_comparison.fitts import STUDIES
from sim2vr_harness.human_comparison.measures import plain
from sim2vr_harness.human_comparison.report import ComparisonReport, aimed_of


def as_json(report: ComparisonReport) -> dict[str, Any]:
    """Everything that was found, ready for JSON."""
    return {
        "game": report.behaviour.game,
        "people": {
            " ".join(cell): [
                {"name": person.name, "rounds": person.rounds, **_numbers(person.values)}
                for person in persons
            ]
            for cell, persons in report.people.persons.items()
        },
        "users": {
            compared.name: _user(report, i, compared) for i, compared in enumerate(report.compared)
        },
        "together": _total(report.together),
        "between_groups": [
            {"user": name, **_contrast(row)} for name, row in report.group_contrasts()
        ],
        "left_out": {
            group: {
                "inside": _mean_of(list(each.values()), "inside"),
                "distance": _mean_of(list(each.values()), "distance"),
                "persons": {name: _total(total(compared.rows)) for name, compared in each.items()},
            }
            for group, each in report.left_out.items()
        },
        **({"fitts": _fitts(report)} if report.behaviour.aimed else {}),
    }


def _fitts(report: ComparisonReport) -> dict[str, Any]:
    """Return Fitts' law of users and people, and published values."""
    return {
        "law": {name: asdict(law) for name, law in report.laws.items()},
        "persons": {
            source.name: {person.name: asdict(aimed) for person, aimed in aimed_of(source)}
            for source in (*report.users, report.people)
        },
        "published": [asdict(study) for study in STUDIES],
    }


def _in_a_row(report: ComparisonReport, compared: Compared, group: str) -> dict[str, Any]:
    rows = [row for row in compared.rows if row.group == group]
    values = {(row.condition, row.measure.name): row.value for row in rows}
    first = {f"{name}, {c}": values.get((c, name)) for c, name in report.behaviour.headlines}
    found = total(rows)
    assert found is not None  # a group is one of rows
    return {"user": compared.name, "group": group, **asdict(found), **first}


def _user(report: ComparisonReport, index: int, compared: Compared) -> dict[str, Any]:
    source = report.users[index]
    tired, more = report.fatigue(source)
    return {
        "total": _total(total(compared.rows)),
        "groups": {
            group: {
                "total": _total(total(rows)),
                "families": {family: _total(part) for family, part in by_family(rows).items()},
                "conditions": {
                    condition: _total(total([row for row in rows if row.condition == condition]))
                    for condition in dict.fromkeys(row.condition for row in rows)
                },
            }
            for group in compared.groups
            for rows in ([row for row in compared.rows if row.group == group],)
        },
        "persons": {
            " ".join(cell): [
                {"name": person.name, "rounds": person.rounds, **_numbers(person.values)}
                for person in persons
            ]
            for cell, persons in compared.persons.items()
        },
        "measures": [_row(row) for row in compared.rows],
        "samples": [_sample(row) for row in compared.samples],
        "contrasts": [_contrast(row) for row in report.contrasts(source)],
        "fatigue": [asdict(row) for row in tired],
        "fatigue_differences": [asdict(row) for row in more],
    }


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with a column for each spread over persons; empty if there is no number."""
    found: dict[str, Any] = {}
    for key, value in row.items():
        parts = (
            {f"_{part}": number for part, number in value.items()}
            if isinstance(value, dict)
            else {}
        )
        found |= {f"{key}{part}": number for part, number in (parts or {"": value}).items()}
    return {key: value for key, value in found.items() if value is not None}


def _numbers(values: Any) -> dict[str, float]:
    return {key: float(value) for key, value in values.items()}


def _total(found: Total | None) -> dict[str, Any] | None:
    return None if found is None else asdict(found)


def _row(row: ComparisonRow) -> dict[str, Any]:
    content = {key: value for key, value in vars(row).items() if key != "measure"}
    return {
        "measure": row.measure.name,
        "family": row.measure.family,
        "unit": row.measure.unit,
        **content,
    }


def _sample(row: SampleRow) -> dict[str, Any]:
    return asdict(row)


def _contrast(row: ContrastRow) -> dict[str, Any]:
    return {**asdict(row), "same_sign": row.same_sign, "within": row.within}


def _mean_of(each: Sequence[Compared], name: str) -> float:
    totals = (found for one in each if (found := total(one.rows)) is not None)
    return float(np.mean([getattr(found, name) for found in totals]))


def write_json(report: ComparisonReport, file: Path) -> Path:
    """Write everything that was found."""
    write_atomically(file, (json.dumps(as_json(report), indent=1) + "\n").encode())
    return file


def write_page(
    report: ComparisonReport, figures: Sequence[Figure], file: Path, notes: Iterable[str] = ()
) -> list[Path]:
    """Write a page that opens without a network, and a PDF: the answer, every measure, the figures.

    Args:
        figures: The first one is on the first screen.
        file: The page.
        notes: Sentences on what limits the answer.
    """
    names = " and ".join(compared.name for compared in report.compared)
    rows = [
        (row_name(first, report), *(_with_unit(row) for row in own), first.people_range)
        for own in main_rows(report)
        if (first := next(row for row in own if row is not None))
    ]
    header = ("", *(compared.name for compared in report.compared), "people")
    limits = [_LIMITS[bool(report.people.persons)], *notes]
    sections: list[tuple[str, list[Part]]] = [("What limits this answer", [listed(limits)])]
    sections += [(each.title, [each]) for each in figures[1:]]
    sections += [(f"All measures of {x.name}", [_AWAY, _page_table(x)]) for x in report.compared]
    return save_page(
        file,
        f"Does {names} act like people in {report.behaviour.game}?",
        _answer(report),
        [*figures[:1], table(header, rows)],
        sections,
        printed=True,
    )


_AWAY = (
    "Marked: outside people's range. Away: distance from people's mean, in units of the distance "
    "of one person from the others."
)
_LIMITS = (
    "No people were recorded, so only published movement times are compared.",
    "People's range is from the lowest to the highest recorded; few people have a narrow range.",
)


def _answer(report: ComparisonReport) -> str:
    """Return in how many measures users are inside people's range; else Fitts' law of each."""
    told = []
    for compared in report.compared:
        found = total(compared.rows)
        if found is not None and found.inside is not None:
            told.append(f"{100 * found.inside:.0f} % of {found.cells} measures of {compared.name}")
    if told:
        return f"Inside the range of the recorded people: {', '.join(told)}."
    laws = report.laws.items()
    lines: list[tuple[str, Any]] = [(name, law.line) for name, law in laws if law.line is not None]
    lines += [(f"people ({each.label})", each) for each in STUDIES if lines and each.a_s]
    told = [f"{name} {line.a_s:.2f} s + {line.b_s_per_bit:.2f} s per bit" for name, line in lines]
    times = f"Movement time: {'; '.join(told)}."
    return times if told else "One person was recorded, who has no range."


def _with_unit(row: ComparisonRow | None) -> str:
    return "" if row is None else f"{plain(row.value)} {row.measure.unit}".strip()


def _page_table(compared: Compared) -> Markup:
    """Return a row per measure; those outside people's range are highlighted."""
    rows = [
        (
            f"{row.measure.label}, {row.condition}",
            row.measure.unit,
            plain(row.value),
            "" if row.people_mean is None else plain(row.people_mean),
            row.people_range if row.people > 1 else "",
            f"{row.persons}, {row.people}",
            "" if row.distance is None else f"{row.distance:.1f}",
        )
        for row in compared.rows
    ]
    bad = [i for i, row in enumerate(compared.rows) if row.inside is not None and row.inside < 0.5]
    return table(("measure", "unit", compared.name, "people", "range", "n", "away"), rows, bad)


def write_csv(report: ComparisonReport, folder: Path) -> list[Path]:
    """Write measures, samples and contrasts as CSV, a row per user and number.

    ``users.csv`` has a row per user and group, with the headline measures.
    """
    tables: dict[str, list[dict[str, Any]]] = {
        "users": [
            _in_a_row(report, each, group) for each in report.compared for group in each.groups
        ],
        "measures": [
            {"user": compared.name, **_row(row)}
            for compared in report.compared
            for row in compared.rows
        ],
        "samples": [
            {"user": compared.name, **_sample(row)}
            for compared in report.compared
            for row in compared.samples
        ],
        "contrasts": [
            {"user": name, **_contrast(row)}
            for name, row in (
                *((user.name, row) for user in report.users for row in report.contrasts(user)),
                *report.group_contrasts(),
            )
        ],
        "difficulties": [
            {"user": name, **_flat(asdict(row))}
            for name, law in report.laws.items()
            for row in law.rows
        ],
    }
    files = []
    for name, rows in tables.items():
        if not rows:
            continue
        text = io.StringIO()
        names = list(dict.fromkeys(name for row in rows for name in row))
        writer = csv.DictWriter(text, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_atomically(folder / f"{name}.csv", text.getvalue().encode())
        files.append(folder / f"{name}.csv")
    return files
