"""Events of a task and what is measured by them: counts, proportions, times between two."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from sim2vr_harness.base.settings import Settings
from sim2vr_harness.client.games import Measure
from sim2vr_harness.client.tasks.task import TaskMoment

_NAME = r"^[A-Za-z]\w{0,40}$"
EVENT_VALUE = "event_"
"""Names of the values that events read begin so."""
_MOVED_M = 0.01
_DIGITS = 2


class ObjectRule(Settings):
    """A change of an object."""

    object: str
    """The object's name; of A-Frame its ``id``."""
    becomes: Literal["present", "absent", "moved"]
    """``moved``: by more than 1 cm since it last was an event, or since the round began."""

    @property
    def expression(self) -> str:
        """The expression for the object's place; null: there is none."""
        name = json.dumps(self.object)
        return f"(() => {{ try {{ return locate({name}); }} catch {{ return null; }} }})()"


class EventRule(Settings):
    """Something that happens in a round: ``expression`` or ``on``."""

    name: str = Field(pattern=_NAME)
    """Its name."""
    expression: str | None = None
    """The event happens when it turns true; of a number, as often as it grows by 1."""
    on: ObjectRule | None = None
    """The event happens when the object becomes so."""

    @model_validator(mode="after")
    def _one_of_two(self) -> EventRule:
        if (self.expression is None) == (self.on is None):
            raise ValueError("got neither or both of expression and on, expected one of them")
        return self

    @property
    def value(self) -> str:
        """Name of the value that it reads."""
        return f"{EVENT_VALUE}{self.name}"

    @property
    def reads(self) -> str:
        """The expression that it reads."""
        if self.on is not None:
            return self.on.expression
        assert self.expression is not None
        return self.expression


class TimeRule(Settings):
    """Seconds from an event to another."""

    start: str | None = None
    """The first event, the latest one counts; None: the previous ``end``, or the round's start."""
    end: str
    """The second event."""


class ProportionRule(Settings):
    """Proportion of an event: its count divided by the counts of two events together."""

    of: str
    """The event."""
    other: str
    """The other event."""


class MeasureRule(Settings):
    """A measure: one of ``value``, ``count``, ``proportion`` and ``time``."""

    name: str = Field(pattern=_NAME)
    """Key in results."""
    value: str | None = None
    """An expression; the measure is its value at the end of the round."""
    count: str | None = None
    """Event whose number of occurrences is the measure."""
    proportion: ProportionRule | None = None
    """Two events; the measure is the proportion of the first."""
    time: TimeRule | None = None
    """Mean seconds between two events."""
    label: str = Field(default="", max_length=80)
    """For tables, without the unit; made of the name unless given."""
    unit: str = Field(default="", max_length=20)
    """Such as ``m/s``; of a time ``s``."""
    better: Literal["higher", "lower", "none"] | None = None
    """Direction of better values; None: lower for times, none for others."""
    digits: int = Field(default=_DIGITS, ge=0, le=6)
    """Behind the decimal point, for tables."""
    description: str = Field(default="", max_length=300)
    """Explanation of the label for readers."""

    @model_validator(mode="after")
    def _one_kind(self) -> MeasureRule:
        kinds = ("value", "count", "proportion", "time")
        given = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(
                f"got {' and '.join(given) or 'none of them'}, expected one of {', '.join(kinds)}"
            )
        return self

    @property
    def events(self) -> list[str]:
        """Names of the events that it needs."""
        if self.time is not None:
            return [name for name in (self.time.start, self.time.end) if name is not None]
        if self.proportion is not None:
            return [self.proportion.of, self.proportion.other]
        return [] if self.count is None else [self.count]

    def measure(self, *, score: bool) -> Measure:
        """Return the measure for tables; of the score, more is better unless it says otherwise."""
        usual: Literal["higher", "lower", "none"] = "higher" if score else "none"
        key, rate_with, only_if = self.name, None, None
        if self.count is not None:
            key = count_key(self.count)
        elif self.proportion is not None:
            key, rate_with = count_key(self.proportion.of), count_key(self.proportion.other)
        elif self.time is not None:
            usual, only_if = "lower", f"{self.name}_n"
        return Measure(
            self.name,
            self.label or self.name.replace("_", " ").capitalize(),
            unit=self.unit or ("s" if self.time is not None else ""),
            better=self.better or usual,
            digits=self.digits,
            log_key=key,
            rate_with=rate_with,
            only_if=only_if,
            description=self.description,
        )


def count_key(event: str) -> str:
    """Return the log's number of how often an event happened."""
    return f"{event}_count"


class EventCounter:
    """Counts the events of a round, and the times between them.

    Args:
        events: To count.
        measures: Those with a time are measured.
    """

    def __init__(self, events: Sequence[EventRule], measures: Sequence[MeasureRule]) -> None:
        self._events = tuple(events)
        self._times = {one.name: one.time for one in measures if one.time is not None}

    def reset(self, moment: TaskMoment) -> None:
        """Begin a round; what is true or present then has happened at its start, for times only."""
        self._counts = {one.name: 0 for one in self._events}
        self._sums = {name: (0.0, 0) for name in self._times}
        self._before = {one.name: moment.values.get(one.value) for one in self._events}
        begun = {
            one.name
            for one in self._events
            if self._before[one.name] is True
            or (one.on is not None and _holds(one.on, self._before[one.name]))
        }
        self._starts: dict[str, float | None] = {
            name: 0.0 if time.start is None or time.start in begun else None
            for name, time in self._times.items()
        }

    def step(self, moment: TaskMoment) -> Mapping[str, float]:
        """Return the numbers of the round so far for the log."""
        happened = {one.name: self._happened(one, moment) for one in self._events}
        for name, times in happened.items():
            self._counts[name] += times
        log: dict[str, float] = {count_key(name): float(n) for name, n in self._counts.items()}
        for name, time in self._times.items():
            self._measure(name, time, happened, moment.time_s)
            total_s, count = self._sums[name]
            log |= {name: total_s / count if count else 0.0, f"{name}_n": float(count)}
        return log

    def _measure(
        self, name: str, time: TimeRule, happened: Mapping[str, int], now_s: float
    ) -> None:
        """End before starting: what is selected may show the next in the same step."""
        start_s = self._starts[name]
        if happened[time.end] and start_s is not None:
            total_s, count = self._sums[name]
            self._sums[name] = total_s + now_s - start_s, count + 1
            self._starts[name] = now_s if time.start is None else None
        if time.start is not None and happened[time.start]:
            self._starts[name] = now_s

    def _happened(self, event: EventRule, moment: TaskMoment) -> int:
        """Return how often an event happened in the step."""
        now, before = moment.values.get(event.value), self._before[event.name]
        if event.on is None:
            self._before[event.name] = now
            if isinstance(now, tuple) or isinstance(before, tuple):
                raise ValueError(f"events: {event.name} is a place, expected a number or a truth")
            return max(0, round(float(now or 0.0) - float(before or 0.0)))
        if event.on.becomes == "moved":
            if now is None or before is None:
                self._before[event.name] = before if now is None else now
                return 0
            moved = float(np.linalg.norm(np.subtract(now, before))) > _MOVED_M
            if moved:
                self._before[event.name] = now
            return int(moved)
        self._before[event.name] = now
        return int(_holds(event.on, now) and not _holds(event.on, before))


def _holds(rule: ObjectRule, place: object) -> bool:
    """Return whether an object is present or absent, as the rule requires."""
    return rule.becomes != "moved" and (place is not None) == (rule.becomes == "present")
