"""Tasks without code: what counts, as a configuration says it; tasks from files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from pydantic import Field, field_validator, model_validator

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import read_yaml
from sim2vr_harness.base.python_classes import load_class, words_of
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.client.devices import INPUT_NAMES
from sim2vr_harness.client.games import Measure, RewardTerm
from sim2vr_harness.client.tasks.events import EventCounter, EventRule, MeasureRule
from sim2vr_harness.client.tasks.task import FIELD, Outcome, Task, TaskMoment

SignedWeight = Annotated[float, Field(ge=-1e6, le=1e6)]
Device = Literal["head", "left_controller", "right_controller"]


class DistanceRule(Settings):
    """Distance between a device and an object of the app."""

    device: Device = "right_controller"
    """The device whose distance counts."""
    object: str | None = None
    """The object's name; of A-Frame its ``id``."""
    expression: str | None = None
    """Instead of the object's name, an expression for a place: x y z, or an object with x, y and
    z."""

    @model_validator(mode="after")
    def _one_of_two(self) -> DistanceRule:
        if (self.object is None) == (self.expression is None):
            raise ValueError("got neither or both of object and expression, expected one of them")
        return self

    @property
    def place(self) -> str:
        """The expression for the object's place."""
        return self.expression or f"locate({json.dumps(self.object)})"


class RewardRule(Settings):
    """A part of the reward: one of ``expression``, ``haptics``, ``distance`` and ``seconds``."""

    expression: str | None = None
    """A value of the app: of a page in JavaScript, of others the name of a number in their log."""
    haptics: Literal["left", "right", "any"] | None = None
    """Every vibration that the app asks this hand's controller for counts 1."""
    distance: DistanceRule | None = None
    """Metres between a device and an object."""
    seconds: Literal[True] | None = None
    """Every second counts 1."""
    per: Literal["change", "second", "step"] | None = None
    """Quantity that counts for expressions and distances. ``change``: the increase of the value in
    the step (default); ``second``: the value times the step's seconds; ``step``: the value
    itself."""
    weight: SignedWeight = 1.0
    """Factor on this part of the reward."""
    name: str | None = Field(default=None, pattern=r"^[A-Za-z]\w{0,40}$")
    """Name in the log; made of what it is unless given."""

    @model_validator(mode="after")
    def _one_kind(self) -> RewardRule:
        kinds = [
            k
            for k in ("expression", "haptics", "distance", "seconds")
            if (getattr(self, k) is not None)
        ]
        if len(kinds) != 1:
            raise ValueError(
                f"got {' and '.join(kinds) or 'none of them'}, expected one of expression, "
                "haptics, distance, seconds"
            )
        if self.per is not None and kinds[0] in ("haptics", "seconds"):
            raise ValueError(f"per: got {self.per!r} for {kinds[0]}, expected none")
        return self

    @property
    def label(self) -> str:
        """Its name in the log."""
        if self.name is not None:
            return self.name
        if self.expression is not None:
            return _name_of(self.expression)
        if self.distance is not None:
            return f"distance_{_name_of(self.distance.object or self.distance.expression or '')}"
        return "seconds" if self.seconds else f"haptics_{self.haptics}"


class TaskRules(Settings):
    """``env.app.task`` without code."""

    description: str = ""
    """Description of the task, in a sentence for readers."""
    reward: tuple[RewardRule, ...] = ()
    """One part or a list of them, which are added."""
    finished: str | None = None
    """Expression that is true when the round is over."""
    seconds: float = Field(default=60.0, ge=0.1, le=86_400.0)
    """A round is over by then."""
    values: dict[str, str] = Field(default_factory=dict)
    """Further measures: name -> expression."""
    events: tuple[EventRule, ...] = ()
    """Events of a round; :attr:`measures` count and time them."""
    measures: tuple[MeasureRule, ...] = ()
    """Measures with label, unit and direction."""
    score: str | None = None
    """The measure by which users are compared; the first expression that is rewarded."""
    devices: tuple[Literal["controller_left", "controller_right"], ...] = ()
    """Controllers without which it cannot be played."""
    inputs: tuple[str, ...] = ()
    """Inputs of the controllers that fingers work unless ``env.user.inputs`` says otherwise."""
    reset: str | None = None
    """Expression by which a page begins a round; None: it is loaded anew."""

    @field_validator("reward", mode="before")
    @classmethod
    def _one_or_many(cls, given: Any) -> Any:
        return (given,) if isinstance(given, (Mapping, RewardRule)) else given

    @field_validator("inputs")
    @classmethod
    def _known_inputs(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in INPUT_NAMES:
                raise ValueError(f"got {name!r}, expected any of {', '.join(INPUT_NAMES)}")
        return names

    @model_validator(mode="after")
    def _names_once(self) -> TaskRules:
        names = [rule.label for rule in self.reward]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"reward: got {name!r} twice, expected a name for each part")
        rewarded = {rule.label: rule.expression for rule in self.reward if rule.expression}
        # A measure may have the name of a rewarded expression, whose label and unit it gives.
        events = [rule.name for rule in self.events]
        own = [rule.name for rule in self.measures]
        for called in (events, own):
            for name in called:
                if called.count(name) > 1:
                    raise ValueError(f"got {name!r} twice, expected each name once")
        for rule in self.measures:
            described = rule.value is not None and rewarded.get(rule.name) == rule.value
            if rule.name in self.values or (rule.name in names and not described):
                raise ValueError(
                    f"measures: got {rule.name!r}, which another value is called, expected another "
                    "name"
                )
            for name in rule.events:
                if name not in events:
                    raise ValueError(
                        f"measures: got the event {name!r} of {rule.name}, expected one of "
                        f"{', '.join(events) or 'the events, of which there are none'}"
                    )
        known = [*self.values, *rewarded, *(rule.name for rule in self.measures)]
        if self.score is not None and self.score not in known:
            raise ValueError(
                f"score: got {self.score!r}, expected one of {', '.join(known) or 'no measures'}"
            )
        return self


class RuleTask(Task):
    """Task that follows :class:`TaskRules`."""

    def __init__(self, rules: TaskRules) -> None:
        self.rules = rules
        self.description = rules.description
        self.round_seconds = rules.seconds
        self.devices, self.inputs = rules.devices, rules.inputs
        self.page_reset = rules.reset
        self.values = dict(rules.values)
        rewarded = []
        for rule in rules.reward:
            if rule.expression is not None:
                self.values[rule.label] = rule.expression
                rewarded.append(rule.label)
            elif rule.distance is not None:
                self.values[rule.label] = rule.distance.place
        if rules.finished is not None:
            self.values[_FINISHED] = rules.finished
        self.values |= {rule.value: rule.reads for rule in rules.events}
        own = {rule.name: rule for rule in rules.measures}
        self.values |= {name: rule.value for name, rule in own.items() if rule.value is not None}
        self.score = rules.score or next(iter(rewarded), None)
        names = dict.fromkeys([*rewarded, *rules.values, *own])
        if self.score is not None:
            names = {self.score: None, **names}
        self.measures = tuple(
            own[name].measure(score=name == self.score)
            if name in own
            else Measure(
                name,
                name.replace("_", " ").capitalize(),
                better="higher" if name == self.score else "none",
                digits=2,
                log_key=name,
            )
            for name in names
        )
        self._events = EventCounter(rules.events, rules.measures)
        self.reward_terms = tuple(
            RewardTerm(f"reward_{rule.label}", rule.label) for rule in rules.reward
        )
        self._before: dict[str, float] = {}
        self._sums: dict[str, float] = {}

    def reset(self, moment: TaskMoment, seed: int) -> None:
        self._before = {}
        self._sums = {}
        self._events.reset(moment)
        for rule in self.rules.reward:
            if rule.expression is not None or rule.distance is not None:
                self._before[rule.label] = _amount(rule, moment)

    def step(self, moment: TaskMoment) -> Outcome:
        total = 0.0
        log: dict[str, float] = {}
        for rule in self.rules.reward:
            if rule.seconds:
                grown = moment.step_s
            elif rule.haptics is not None:
                grown = float(
                    sum(
                        pulse.amplitude > 0.0 and rule.haptics in ("any", pulse.hand)
                        for pulse in moment.haptics
                    )
                )
            else:
                amount = _amount(rule, moment)
                before, self._before[rule.label] = self._before[rule.label], amount
                grown = _PER[rule.per or "change"](amount, before, moment.step_s)
            part = rule.weight * grown
            total += part
            name = f"reward_{rule.label}"
            self._sums[name] = self._sums.get(name, 0.0) + part
            log |= {name: part, f"{name}Sum": self._sums[name]}
        finished = bool(moment.values.get(_FINISHED))
        return Outcome(total, finished, log={**log, **self._events.step(moment)})


_FINISHED = "is_finished"

_PER: dict[str, Callable[[float, float, float], float]] = {
    "change": lambda amount, before, step_s: amount - before,
    "second": lambda amount, before, step_s: amount * step_s,
    "step": lambda amount, before, step_s: amount,
}


def _amount(rule: RewardRule, moment: TaskMoment) -> float:
    if rule.distance is None:
        return moment.number(rule.label)
    gap = moment.position(rule.distance.device) - moment.place(rule.label)
    return float(np.linalg.norm(gap))


def _name_of(expression: str) -> str:
    """A name for the log: the last word of an expression."""
    words: list[str] = re.findall(r"[A-Za-z_]\w*", expression)
    return words[-1][:40] if words else "value"


# --- tasks from files ------------------------------------------------------------------------

_EXPECTED = "rules, a YAML file of them, or FILE.py:CLASS"
_CLASS = "FILE.py:CLASS with a class below sim2vr_harness.client.Task in it"


def names_code(task: str | TaskRules | None) -> bool:
    """Return whether a task is Python code, which runs when it is loaded."""
    return isinstance(task, str) and not task.endswith((".yaml", ".yml"))


def load_task(task: str | TaskRules | None) -> Task:
    """Return the task that a configuration names; None rewards nothing for a minute.

    Raises:
        InputError: there is no such file or class, or it cannot be made; one line.
    """
    if task is None:
        return RuleTask(TaskRules())
    if isinstance(task, TaskRules):
        return RuleTask(task)
    if not names_code(task):
        file = Path(task).expanduser()
        tree = read_yaml(file, "rules of a task in YAML")
        try:
            return RuleTask(TaskRules.model_validate(tree))
        except pydantic.ValidationError as error:
            raise first_problem(error, TaskRules, (str(file),)) from error
    found = load_class(
        FIELD, task, _CLASS if ".py" in task else _EXPECTED, lambda made: issubclass(made, Task)
    )
    try:
        return found()
    except Exception as error:
        raise InputError(
            FIELD, f"{task!r}, which cannot be made ({words_of(error)})", "a task without arguments"
        ) from error
