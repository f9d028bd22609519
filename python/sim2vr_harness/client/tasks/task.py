"""Tasks, which reward apps that report no reward; the app that one judges, and its check."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.python_classes import words_of
from sim2vr_harness.client.base import (
    AppClient,
    AppReply,
    AppValue,
    Float32Array,
    Float64Array,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.client.devices import INPUT_NAMES, DevicePoses, HapticPulse, SoundEvent
from sim2vr_harness.client.errors import AppUnsupported
from sim2vr_harness.client.games import Condition, GameFacts, Measure, RewardTerm
from sim2vr_harness.client.scene import AppScene, Observed, Observer

FIELD = "env.app.task"
CONDITION = "standard"
"""The only condition of an app that a task judges."""
DEVICES = ("head", "left_controller", "right_controller")
"""Devices whose poses a task receives."""


@dataclass(frozen=True)
class TaskMoment:
    """State that a task receives after a user step, or at the start of a round.

    Attributes:
        time_s: time since the start of the round.
        step_s: time since the previous state; 0 at the start.
        poses: poses of the devices at the end of the step, (7,) each: position x y z (m), rotation
            x y z w, app frame (left-handed, x right, y up, z forward, origin on the floor).
        haptics: vibrations that the app requested in the step.
        sounds: sounds that began in the step.
        values: values of the expressions of :attr:`Task.values`: numbers, booleans, or positions
            x y z (m, app frame); None: the app has no value at this time.
        log: the app's own named numbers; a page has none.
        app_reward: the app's own reward of the step; 0 for a page.
        app_finished: true if the app itself reports the end of the round.
        picture: (H, W, 4) uint8, with two eyes (2, H, W, 4): colour, and linear depth / 10 m. A
            view of the app's buffer, overwritten by the next step.
    """

    time_s: float
    step_s: float
    poses: DevicePoses
    haptics: tuple[HapticPulse, ...] = ()
    sounds: tuple[SoundEvent, ...] = ()
    values: Mapping[str, AppValue] = field(default_factory=dict)
    log: Mapping[str, float] = field(default_factory=dict)
    app_reward: float = 0.0
    app_finished: bool = False
    picture: UInt8Array = field(default_factory=lambda: np.zeros((1, 1, 4), np.uint8))

    def number(self, name: str, default: float = 0.0) -> float:
        """Return a value as a number, ``default`` where the app has none.

        Raises:
            KeyError: no value of that name was requested.
            TypeError: it is a place.
        """
        value = self.values[name]
        if isinstance(value, tuple):
            raise TypeError(f"{name} is a place, expected a number")
        return default if value is None else float(value)

    def place(self, name: str) -> Float64Array:
        """Return a value that is a place, (3,) x y z in m, app frame.

        Raises:
            KeyError: no value of that name was requested.
            TypeError: it is a number.
        """
        value = self.values[name]
        if not isinstance(value, tuple):
            raise TypeError(f"{name} is {value!r}, expected a place x y z")
        return np.array(value, dtype=np.float64)

    def position(self, device: str) -> Float64Array:
        """Return where a device of :data:`DEVICES` is, (3,) x y z in m, app frame.

        Raises:
            ValueError: there is no such device, or the user has none; names it.
        """
        pose = getattr(self.poses, device) if device in DEVICES else None
        if pose is None:
            raise ValueError(f"device: got {device!r}, expected one of {', '.join(DEVICES)} in use")
        found: Float64Array = np.asarray(pose, dtype=np.float64)[:3]
        return found


@dataclass(frozen=True)
class Outcome:
    """Judgement of a user step by a task.

    Attributes:
        reward: reward of the step, before effort is subtracted.
        finished: true if the round is over.
        time_feature: position in the round, -1 to 1; None: by :attr:`Task.round_seconds`.
        log: named numbers of the round so far and of the step, in addition to the values.
    """

    reward: float
    finished: bool = False
    time_feature: float | None = None
    log: Mapping[str, float] = field(default_factory=dict)


class Task:
    """Base of tasks; an instance judges the rounds of one user, one after the other.

    What a round depends on is set in :meth:`reset`: a task learns of every round's start, and its
    outcomes may depend on nothing but the moments since.

    Attributes:
        description: in a line.
        values: name -> expression that is read from the app after every step. Of a page, one in
            JavaScript: ``window.app.score``, ``locate("ball")`` for the place of an object by its
            name. Of other apps the name of a number in their log.
        measures: what tables show of a round; their keys are those of the log.
        score: name of the measure by which users are compared.
        round_seconds: a round is over by then.
        devices: controllers without which it cannot be played: ``controller_right``, ...
        inputs: of the controllers, that fingers work unless the configuration says otherwise:
            ``right.trigger``, ...
        reward_terms: parts of the reward that the log has.
        page_reset: expression by which a page begins a round; None: it is loaded anew.
    """

    description: str = ""
    values: Mapping[str, str] = {}
    measures: tuple[Measure, ...] = ()
    score: str | None = None
    round_seconds: float = 60.0
    devices: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    reward_terms: tuple[RewardTerm, ...] = ()
    page_reset: str | None = None

    def reset(self, moment: TaskMoment, seed: int) -> None:
        """Begin a round.

        Args:
            moment: the first one.
            seed: of the round.
        """

    def step(self, moment: TaskMoment) -> Outcome:
        """Judge a user step."""
        return Outcome(0.0)


def task_facts(task: Task, name: str) -> GameFacts:
    """Return what tables, curves and the command line go by.

    Args:
        name: what the app is called.
    """
    return GameFacts(
        name=name,
        description=task.description,
        round_seconds=float(task.round_seconds),
        devices=tuple(task.devices),
        measures=tuple(task.measures),
        score=task.score,
        reward_terms=tuple(task.reward_terms),
        reward_rest="rest",
        conditions=(Condition(CONDITION, "the app as it is", evaluated=True),),
        default_condition=CONDITION,
    )


# --- the app that a task judges ------------------------------------------------------------------

_EARLY_S = 1e-3
"""Frames lie a hair before whole periods; a round of 30 s ends with the one at 29.9999982 s."""


class TaskedApp(AppClient):
    """An app and what it is worth; everything else is the app's.

    A task may keep what it likes, so a round cannot be saved.

    Args:
        app: to judge; owned by this object from now on. One that answers no expressions
            reports the numbers of its log.
        task: the judge, of this app alone.
        ends: whether the task ends rounds; else only the app does.
    """

    kind = "an app that a task judges"

    def __init__(self, app: AppClient, task: Task, *, ends: bool = True) -> None:
        self.app, self.task, self._ends = app, task, ends
        self.moments: list[TaskMoment] | None = None
        """States that the task received; None unless :meth:`record` was called."""
        self.values: Mapping[str, AppValue] = {}
        """Latest values of the task's expressions."""
        self._time_s = self._start_s = 0.0
        self._poses: DevicePoses | None = None
        self._times_ns: Int64Array = np.zeros(1, np.int64)

    @property
    def capabilities(self) -> frozenset[str]:
        return self.app.capabilities - {"save", "privileged"}

    @property
    def renderer_description(self) -> str:
        return self.app.renderer_description

    @property
    def image(self) -> UInt8Array:
        return self.app.image

    @property
    def fovea(self) -> tuple[UInt8Array, Float32Array]:
        return self.app.fovea

    def record(self) -> None:
        """Keep every moment from now on in :attr:`moments`, with copies of the pictures."""
        self.moments = []

    # --- rounds --------------------------------------------------------------------------------

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        self.app.gaze = self.gaze
        reply = self.app.reset(seed, poses, options, time_ns=time_ns)
        self._time_s, self._start_s = 0.0, time_ns * 1e-9
        moment = self._moment(reply, poses, self._start_s)
        self._keep(moment)
        try:
            self.task.reset(moment, seed)
        except Exception as error:
            raise self._wrong("reset", words_of(error), "to begin a round") from error
        return self._reply(reply, moment, Outcome(0.0))

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        self.app.gaze = self.gaze
        self.app.start_step(times_ns, poses, drawn, last=last)
        self._times_ns, self._poses = np.asarray(times_ns), poses

    def finish_step(self) -> AppReply:
        """Finish the step, and let the task judge it as a whole."""
        reply = self.app.finish_step()
        assert self._poses is not None
        moment = self._moment(reply, self._poses[-1], float(self._times_ns[-1]) * 1e-9)
        self._keep(moment)
        try:
            outcome = self.task.step(moment)
        except Exception as error:
            raise self._wrong("step", words_of(error), "an Outcome") from error
        if wrong := _wrong_outcome(outcome):
            raise self._wrong("step", *wrong)
        return self._reply(reply, moment, outcome)

    def _moment(self, reply: AppReply, poses: DevicePoses, time_s: float) -> TaskMoment:
        before_s, self._time_s = self._time_s, time_s - self._start_s
        if reply.values or not self.task.values:
            values = dict(reply.values)
        else:
            for expression in self.task.values.values():
                if "locate(" in expression:
                    raise AppUnsupported(
                        f"{FIELD}: {expression} asks for an object, which pages have"
                    )
                if reply.log and expression not in reply.log:
                    raise unknown_name(FIELD, expression, reply.log)
            values = {name: reply.log.get(number) for name, number in self.task.values.items()}
        self.values = values
        return TaskMoment(
            time_s=self._time_s,
            step_s=self._time_s - before_s,
            poses=poses,
            haptics=reply.haptics,
            sounds=reply.sounds,
            values=values,
            log=reply.log,
            app_reward=reply.reward,
            app_finished=reply.finished,
            picture=self.app.image,
        )

    def _keep(self, moment: TaskMoment) -> None:
        if self.moments is not None:
            kept = {**vars(moment), "picture": moment.picture.copy()}
            self.moments.append(TaskMoment(**kept))

    # --- outcomes ------------------------------------------------------------------------------

    def _reply(self, reply: AppReply, moment: TaskMoment, outcome: Outcome) -> AppReply:
        length_s = self.task.round_seconds
        part = outcome.time_feature
        if part is None:
            part = 2.0 * min(1.0, moment.time_s / length_s) - 1.0
        late = moment.time_s >= length_s - _EARLY_S
        over = self._ends and (outcome.finished or late)
        numbers = {
            name: float(value)
            for name, value in moment.values.items()
            if isinstance(value, (bool, int, float))
        }
        return AppReply(
            reward=float(outcome.reward),
            finished=bool(reply.finished or over),
            time_feature=float(part),
            log={**reply.log, **numbers, **{key: float(v) for key, v in outcome.log.items()}},
            haptics=reply.haptics,
            sounds=reply.sounds,
            values=reply.values,
            left="" if over else reply.left,
        )

    def _wrong(self, method: str, got: str, expected: str) -> InputError:
        return InputError(f"task {type(self.task).__name__}.{method}", got, expected)

    # --- what is the app's ---------------------------------------------------------------------

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        return self.app.head_request(seed, options)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        return self.app.render_headset(width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        return self.app.render_third_person(width, height, view)

    def scene(self) -> AppScene:
        return self.app.scene()

    def observe(self, observers: Sequence[Observer]) -> None:
        self.app.observe(observers)

    def observed(self) -> tuple[Observed, ...]:
        return self.app.observed()

    def close(self) -> None:
        self.app.close()


# --- check ---------------------------------------------------------------------------------------

_CONTROLLERS = ("controller_left", "controller_right")


def check_task(task: Task, moments: Sequence[TaskMoment], seed: int = 1) -> list[str]:
    """Return what is wrong with a task, a sentence each; nothing if all is well.

    Args:
        task: to check; its present round is lost.
        moments: of one round that was played, the reset's first (:meth:`TaskedApp.record`).
        seed: of the round.
    """
    problems = []
    if not isinstance(task.values, Mapping) or not all(
        isinstance(name, str) and isinstance(value, str) and value.strip()
        for name, value in task.values.items()
    ):
        problems.append(f"values: got {task.values!r}, expected names and expressions, all text")
    if not 0.0 < task.round_seconds < math.inf:
        problems.append(f"round_seconds: got {task.round_seconds}, expected a number above 0")
    for name in task.devices:
        if name not in _CONTROLLERS:
            problems.append(f"devices: got {name!r}, expected any of {', '.join(_CONTROLLERS)}")
    for name in task.inputs:
        if name not in INPUT_NAMES:
            problems.append(f"inputs: got {name!r}, expected any of {', '.join(INPUT_NAMES)}")
    measures: Sequence[object] = task.measures
    for measure in measures:
        if not isinstance(measure, Measure):
            problems.append(f"measures: got {measure!r}, expected Measure(...)")
    names = [one.name for one in measures if isinstance(one, Measure)]
    if task.score is not None and task.score not in names:
        problems.append(f"score: got {task.score!r}, expected one of {', '.join(names) or 'none'}")
    if len(moments) < 2:
        return [*problems, f"moments: got {len(moments)}, expected a reset and steps"]
    first, wrong = _judged(task, moments, seed)
    if wrong:
        return [*problems, wrong]
    if _judged(task, moments, seed) != (first, ""):
        problems.append(
            "reset: got other outcomes when the same round was judged again, expected equal ones: "
            "reset has to begin everything anew"
        )
    if not any(outcome.reward for outcome in first):
        problems.append(
            f"reward: got 0 in all of the {len(first)} steps, expected some that are rewarded; "
            "check the task's reward, or play longer or better"
        )
    known = {key for moment in moments for key in (*moment.values, *moment.log)}
    known |= {key for outcome in first for key in outcome.log}
    for measure in task.measures:
        if measure.grid is None and measure.log_key not in known:
            problems.append(
                f"measures: {measure.name} reads {measure.log_key!r} from the log, expected one of "
                f"{', '.join(sorted(known)) or 'no numbers'}"
            )
    for name in task.values:
        if all(moment.values.get(name) is None for moment in moments):
            problems.append(f"values: {name} had no value in the round, expected one")
    return problems


def _judged(task: Task, moments: Sequence[TaskMoment], seed: int) -> tuple[list[Outcome], str]:
    """The outcomes of a round, and what went wrong in it first."""
    outcomes: list[Outcome] = []
    doing = "reset"
    try:
        task.reset(moments[0], seed)
        for number, moment in enumerate(moments[1:], start=1):
            doing = f"step {number}"
            outcome = task.step(moment)
            if wrong := _wrong_outcome(outcome):
                return outcomes, f"{doing}: got {wrong[0]}, expected {wrong[1]}"
            outcomes.append(outcome)
    except Exception as error:
        return outcomes, f"{doing}: raised {words_of(error)}"
    return outcomes, ""


def _wrong_outcome(outcome: object) -> tuple[str, str] | None:
    """Return the unusable part of a task's answer to a step: got and expected; None: none."""
    if not isinstance(outcome, Outcome):
        return type(outcome).__name__, "an Outcome"
    for name, number in {"reward": outcome.reward, **outcome.log}.items():
        try:
            finite = math.isfinite(number)
        except TypeError:
            finite = False
        if not finite:
            return f"{name}={number!r}", "finite numbers"
    part = outcome.time_feature
    if part is not None and not -1.0 <= part <= 1.0:
        return f"time_feature={part!r}", "-1 to 1"
    return None
