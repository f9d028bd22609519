"""What is asked of users who are to pass for people, and whether they do it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sim2vr_harness.games.behaviour import Behaviour, Bounds, Goals, Ratings
from sim2vr_harness.human_comparison.comparing import Compared, ComparisonRow, Total
from sim2vr_harness.human_comparison.contrasts import ContrastRow, FatigueDifference
from sim2vr_harness.statistics.intervals import CONFIDENCE, effect_interval

__all__ = ["GoalRow", "goal_rows", "inside_row", "sign_rows"]

_ABOVE_NOTHING = "> 0"
_ALL = "all"
_RANGE = "each"
"""Every one of the user's persons within people's range."""


@dataclass(frozen=True)
class GoalRow:
    """Something that is asked of a user.

    Attributes:
        user: whose.
        group: of people who play by the same rule; empty over all.
        what: in words.
        value: the user's, mean over its persons.
        spread: standard deviation over its persons; None of one person, or of a share.
        people_low: end of what people do: their least, or of a 95 % interval; None: not known.
        people_high: the other end.
        bar: what is asked; empty: nothing.
        bar_met: whether it is so; None: nothing is asked.
        aim: what would be better.
        aim_met: whether it is so.
    """

    user: str
    group: str
    what: str
    value: float
    spread: float | None = None
    people_low: float | None = None
    people_high: float | None = None
    bar: str = ""
    bar_met: bool | None = None
    aim: str = ""
    aim_met: bool | None = None


def goal_rows(
    compared: Compared, tired: Sequence[FatigueDifference], behaviour: Behaviour
) -> list[GoalRow]:
    """What a user is asked for, group by group.

    Args:
        compared: The user beside people.
        tired: How much more conditions tire it than others.
        behaviour: Of the game; without goals there is nothing.
    """
    goals = behaviour.goals
    if goals is None:
        return []
    found = []
    for group in compared.groups:
        rows = [row for row in compared.rows if row.group == group]
        found += list(_single(compared.name, group, rows, goals))
        found += list(_rates(compared.name, group, rows, goals.rate))
        own = [each for each in tired if each.group == group]
        found += list(_tiring(compared.name, group, own, behaviour.ratings))
    return found


def inside_row(name: str, found: Total | None, goals: Goals) -> list[GoalRow]:
    """The share of the cells inside people's range, as a row."""
    if found is None:
        return []
    bar, aim = Bounds(low=goals.inside), Bounds(low=goals.inside_aim)
    return [
        GoalRow(
            name,
            "",
            f"inside people's range, of {found.cells} cells",
            found.inside,
            bar=str(bar),
            bar_met=bar.hold(found.inside),
            aim=str(aim),
            aim_met=aim.hold(found.inside),
        )
    ]


def sign_rows(name: str, contrasts: Sequence[ContrastRow]) -> list[GoalRow]:
    """Of all differences between conditions and rules, how many have people's sign and size."""
    if not contrasts:
        return []
    same = float(np.mean([row.same_sign for row in contrasts]))
    within = float(np.mean([row.within for row in contrasts]))
    count = f"of {len(contrasts)} differences"
    return [
        GoalRow(name, "", f"people's sign, {count}", same, bar=_ALL, bar_met=same == 1.0),
        GoalRow(
            name,
            "",
            f"within people's 95 % interval, {count}",
            within,
            aim=_ALL,
            aim_met=within == 1.0,
        ),
    ]


def _single(
    name: str, group: str, rows: Sequence[ComparisonRow], goals: Goals
) -> Iterator[GoalRow]:
    by_name = {(row.condition, row.measure.name): row for row in rows}
    for goal in goals.measures:
        row = by_name.get((goal.condition, goal.measure))
        if row is None:
            continue
        if goal.aim is None:
            whole = row.persons_inside if row.persons_inside is not None else row.inside
            aim, aim_met = _RANGE, whole == 1.0
        else:
            aim, aim_met = str(goal.aim), goal.aim.hold(row.value)
        yield GoalRow(
            name,
            group,
            f"{row.measure.name}, {row.condition}"
            + (f" ({row.measure.unit})" if row.measure.unit else ""),
            row.value,
            row.spread,
            row.people_low,
            row.people_high,
            str(goal.bar),
            goal.bar.hold(row.value),
            aim,
            aim_met,
        )


def _rates(name: str, group: str, rows: Sequence[ComparisonRow], rate: str) -> Iterator[GoalRow]:
    own = [row for row in rows if row.measure.name == rate]
    if not own:
        return
    share = float(np.mean([row.inside for row in own]))
    yield GoalRow(
        name,
        group,
        f"{rate} in range, of {len(own)} conditions",
        share,
        bar=_ALL,
        bar_met=share == 1.0,
    )
    spreads = [
        _same_spread(row.spread, row.persons, row.people_spread, row.people)
        for row in own
        if row.spread is not None
    ]
    if spreads:
        share = float(np.mean(spreads))
        yield GoalRow(
            name,
            group,
            f"its spread as people's, of {len(spreads)} conditions",
            share,
            aim=_ALL,
            aim_met=share == 1.0,
        )


def _same_spread(own: float, n: int, people: float, m: int) -> bool:
    """Whether two standard deviations of n and m persons may be of one (F test, 5 %)."""
    if people == 0.0:
        return own == 0.0
    low, high = stats.f.interval(CONFIDENCE, n - 1, m - 1)
    return bool(low <= (own / people) ** 2 <= high)


def _tiring(
    name: str, group: str, tired: Sequence[FatigueDifference], ratings: Ratings | None
) -> Iterator[GoalRow]:
    for each in tired:
        yield GoalRow(
            name,
            group,
            f"fatigue, {each.contrast}",
            each.mean,
            each.spread,
            bar=_ABOVE_NOTHING,
            bar_met=each.mean > 0.0,
        )
        z = None if ratings is None else ratings.z.get(group, {}).get(each.contrast)
        if ratings is None or z is None or each.rank_effect is None:
            continue
        low, high = effect_interval(z, ratings.people[group])
        yield GoalRow(
            name,
            group,
            "its effect size, z / sqrt(n)",
            each.rank_effect,
            people_low=low,
            people_high=high,
            aim=str(Bounds(low, high)),
            aim_met=low <= each.rank_effect <= high,
        )
