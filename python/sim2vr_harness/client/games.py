"""Facts that a game publishes: measures, conditions, names, timelines.

Games publish them in C++ beside their rules (``GameFacts`` in ``rl/game_facts.hpp``,
``Game::timelineJson`` in ``rl/game.hpp``); tables, learning curves, progress displays and figures
use them.
"""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from sim2vr_harness.client.answers import checked
from sim2vr_harness.client.base import OptionValue, plain_options
from sim2vr_harness.client.runtime import checked_seed, list_games, load_runtime
from sim2vr_harness.registration import register_games

_CONDITION_ARGUMENT = "condition"
"""SIM2VR's own apps take the name of a condition as the argument ``-condition``."""


@dataclass(frozen=True)
class Measure:
    """One number of a round, from the game's last log.

    Attributes:
        name: Key in results.
        label: For tables, without the unit.
        unit: Such as ``m/s``; may be empty.
        better: Which direction is good for the player.
        digits: Behind the decimal point, for tables.
        log_key: The log's number; of a grid, the numbers ``log_key`` + index.
        rate_with: With it, the measure is the share log_key / (log_key + rate_with).
        grid: Rows and columns of one number per item, row by row.
        only_if: None where this number of the log is 0.
        description: What a reader might ask about the label; may be empty.
    """

    name: str
    label: str
    unit: str = ""
    better: Literal["higher", "lower", "none"] = "none"
    digits: int = 1
    log_key: str = ""
    rate_with: str | None = None
    grid: tuple[int, int] | None = None
    only_if: str | None = None
    description: str = ""

    @property
    def heading(self) -> str:
        """The label with its unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def value(self, log: Mapping[str, float]) -> float | None:
        """The measure of a round, None where it has none; grids have :meth:`values`."""
        if self.only_if is not None and not log.get(self.only_if):
            return None
        return self._ratio(log, "")

    def values(self, logs: Sequence[Mapping[str, float]]) -> list[float | None]:
        """A grid's numbers over rounds, item by item: shares are pooled, others are means."""
        found: list[float | None] = []
        rows, columns = self.grid or (0, 0)
        for item in range(rows * columns):
            keys = [f"{key}{item}" for key in (self.log_key, self.rate_with) if key is not None]
            sums = {key: sum(log.get(key, 0.0) for log in logs) for key in keys}
            share = self._ratio(sums, str(item))
            if self.rate_with is None and share is not None:
                share /= len(logs)
            found.append(share)
        return found

    def _ratio(self, log: Mapping[str, float], suffix: str) -> float | None:
        value = log.get(self.log_key + suffix)
        if self.rate_with is None or value is None:
            return value
        other = log.get(self.rate_with + suffix)
        return None if other is None or value + other <= 0 else value / (value + other)


@dataclass(frozen=True)
class Condition:
    """A named set of a game's options; all conditions of a game set the same ones.

    Attributes:
        draws: Conditions that a round may turn out to be, where that is not this one itself.
        evaluated: Whether evaluations play it when no one says which.
    """

    name: str
    description: str = ""
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    draws: tuple[str, ...] = ()
    evaluated: bool = False


@dataclass(frozen=True)
class GameOption:
    """An option of a game, a key of ``env.app.options``.

    Attributes:
        type: ``text``, ``choice``, ``bool``, ``number`` or ``numbers`` (a list).
        default: The value of a round that does not set it; ``[]``: the game's own.
    """

    name: str
    type: str
    default: OptionValue
    choices: Sequence[str] = ()
    minimum: float | None = None
    maximum: float | None = None

    @property
    def range(self) -> str:
        """The values that it takes, in words."""
        if self.minimum is not None and self.maximum is not None:
            return f"{self.minimum:g} to {self.maximum:g}"
        return "true, false" if self.type == "bool" else ", ".join(self.choices)


@dataclass(frozen=True)
class RewardTerm:
    """A part of the reward.

    Attributes:
        log_key: The log's number of what it was in the latest user step.
    """

    log_key: str
    label: str

    @property
    def sum_key(self) -> str:
        """The log's number of what it was in the round so far."""
        return f"{self.log_key}Sum"


@dataclass(frozen=True)
class ItemOutcome:
    """A way in which an item ends.

    Attributes:
        event: The log's.
        name: What data and tables call it.
        success: Whether the player did well.
    """

    event: str
    name: str
    success: bool


@dataclass(frozen=True)
class LoggedItem:
    """Item of a round, such as a target, as the episode's log reports it.

    A line of the log is ``time, EVENT, FIELD VALUE, FIELD VALUE ...``.

    Attributes:
        name: Name of the items, such as ``target``.
        id_field: The field that tells the items of that name apart.
        outcomes: Possible outcomes of an item.
        begin_event: Event of the appearance; None: the log has none.
        counted_events: Events between appearance and outcome that are counted.
        cell_field: The field with the number of the cell.
        place_field: The field with the position, 2 or 3 numbers, m.
        places_event: The event with ``[cell ... x y z]`` for every cell, world, m.
        velocity_field: The field with the velocity that decided the outcome, 3 numbers, m/s.
    """

    name: str
    id_field: str
    outcomes: tuple[ItemOutcome, ...]
    begin_event: str | None = None
    counted_events: tuple[str, ...] = ()
    cell_field: str | None = None
    place_field: str | None = None
    places_event: str | None = None
    velocity_field: str | None = None


@dataclass(frozen=True)
class GameFacts:
    """Facts of a game that are known without playing it.

    Attributes:
        id: Name in Gymnasium ids: ``Sample`` in ``sim2vr/Sample-v0``.
        round_seconds: Length of a round with default options; 0: rounds have no usual length.
        devices: Controllers without which a right-handed player cannot play; see :meth:`needs`.
        inputs: Inputs that a right-handed player operates, such as ``right.trigger``.
        hand_option: The option for the hand that plays, ``right`` or ``left``, if any.
        level_option: The option that names the level to play, if any; the game then has
            timelines (:func:`describe_level`).
        score: Name of the measure by which users are compared; None: the return.
        reward_terms: Parts of the reward that the log has.
        reward_rest: Name of the rest of the reward.
        conditions: Conditions in the order of display; empty for an app that publishes none.
        default_condition: Condition of a round without options.
        evaluation_options: Options that an evaluation sets.
        published: True if the app itself publishes these facts.
    """

    name: str
    description: str = ""
    id: str = ""
    round_seconds: float = 0.0
    devices: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    hand_option: str | None = None
    level_option: str | None = None
    measures: tuple[Measure, ...] = ()
    score: str | None = None
    reward_terms: tuple[RewardTerm, ...] = ()
    reward_rest: str = "game"
    items: tuple[LoggedItem, ...] = ()
    conditions: tuple[Condition, ...] = ()
    default_condition: str = ""
    evaluation_options: Mapping[str, OptionValue] = field(default_factory=dict)
    published: bool = True

    def condition(self, name: str) -> Condition:
        """The condition of that name; of an app that publishes nothing, any name is one.

        Raises:
            ValueError: The game has no such condition; names the nearest.
        """
        for condition in self.conditions:
            if condition.name == name:
                return condition
        if not self.published:
            return Condition(name, options={_CONDITION_ARGUMENT: name})
        names = [condition.name for condition in self.conditions]
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
        hint = f" (did you mean {near[0]!r}?)" if near else f", such as {names[0]!r}"
        raise ValueError(f"condition: got {name!r}, expected a condition of {self.name}{hint}")

    def needs(self, hand: OptionValue) -> tuple[str, ...]:
        """The controllers without which a player of that hand cannot play."""
        if hand != "left":
            return self.devices
        other = {"controller_right": "controller_left", "controller_left": "controller_right"}
        return tuple(other[device] for device in self.devices)

    @property
    def evaluated(self) -> tuple[str, ...]:
        """Names of the conditions that an evaluation plays when no one says which."""
        found = tuple(condition.name for condition in self.conditions if condition.evaluated)
        return found or ((self.default_condition,) if self.default_condition else ())

    def condition_of(self, options: Mapping[str, OptionValue]) -> str:
        """Name of the condition that a round with these options is; empty if it has no name."""
        for condition in self.conditions:
            if condition.options and condition.options.items() <= options.items():
                return condition.name
        named = {key for condition in self.conditions for key in condition.options}
        return "" if named & options.keys() else self.default_condition

    def drawn(self, name: str) -> set[str]:
        """The conditions that a round of one condition may turn out to be."""
        known = {condition.name: condition for condition in self.conditions}
        if name not in known or not known[name].draws:
            return {name}
        return set().union(*(self.drawn(other) for other in known[name].draws))

    @property
    def scalars(self) -> tuple[Measure, ...]:
        """The measures that are one number each."""
        return tuple(measure for measure in self.measures if measure.grid is None)

    @property
    def grids(self) -> tuple[Measure, ...]:
        """The measures with a number per item."""
        return tuple(measure for measure in self.measures if measure.grid is not None)

    @property
    def counters(self) -> tuple[Measure, ...]:
        """At most three numbers that show how a round stands while it is played."""
        plain = (m for m in self.scalars if m.rate_with is None and m.only_if is None)
        return tuple(plain)[:3]

    @property
    def headlines(self) -> tuple[Measure, ...]:
        """The two or three numbers to show where there is no room for all, the score last."""
        first = [measure for measure in self.counters[:2] if measure.name != self.score]
        return (*first, *(measure for measure in self.scalars if measure.name == self.score))

    def with_log(self, log: Mapping[str, float]) -> GameFacts:
        """The facts for a round with this log.

        An app that publishes nothing is measured as the runtime's game of the same name as far as
        its log goes; if that knows none of the game's numbers, by its log's own ones.
        """
        if self.published:
            return self
        known = tuple(m for m in self.measures if (f"{m.log_key}0" if m.grid else m.log_key) in log)
        if not known:
            known = tuple(Measure(key, key, digits=2, log_key=key) for key in sorted(log))
        score = self.score if self.score in {measure.name for measure in known} else None
        return replace(self, measures=known, score=score)


@lru_cache
def describe_game(name: str) -> GameFacts:
    """Return the facts that the runtime's game of that name publishes.

    Raises:
        ValueError: There is no such game; names the nearest.
    """
    return read_facts(json.loads(load_runtime().game_facts(name)))


_libraries: dict[str, None] = {}
"""Libraries of games that this process has opened, in this order."""


def load_game_library(file: str | Path) -> tuple[str, ...]:
    """Open a shared library of games, which runs its code, and return the games' names.

    They are then games of this process like those that are built in, Gymnasium ids included.

    Raises:
        ValueError: it cannot be opened, was built against another version of sim2vr, or has a game
            of a name that is taken.
    """
    real = os.path.realpath(file)
    names = tuple(load_runtime().load_game_library(real))
    register_games({describe_game(name).id: name for name in names})
    _libraries[real] = None
    return names


def loaded_game_libraries() -> tuple[str, ...]:
    """Return the libraries that this process has opened; servers that it starts open them too."""
    return tuple(_libraries)


def require_game_library(file: str | Path) -> None:
    """Check that a library of games that a configuration names was opened.

    Raises:
        ValueError: it was not: no one has agreed to run its code.
    """
    if os.path.realpath(file) not in _libraries:
        raise ValueError(
            f"app.game_library: got {str(file)!r}, code that you have not run before; expected "
            "--trust-app, if you know where it comes from, or, in Python, "
            "sim2vr_harness.client.load_game_library(FILE) before"
        )


def list_options(name: str) -> tuple[GameOption, ...]:
    """The options of the runtime's game of that name, by name.

    Raises:
        ValueError: There is no such game; names the nearest.
    """
    options = TypeAdapter(tuple[GameOption, ...])
    return options.validate_json(load_runtime().game_options(name))


def facts_of_outside(name: str) -> GameFacts:
    """Return the expected facts of an app that publishes none, such as a Unity build.

    These are the facts of the runtime's game of the same name, if there is one; see
    :meth:`GameFacts.with_log`.
    """
    if name in list_games():
        told = describe_game(name)
        return replace(told, published=False, devices=(), inputs=(), hand_option=None)
    return GameFacts(name=name, published=False)


def read_facts(told: Mapping[str, Any]) -> GameFacts:
    """Read the facts that a game publishes as JSON (app_runtime/server/protocol2.md, hello).

    Raises:
        BadReply: A field is missing, or has another type.
    """
    return checked("facts", TypeAdapter(GameFacts), told)


# --- timelines -------------------------------------------------------------------------------


@dataclass(frozen=True)
class TimelineItem:
    """A thing that comes at a time.

    Attributes:
        time_s: When, s after the round's start.
        lane: Where, counted from the lowest lane; may lie between two.
        shape: ``box``, ``disc``, ``dot`` or ``bar``.
        color: ``#rrggbb``.
        kind: For the legend.
        duration_s: Of a bar.
        lanes: Of a bar, upwards from ``lane``.
        arrow_deg: Direction of an arrow on it, counter-clockwise from right; None: it has none.
        marked: Something is wrong with it.
    """

    time_s: float
    lane: float
    shape: str
    color: str
    kind: str
    duration_s: float = 0.0
    lanes: float = 1.0
    arrow_deg: float | None = None
    marked: bool = False


@dataclass(frozen=True)
class Timeline:
    """Course of a round: items with their times, and beats.

    Attributes:
        lanes: Names of the lanes, from the lowest.
        facts: Label and text or number, in the order of display.
        level: The level in the game's own format, to play it elsewhere.
    """

    name: str
    length_s: float
    lanes: tuple[str, ...]
    beats_s: tuple[float, ...]
    items: tuple[TimelineItem, ...]
    facts: Mapping[str, Any]
    level: Mapping[str, Any] = field(default_factory=dict)


def describe_level(game: str, options: Mapping[str, OptionValue], seed: int) -> Timeline:
    """Return the timeline of the round that these options and this seed start.

    Raises:
        ValueError: There is no such game, it has no levels, or it refuses the options.
    """
    text = json.dumps(plain_options(options))
    level = load_runtime().game_timeline(game, text, checked_seed(seed))
    return TypeAdapter(Timeline).validate_json(level)
