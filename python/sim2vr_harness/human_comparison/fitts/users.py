"""Users of the game ``pointing``, each a set of persons, and people who were recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.human_comparison.fitts.law import (
    Difficulty,
    FittedLine,
    FittsResult,
    fit_line,
    measure_user,
    rounds_below,
)
from sim2vr_harness.human_comparison.sources import (
    Plays,
    logged_rounds,
    person_beside,
    play_now,
    trained_user,
)


@dataclass(frozen=True)
class Spread:
    """A number of several persons.

    Attributes:
        mean: over them.
        sd: standard deviation (ddof 1); None of one.
        low: least.
        high: greatest.
    """

    mean: float
    sd: float | None
    low: float
    high: float

    @classmethod
    def of(cls, values: Iterable[float | None]) -> Spread | None:
        """Of the numbers that there are; None of none."""
        known = [value for value in values if value is not None]
        if not known:
            return None
        sd = float(np.std(known, ddof=1)) if len(known) > 1 else None
        return cls(float(np.mean(known)), sd, min(known), max(known))


NUMBERS: Mapping[str, tuple[str, Callable[[FittsResult], float | None]]] = {
    "throughput": ("bits/s", lambda one: one.throughput_bps),
    "movement time": ("s", lambda one: _mean(d.movement_time_s for d in one.difficulties)),
    "a": ("s", lambda one: None if one.line is None else one.line.a_s),
    "b": ("s/bit", lambda one: None if one.line is None else one.line.b_s_per_bit),
    "R2": ("", lambda one: None if one.line is None else one.line.r2),
    "a, effective": ("s", lambda one: _effective(one, "a_s")),
    "b, effective": ("s/bit", lambda one: _effective(one, "b_s_per_bit")),
    "R2, effective": ("", lambda one: _effective(one, "r2")),
    "endpoint spread": ("mm", lambda one: 1e3 * _mean(d.spread_m for d in one.difficulties)),
    "submovements": ("", lambda one: _pieces(one)),
    "errors": ("", lambda one: one.error_rate),
    "time-outs": ("", lambda one: one.timeouts / one.targets),
}
"""Name -> unit and value of a person."""


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def _effective(one: FittsResult, key: str) -> float | None:
    return None if one.effective_line is None else float(getattr(one.effective_line, key))


def _pieces(one: FittsResult) -> float | None:
    counts = [d.submovements for d in one.difficulties if d.submovements is not None]
    return _mean(counts) if counts else None


@dataclass(frozen=True)
class AimedMovements:
    """One distance and width, over persons.

    Attributes:
        distance_m: nominal.
        width_m: nominal.
        bits: nominal index of difficulty.
        movement_time_s: of every person's mean.
        throughput_bps: of every person's.
        error_rate: of every person's.
        spread_m: of every person's standard deviation of end points along the task axis.
        submovements: of every person's mean; None without the tip's way.
    """

    distance_m: float
    width_m: float
    bits: float
    movement_time_s: Spread
    throughput_bps: Spread
    error_rate: Spread
    spread_m: Spread
    submovements: Spread | None


@dataclass(frozen=True)
class AimedUser:
    """A user, or people: one or several persons.

    Attributes:
        name: for tables and pictures.
        persons: each with all its rounds; at least one.
    """

    name: str
    persons: tuple[FittsResult, ...]

    @cached_property
    def difficulties(self) -> tuple[AimedMovements, ...]:
        """In the order of their indices."""
        found: dict[tuple[float, float], list[Difficulty]] = {}
        for person in self.persons:
            for each in person.difficulties:
                found.setdefault((each.distance_m, each.width_m), []).append(each)
        rows = [_aimed(own) for own in found.values()]
        return tuple(sorted(rows, key=lambda row: row.bits))

    @cached_property
    def line(self) -> FittedLine | None:
        """Of the means over persons, as studies report it."""
        rows = self.difficulties
        return fit_line([row.bits for row in rows], [row.movement_time_s.mean for row in rows])

    def number(self, name: str) -> Spread | None:
        """One of :data:`NUMBERS`, over persons."""
        return Spread.of(NUMBERS[name][1](person) for person in self.persons)


def _aimed(own: Sequence[Difficulty]) -> AimedMovements:
    """What persons did at one distance and width."""

    def spread(key: str) -> Spread:
        return _known(Spread.of(getattr(one, key) for one in own))

    return AimedMovements(
        distance_m=own[0].distance_m,
        width_m=own[0].width_m,
        bits=own[0].bits,
        movement_time_s=spread("movement_time_s"),
        throughput_bps=spread("throughput_bps"),
        error_rate=spread("error_rate"),
        spread_m=spread("spread_m"),
        submovements=Spread.of(one.submovements for one in own),
    )


def _known(found: Spread | None) -> Spread:
    assert found is not None
    return found


def read_aimed_user(
    user: str,
    game: str,
    plays: Plays,
    *,
    on_progress: Callable[[float], None] = lambda share: None,
) -> AimedUser:
    """Measure a user: of a folder with logs, or one that plays now.

    Args:
        user: A user's name, a run's folder or checkpoint; or the folder of an evaluation with
            logs, or of any rounds.
        game: Which.
        plays: How it plays, if it has to.
        on_progress: Called with the share of the work done.

    Raises:
        InputError: It is none of them, or its rounds are not of the game.
    """
    known = trained_user(user, game)
    folder = Path(user)
    if known is not None:
        conditions = plays.conditions or known.config.evaluation.conditions
        chosen = conditions or game_facts(known.config.env.app).evaluated
        folder = play_now(user, known, chosen, plays, on_progress)
    name = folder.resolve().name
    rounds: dict[str, list[Path]] = {}
    logged = logged_rounds(folder, name)
    for each in logged:
        rounds.setdefault(each.person, []).append(each.folder)
    if not logged:
        for place in rounds_below(folder):
            rounds.setdefault(person_beside(place) or name, []).append(place)
    return AimedUser(name, tuple(measure_user(own, who) for who, own in rounds.items()))


def read_aimed_people(folders: Sequence[Path]) -> AimedUser | None:
    """Measure people's logs, a folder per person with as many rounds as there are below it.

    Raises:
        InputError: A folder is not there, or has no rounds.
    """
    persons = []
    for folder in folders:
        if not folder.is_dir():
            raise InputError("--recordings", repr(str(folder)), "a folder with one per person")
        own = sorted(each for each in folder.iterdir() if each.is_dir())
        if not own:
            got = f"{str(folder)!r}, which has none"
            raise InputError("--recordings", got, "a folder per person")
        persons += [measure_user(rounds_below(each), each.name) for each in own]
    return AimedUser("people", tuple(persons)) if persons else None
