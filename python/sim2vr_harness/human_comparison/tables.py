"""A comparison as tables for people."""

from collections.abc import Iterator, Sequence

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from sim2vr_harness.base.errors import counted
from sim2vr_harness.human_comparison.agreement import cell_disagreement, fatigue_order
from sim2vr_harness.human_comparison.comparing import (
    Compared,
    ComparisonRow,
    Total,
    by_family,
    total,
)
from sim2vr_harness.human_comparison.contrasts import COMPARED, ContrastRow
from sim2vr_harness.human_comparison.figures import main_rows, row_name
from sim2vr_harness.human_comparison.files import as_json
from sim2vr_harness.human_comparison.fitts import STUDIES
from sim2vr_harness.human_comparison.grid import SETTLING_S
from sim2vr_harness.human_comparison.measures import EVERY_MEASURE, plain
from sim2vr_harness.human_comparison.report import ComparisonReport, aimed_of

_WORST = 12
_LABELS = {measure.name: measure.label for measure in EVERY_MEASURE}
SETTLING = (
    f"The first {SETTLING_S:g} s of each round are left out of the measures of movement, because "
    "arms of simulated users start hanging down; counts are of the whole round."
)


def report_tables(report: ComparisonReport, *, every: bool = False) -> RenderableType:
    """Return the tables of a comparison's results.

    Args:
        every: Show every measure in every condition.
    """
    aimed = report.behaviour.aimed
    parts: list[RenderableType] = [] if aimed else [Text(SETTLING)]
    parts += map(Text, missing_values(report))
    if any(row.distance is not None for row in report.rows()):
        parts.append(_totals(report))
    if len(report.users) > 1:
        parts.append(_in_one_table(report))
    for index, compared in enumerate(report.compared):
        found = [row for own in main_rows(report) if (row := own[index]) is not None]
        parts.append(_table(f"{compared.name}: main measures", found))
        parts += _fatigue(report, index)
        parts += _cells(report, index)
        if not aimed:
            chosen = None if every else _farthest(compared)
            parts.append(_rows(compared, chosen))
    if aimed:
        parts += _law(report, every=every)
    parts += _contrasts(report)
    return Group(*parts)


def _law(report: ComparisonReport, *, every: bool) -> Iterator[RenderableType]:
    """Yield Fitts' law of users and people, each distance and width if requested, and studies."""
    for source in (*report.users, report.people):
        if (law := report.laws.get(source.name)) is None:
            continue
        persons = [person for person, _ in aimed_of(source)]
        rounds = sum(person.rounds for person in persons)
        who = f"{source.name}: {counted(len(persons), 'person')}, {counted(rounds, 'round')}"
        if law.line is not None:
            who += (
                f"; of their means {_line(law.line.a_s, law.line.b_s_per_bit)}, "
                f"R2 = {law.line.r2:.3f}, {law.line.points} indices"
            )
        yield Text(who)
    for name, law in report.laws.items() if every else ():
        table = Table(
            *("D (cm)", "W (cm)", "ID (bits)", "MT (s)", "SD (mm)", "errors", "TP (bits/s)"),
            *("submovements", "n"),
            title=f"{name}: means over n participants",
            box=box.SIMPLE_HEAD,
            title_justify="left",
        )
        for row in law.rows:
            table.add_row(
                f"{100 * row.distance_m:.3g}",
                f"{100 * row.width_m:.3g}",
                f"{row.bits:.2f}",
                f"{row.movement_time_s.mean:.3f}",
                f"{1000 * row.spread_m.mean:.1f}",
                f"{row.error_rate.mean:.3f}",
                f"{row.throughput_bps.mean:.2f}",
                "" if row.submovements is None else f"{row.submovements.mean:.2f}",
                str(row.persons),
            )
        yield table
    for study in STUDIES:
        parts = []
        if study.a_s is not None and study.b_s_per_bit is not None:
            parts.append(_line(study.a_s, study.b_s_per_bit))
        if study.r2 is not None:
            parts.append(f"R2 = {study.r2:.3f}")
        if study.throughput_bps is not None:
            parts.append(f"throughput {study.throughput_bps:.2f} bits/s")
        if parts:
            yield Text(f"Published, {study.label} ({study.task}): {', '.join(parts)}")
    if not any(study.throughput_bps for study in STUDIES):
        yield Text(
            "Published throughput of people with a VR controller: none could be looked up "
            "(docs/evidence/people.md); --people takes recordings of your own."
        )


def _line(a_s: float, b_s_per_bit: float) -> str:
    return f"MT = {a_s:.3f} s + {b_s_per_bit:.3f} s/bit * ID"


def missing_values(report: ComparisonReport) -> Iterator[str]:
    """Yield lines on measures that some persons lack, with the persons."""
    for name, cells, rows in [
        (compared.name, compared.persons, compared.rows) for compared in report.compared
    ]:
        told: dict[tuple[str, str], list[str]] = {}
        for row in rows:
            for who, where in ((name, cells), ("people", report.people.persons)):
                persons = where.get((row.group, row.condition), ())
                out = [p.name for p in persons if row.measure.name not in p.values]
                if out:
                    key = (who, f"{len(out)} of {len(persons)} ({', '.join(out[:6])})")
                    told.setdefault(key, []).append(f"{row.measure.label} ({row.condition})")
        for (who, out_of), labels in told.items():
            more = f"; and {len(labels) - 4} more" if len(labels) > 4 else ""
            yield (
                f"{who}: {out_of} have no value, because their rounds have too few events or "
                f"movements for it: {'; '.join(labels[:4])}{more}"
            )


def _totals(report: ComparisonReport) -> Table:
    table = Table(
        title="Inside people's range, distance", box=box.SIMPLE_HEAD, title_justify="left"
    )
    table.add_column("Who")
    for heading in ("Group", "Cells", "Inside", "Distance"):
        table.add_column(heading, justify="left" if heading == "Group" else "right")
    for compared in report.compared:
        for group in compared.groups:
            rows = [row for row in compared.rows if row.group == group]
            _add(table, compared.name, group, total(rows))
            for family, part in by_family(rows).items():
                _add(table, f"  {family}", "", part, dim=True)
        if len(compared.groups) > 1:
            _add(table, compared.name, "all", total(compared.rows))
    _add(table, "together", "all", report.together)
    for group, each in as_json(report)["left_out"].items():
        table.add_row(
            f"one of the {len(each['persons'])} people, the others",
            group,
            "",
            f"{each['inside']:.3f}",
            f"{each['distance']:.2f}",
        )
    return table


def _in_one_table(report: ComparisonReport) -> Table:
    """Return the first table: the main measures, a column for each user."""
    title = "Compared (* outside people's range)"
    table = Table("", title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for each in report.compared:
        table.add_column(each.name, justify="right")
    table.add_column("People", justify="right", no_wrap=True)
    for own in main_rows(report):
        first = next(row for row in own if row is not None)
        unit = f" ({first.measure.unit})" if first.measure.unit else ""
        table.add_row(row_name(first, report) + unit, *map(_value, own), first.people_range)
    totals = [total(each.rows) for each in report.compared]
    table.add_row("cells inside", *("" if t is None else _digits(t.inside, 3) for t in totals))
    table.add_row("distance", *("" if t is None else _digits(t.distance, 2) for t in totals))
    return table


def _value(row: ComparisonRow | None) -> str:
    return "" if row is None else f"{plain(row.value)}{_mark(row)}"


def _mark(row: ComparisonRow) -> str:
    return "" if row.inside in (None, 1.0) else "*"


def _digits(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _add(table: Table, name: str, group: str, found: Total | None, *, dim: bool = False) -> None:
    if found is None:
        return
    table.add_row(
        name,
        group,
        str(found.cells),
        _digits(found.inside, 3),
        _digits(found.distance, 2),
        style="dim" if dim else None,
    )


def _farthest(compared: Compared) -> list[ComparisonRow]:
    if all(row.distance is None for row in compared.rows):
        return list(compared.rows)  # beside one person: all of them
    away = sorted(compared.rows, key=lambda row: -(row.distance or 0.0))
    return away[:_WORST]


def _rows(compared: Compared, chosen: Sequence[ComparisonRow] | None) -> RenderableType:
    if chosen is None:
        return _table(f"{compared.name}: every measure", compared.rows)
    one = all(row.distance is None for row in chosen)
    beside = "beside one person, who has no range" if one else "farthest from people"
    return _table(f"{compared.name}: {beside}", chosen)


def _table(title: str, rows: Sequence[ComparisonRow]) -> Table:
    """Return a row per measure and condition; a star marks values outside people's range.

    ``n`` is the number of the user's persons, and of people, with a value.
    """
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    several = len({row.group for row in rows}) > 1
    conditions = len({(row.group, row.condition) for row in rows}) > 1
    ranged = any(row.distance is not None for row in rows)
    if conditions:
        table.add_column("Condition", overflow="fold")
    table.add_column("Measure", overflow="fold")
    further = ("Percentile", "SD", "Away") if ranged else ()
    for heading in ("User", "People", "n", *further):
        table.add_column(heading, justify="right", overflow="fold")
    for row in rows:
        spread = "" if row.spread is None else f" ± {plain(row.spread)}"
        mark = _mark(row)
        people = "" if row.people_mean is None else plain(row.people_mean)
        if row.people > 1:
            people += f" [{row.people_range}]"
        unit = f" ({row.measure.unit})" if row.measure.unit else ""
        where = f"{row.condition}, {row.group}" if several else row.condition
        far = [
            _digits(row.percentile, 0),
            "" if row.deviations is None else f"{row.deviations:+.1f}",
            _digits(row.distance, 1),
        ]
        table.add_row(
            *([where] if conditions else []),
            row.measure.label + unit,
            f"{plain(row.value)}{spread}{mark}",
            people,
            f"{row.persons}, {row.people}",
            *(far if ranged else ()),
        )
    return table


def _fatigue(report: ComparisonReport, index: int) -> Iterator[RenderableType]:
    tired, more = report.fatigue(report.users[index])
    if not tired:
        return
    text = ", ".join(
        f"{row.condition} {row.mean:.3f}" + ("" if row.spread is None else f" ± {row.spread:.3f}")
        for row in tired
    )
    yield Text(f"Fatigue (largest share of fatigued units, mean of the muscles): {text}")
    if more:
        text = ", ".join(
            f"{row.contrast} {row.mean:+.3f}"
            + ("" if row.effect is None else f" (effect size {row.effect:.2f})")
            for row in more
        )
        yield Text(f"Differences: {text}")
    ratings = report.behaviour.ratings
    for group in dict.fromkeys(row.group for row in tired):
        rated = {} if ratings is None else ratings.medians.get(group, {})
        if ratings is not None and rated:
            text = ", ".join(f"{condition} {median:g}" for condition, median in rated.items())
            count = ratings.people[group]
            yield Text(f"{count} people, {group} ({ratings.scale}, medians): {text}")
            means = {row.condition: row.mean for row in tired if row.group == group}
            both = [condition for condition in rated if condition in means]
            if len(both) > 1:
                order = fatigue_order({c: means[c] for c in both}, {c: rated[c] for c in both})
                yield Text(f"{group}: {order}")


def _cells(report: ComparisonReport, index: int) -> Iterator[RenderableType]:
    """Say where users and people differ in the hit rates of the cells, and whether in their order.

    Places are named on a square grid, as the player sees it.
    """
    side = round(len(report.behaviour.places_m) ** 0.5)
    for cell, persons in report.users[index].persons.items():
        people = report.people.persons.get(cell, ())
        if len(people) < 2:
            continue
        own, theirs = (
            np.ma.masked_invalid([person.cell_rates for person in group]).mean(axis=0)
            for group in (persons, people)
        )
        if side < 2 or side**2 != len(own) or np.ma.is_masked(own) or np.ma.is_masked(theirs):
            continue
        words, r = cell_disagreement(own.data, theirs.data, (side, side))
        yield Text(f"{', '.join(cell)}: {words}; {r}")


def _contrasts(report: ComparisonReport) -> Iterator[RenderableType]:
    found: dict[str, list[ContrastRow]] = {}
    for user in report.users:
        for row in report.contrasts(user):
            found.setdefault(f"{user.name}, {row.group}", []).append(row)
    for name, row in report.group_contrasts():
        found.setdefault(f"{name}, between groups", []).append(row)
    for name, rows in found.items():
        same = sum(row.same_sign for row in rows)
        within = sum(row.within for row in rows)
        title = (
            f"{name}: differences, the user's and (people's); - wrong sign, * outside the 95 % "
            f"interval of people's mean. Sign as people's in {same} of {len(rows)}, size in "
            f"{within}"
        )
        table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
        table.add_column("Difference")
        for measure in COMPARED:
            table.add_column(_LABELS[measure], justify="right")
        for contrast in dict.fromkeys(row.contrast for row in rows):
            own = {row.measure: row for row in rows if row.contrast == contrast}
            table.add_row(contrast, *(_difference(own.get(measure)) for measure in COMPARED))
        yield table


def _difference(row: ContrastRow | None) -> str:
    if row is None:
        return ""
    mark = ("" if row.same_sign else "-") + ("" if row.within else "*")
    value, people = plain(row.value, signed=True), plain(row.people_mean, signed=True)
    return f"{value} ({people}) {mark}".rstrip()
