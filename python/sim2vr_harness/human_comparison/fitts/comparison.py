"""Users of ``pointing`` beside people: tables, JSON, and what is asked of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from sim2vr_harness.games.behaviour import Bounds
from sim2vr_harness.human_comparison.fitts.published import STUDIES
from sim2vr_harness.human_comparison.fitts.users import NUMBERS, AimedUser, Spread
from sim2vr_harness.human_comparison.goals import GoalRow

__all__ = ["AimedReport", "aimed_json", "aimed_tables"]

_R2, _INDICES = Bounds(low=0.9), 9


@dataclass(frozen=True)
class AimedReport:
    """Users beside people.

    Attributes:
        users: who is compared.
        people: recorded ones; None: there are only the published ones.
    """

    users: Sequence[AimedUser]
    people: AimedUser | None

    @property
    def goals(self) -> list[GoalRow]:
        """What is asked of users who are to pass for people."""
        return [row for user in self.users for row in self._of(user)]

    def _of(self, user: AimedUser) -> Iterator[GoalRow]:
        indices = len(user.difficulties)
        if user.line is not None:
            enough = indices >= _INDICES and _R2.hold(user.line.r2)
            yield GoalRow(
                user.name,
                "",
                f"R2 of movement time over {indices} indices of difficulty",
                user.line.r2,
                aim=f"{_R2} over {_INDICES}",
                aim_met=enough,
            )
        own, people = user.number("throughput"), self._people_s_throughput()
        if own is not None and people is not None:
            yield GoalRow(
                user.name,
                "",
                "throughput (bits/s)",
                own.mean,
                own.sd,
                people.low,
                people.high,
                aim="in people's range",
                aim_met=people.low <= own.mean <= people.high,
            )

    def _people_s_throughput(self) -> Spread | None:
        """Of recorded people, or of the published means where there are any."""
        if self.people is not None:
            return self.people.number("throughput")
        return Spread.of(study.throughput_bps for study in STUDIES)


def aimed_json(report: AimedReport) -> dict[str, Any]:
    """Everything that was found, ready for JSON."""
    people = [] if report.people is None else [report.people]
    return {
        "users": {user.name: _user(user) for user in report.users},
        "people": {user.name: _user(user) for user in people},
        "published": [asdict(study) for study in STUDIES],
        "goals": [asdict(row) for row in report.goals],
    }


def _user(user: AimedUser) -> dict[str, Any]:
    return {
        "line": None if user.line is None else asdict(user.line),
        "numbers": {
            name: None if (found := user.number(name)) is None else asdict(found)
            for name in NUMBERS
        },
        "difficulties": [asdict(row) for row in user.difficulties],
        "persons": [person.as_dict() for person in user.persons],
    }


def aimed_tables(report: AimedReport, *, every: bool = False) -> RenderableType:
    """Return what a comparison comes to.

    Args:
        report: What was found.
        every: Show every distance and width.
    """
    columns = [*report.users, *([] if report.people is None else [report.people])]
    parts: list[RenderableType] = [_numbers(columns)]
    for user in columns:
        rounds = sum(person.rounds for person in user.persons)
        who = f"{user.name}: {len(user.persons)} persons, {rounds} rounds"
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
    parts.append(_asked(report))
    return Group(*parts)


def _numbers(columns: Sequence[AimedUser]) -> Table:
    table = Table(
        title="Aimed movements: mean ± standard deviation over persons [least to greatest]",
        box=box.SIMPLE_HEAD,
        title_justify="left",
    )
    table.add_column("")
    for user in columns:
        table.add_column(user.name, justify="right")
    for name, (unit, _) in NUMBERS.items():
        label = f"{name} ({unit})" if unit else name
        table.add_row(label, *(_shown(user.number(name)) for user in columns))
    return table


def _shown(found: Spread | None) -> str:
    if found is None:
        return ""
    if found.sd is None:
        return f"{found.mean:.3g}"
    return f"{found.mean:.3g} ± {found.sd:.2g} [{found.low:.3g} to {found.high:.3g}]"


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
            "(docs/research/games.md); --people takes recordings of your own."
        )


def _asked(report: AimedReport) -> Table:
    table = Table(title="Asked of users", box=box.SIMPLE_HEAD, title_justify="left")
    for heading in ("Who", "What", "User", "People", "Aim"):
        table.add_column(heading)
    for row in report.goals:
        people = ""
        if row.people_low is not None and row.people_high is not None:
            people = f"{row.people_low:.3g} to {row.people_high:.3g}"
        value = f"{row.value:.3g}" + ("" if row.spread is None else f" ± {row.spread:.2g}")
        met = "+" if row.aim_met else "-"
        table.add_row(row.user, row.what, value, people, f"{row.aim} {met}")
    return table
