"""Users of ``pointing`` beside people: tables and JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from sim2vr_harness.base.errors import counted
from sim2vr_harness.human_comparison.fitts.published import STUDIES
from sim2vr_harness.human_comparison.fitts.users import NUMBERS, AimedUser, Spread
from sim2vr_harness.human_comparison.measures import plain


@dataclass(frozen=True)
class AimedReport:
    """Users beside people.

    Attributes:
        users: who is compared.
        people: recorded ones; None: there are only the published ones.
    """

    users: Sequence[AimedUser]
    people: AimedUser | None


def aimed_json(report: AimedReport) -> dict[str, Any]:
    """Everything that was found, ready for JSON."""
    people = [] if report.people is None else [report.people]
    return {
        "users": {user.name: _user(user, report.people) for user in report.users},
        "people": {user.name: _user(user, None) for user in people},
        "published": [asdict(study) for study in STUDIES],
    }


def _user(user: AimedUser, people: AimedUser | None) -> dict[str, Any]:
    return {
        "line": None if user.line is None else asdict(user.line),
        "numbers": {
            name: None
            if (found := user.number(name)) is None
            else {**asdict(found), "inside": _inside(found, people, name)}
            for name in NUMBERS
        },
        "difficulties": [asdict(row) for row in user.difficulties],
        "persons": [person.as_dict() for person in user.persons],
    }


def _inside(own: Spread, people: AimedUser | None, name: str) -> bool | None:
    """Return whether a mean lies in recorded people's range; None without their number."""
    theirs = None if people is None else people.number(name)
    return None if theirs is None else theirs.low <= own.mean <= theirs.high


def aimed_tables(report: AimedReport, *, every: bool = False) -> RenderableType:
    """Return what a comparison comes to.

    Args:
        report: What was found.
        every: Show every distance and width.
    """
    columns = [*report.users, *([] if report.people is None else [report.people])]
    parts: list[RenderableType] = [_numbers(columns, report.people)]
    for user in columns:
        rounds = sum(person.rounds for person in user.persons)
        who = f"{user.name}: {counted(len(user.persons), 'person')}, {counted(rounds, 'round')}"
        if user.line is not None:
            line = user.line
            who += (
                f"; of their means MT = {line.a_s:.3f} s + {line.b_s_per_bit:.3f} s/bit * ID, "
                f"R2 = {line.r2:.3f}, {line.points} indices"
            )
        parts.append(Text(who))
    if every:
        parts += [_difficulties(user) for user in columns]
    parts += list(_published())
    return Group(*parts)


def _numbers(columns: Sequence[AimedUser], people: AimedUser | None) -> Table:
    table = Table(
        title="Aimed movements: mean ± standard deviation over persons [least to greatest]"
        + ("" if people is None else "; * outside people's range"),
        box=box.SIMPLE_HEAD,
        title_justify="left",
    )
    table.add_column("")
    for user in columns:
        table.add_column(user.name, justify="right")
    for name, (unit, _) in NUMBERS.items():
        label = f"{name} ({unit})" if unit else name
        table.add_row(label, *(_shown(user.number(name), people, name) for user in columns))
    return table


def _shown(found: Spread | None, people: AimedUser | None, name: str) -> str:
    if found is None:
        return ""
    mark = "*" if _inside(found, people, name) is False else ""
    if found.sd is None:
        return f"{plain(found.mean)}{mark}"
    return (
        f"{plain(found.mean)}{mark} ± {plain(found.sd)} [{plain(found.low)} to {plain(found.high)}]"
    )


def _difficulties(user: AimedUser) -> Table:
    headings = ("D (cm)", "W (cm)", "ID (bits)", "MT (s)", "SD (mm)", "errors", "TP (bits/s)")
    table = Table(
        *headings,
        "submovements",
        title=f"{user.name}: means over persons",
        box=box.SIMPLE_HEAD,
        title_justify="left",
    )
    for row in user.difficulties:
        table.add_row(
            f"{100 * row.distance_m:.3g}",
            f"{100 * row.width_m:.3g}",
            f"{row.bits:.2f}",
            f"{row.movement_time_s.mean:.3f}",
            f"{1000 * row.spread_m.mean:.1f}",
            f"{row.error_rate.mean:.3f}",
            f"{row.throughput_bps.mean:.2f}",
            "" if row.submovements is None else f"{row.submovements.mean:.2f}",
        )
    return table


def _published() -> Iterator[RenderableType]:
    known = [study for study in STUDIES if study.b_s_per_bit or study.throughput_bps]
    for study in known:
        parts = []
        if study.a_s is not None and study.b_s_per_bit is not None:
            parts.append(f"MT = {study.a_s:.3f} s + {study.b_s_per_bit:.3f} s/bit * ID")
        if study.r2 is not None:
            parts.append(f"R2 = {study.r2:.3f}")
        if study.throughput_bps is not None:
            parts.append(f"throughput {study.throughput_bps:.2f} bits/s")
        yield Text(f"Published, {study.label} ({study.task}): {', '.join(parts)}")
    if not any(study.throughput_bps for study in STUDIES):
        yield Text(
            "Published throughput of people with a VR controller: none could be looked up "
            "(docs/research/games.md); --recordings takes recordings of your own."
        )
