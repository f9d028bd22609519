"""An app that a task judges: an :class:`AppClient` with another reward, end and log."""

import math
from collections.abc import Mapping

import numpy as np

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.python_classes import words_of
from sim2vr_harness.client.base import (
    AppClient,
    AppReply,
    AppValue,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import AppUnsupported
from sim2vr_harness.client.scene import AppScene
from sim2vr_harness.client.tasks.loading import FIELD
from sim2vr_harness.client.tasks.task import Outcome, Task, TaskMoment

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
        """What the task received, where someone wants it recorded; see :meth:`record`."""
        self._time_s = self._start_s = 0.0
        self.values: Mapping[str, AppValue] = {}
        """What the expressions of the task were last."""
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
        self.app.start_step(times_ns, poses, drawn, last=last)
        self._times_ns, self._poses = np.asarray(times_ns), poses

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`; the task judges the step as a whole."""
        reply = self.app.finish_step()
        assert self._poses is not None
        moment = self._moment(reply, self._poses[-1], float(self._times_ns[-1]) * 1e-9)
        self._keep(moment)
        try:
            outcome = self.task.step(moment)
        except Exception as error:
            raise self._wrong("step", words_of(error), "an Outcome") from error
        if not isinstance(outcome, Outcome):
            raise self._wrong("step", type(outcome).__name__, "an Outcome")
        numbers = {"reward": outcome.reward, **outcome.log}
        if outcome.time_feature is not None:
            numbers["time_feature"] = outcome.time_feature
        for name, number in numbers.items():
            try:
                finite = math.isfinite(number)
            except TypeError:
                finite = False
            if not finite:
                raise self._wrong("step", f"{name}={number!r}", "finite numbers")
        checked = outcome
        return self._reply(reply, moment, checked)

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

    def close(self) -> None:
        self.app.close()
