"""A run is a list of stages: what a stage is, and the one place that runs them.

Whatever a stage learns, it is stopped, saved, resumed and reported on in the same way. A stage
remembers its last consistent moment; :func:`run_stages` lets it write that moment however the stage
ends, and a resumed run continues to the same bits.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

from rich.console import Console

from sim2vr_harness.base.signals import interrupts_ignored, sigterm_interrupts
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.run.progress import StageDisplay, View
from sim2vr_harness.training.run.stopwatch import Stopwatch


class StageStopped(Exception):
    """The ``stop`` callback requested the end of the training."""


@dataclass(frozen=True)
class Report:
    """How far a training is; what a ``report`` callback gets.

    Attributes:
        stage: name of the stage.
        number: which stage it is, from 1.
        stages: how many the run has.
        done: how far the stage is, of ``total``.
        total: where the stage ends.
        unit: what ``done`` counts: ``cycles``, ``frames`` or ``user steps``.
        values: the row of the stage's log that this report goes with.
    """

    stage: str
    number: int
    stages: int
    done: float
    total: float
    unit: str
    values: Mapping[str, Any]


class Stage(Protocol):
    """A part of a run that learns something and leaves it in the run's folder.

    Attributes:
        name: of the stage, and of its folder unless it is the last one.
        title: one sentence for people: who learns what.
        total: where it ends, in ``unit``.
        unit: what it counts.
    """

    name: str
    title: str
    total: float
    unit: str

    @property
    def begun(self) -> bool:
        """Whether the folder holds something of it to go on from; stages before it are over."""

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""

    @property
    def saved(self) -> str:
        """What the folder holds of it, for people: ``cycle 3 of 22``."""

    def open(self) -> None:
        """Make what is expensive, of the settings and of what the stages before it have left.

        Raises:
            InputError: a setting cannot be used.
        """

    def run(self, callbacks: Callbacks) -> None:
        """Go on from what the folder holds to the end."""

    def save(self) -> None:
        """Write the last consistent moment, unless it is on disk; called however ``run`` ended."""

    def close(self) -> None:
        """Free what :meth:`open` has made."""

    def tidy(self) -> None:
        """Delete what a finished stage left because it was killed while it deleted it."""


class Callbacks:
    """What a stage calls while it runs.

    Args:
        stage: which one.
        number: its place in the run, from 1.
        stages: how many there are.
        folder: of the run.
        display: shows how far it is.
        report: called with every row of the stage's log.
        stop: asked at every step; True ends the training.
    """

    def __init__(
        self,
        stage: Stage,
        number: int,
        stages: int,
        folder: RunFolder,
        display: StageDisplay,
        report: Callable[[Report], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        self._stage, self._number, self._stages = stage, number, stages
        self._folder, self._display = folder, display
        self._report, self._stop = report, stop
        self.watch = Stopwatch()
        """Times of the stage's parts."""

    def doing(self, part: str) -> None:
        """Say what the stage does from now on, for the table of its times."""
        self.watch.begin(part)

    def show(self, view: Callable[[], View], *, force: bool = False) -> None:
        """Show how far the stage is; to be called often.

        Args:
            view: asked whenever something is drawn.
            force: print a line even if the last one is recent.

        Raises:
            StageStopped: the ``stop`` callback says so.
        """
        self._display.update(view, force=force)
        self.check()

    def check(self) -> None:
        """Raise :class:`StageStopped` if the ``stop`` callback says so."""
        if self._stop is not None and self._stop():
            raise StageStopped

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self._display.say(text)

    def report(self, done: float, values: Mapping[str, Any]) -> None:
        """Pass on a row of the stage's log."""
        if self._report is not None:
            stage = self._stage
            where = (stage.name, self._number, self._stages)
            self._report(Report(*where, done, stage.total, stage.unit, values))

    def note(self, **values: Any) -> None:
        """Write what is known of the session into run.json."""
        self._folder.note_session(**values)


@dataclass
class StageOutcome:
    """How a session ended.

    Attributes:
        status: ``finished``, ``interrupted`` (Ctrl-C, SIGTERM), ``stopped`` (by the callback) or
            ``failed``.
        stage: name of the last stage that ran; empty if there was nothing to do.
        saved: what that stage has saved, for people.
        seconds: wall time of each stage that ran.
    """

    status: str = "finished"
    stage: str = ""
    saved: str = ""
    seconds: dict[str, float] = field(default_factory=dict)


def remaining(stages: Sequence[Stage]) -> list[tuple[int, Stage]]:
    """Return the stages that are left to do, numbered from 1."""
    first = max((k for k, stage in enumerate(stages) if stage.begun), default=0)
    return [(k + 1, stage) for k, stage in enumerate(stages) if k >= first and not stage.finished]


def run_stages(
    stages: Sequence[Stage],
    folder: RunFolder,
    console: Console,
    *,
    opened: Stage | None = None,
    report: Callable[[Report], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> StageOutcome:
    """Run what is left of a run's stages, one after the other.

    Args:
        stages: all of the run's.
        folder: of the run; every stage's wall time is noted in it.
        console: where to show how far it is.
        opened: the stage that was opened already.
        report: see :class:`Callbacks`.
        stop: see :class:`Callbacks`.

    Returns:
        How it ended. An error passes through, after the stage has saved.
    """
    outcome = StageOutcome()
    for stage in stages:
        if stage.finished:
            stage.tidy()
    with sigterm_interrupts():
        for number, stage in remaining(stages):
            outcome.stage = stage.name
            if len(stages) > 1:
                say_line(console, f"Stage {number} of {len(stages)}: {stage.title}")
            began = time.monotonic()
            display = StageDisplay(stage.name, stage.total, console)
            callbacks = Callbacks(stage, number, len(stages), folder, display, report, stop)
            outcome.status = "failed"
            try:
                outcome.status = _run(stage, callbacks, display, opened=stage is opened)
            finally:
                with interrupts_ignored():
                    stage.save()
                    stage.close()
                    outcome.saved = stage.saved
                    outcome.seconds[stage.name] = time.monotonic() - began
                    callbacks.watch.stop()
                    _add_seconds(folder, stage.name, outcome.seconds[stage.name], callbacks.watch)
                    folder.end_session(status=outcome.status, stage=stage.name)
            if outcome.status != "finished":
                break
    return outcome


def _run(stage: Stage, callbacks: Callbacks, display: StageDisplay, *, opened: bool) -> str:
    """Run a stage and return its status."""
    try:
        if not opened:
            stage.open()
        with display:
            stage.run(callbacks)
    except KeyboardInterrupt:
        return "interrupted"
    except StageStopped:
        return "stopped"
    return "finished"


def say_line(console: Console, text: str) -> None:
    """Print a line as it is, however long."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def _add_seconds(folder: RunFolder, stage: str, seconds: float, watch: Stopwatch) -> None:
    """Add times to ``stage_seconds`` and ``stage_parts`` in run.json."""
    known = folder.metadata()
    all_seconds = dict(known.get("stage_seconds", {}))
    all_seconds[stage] = round(all_seconds.get(stage, 0.0) + seconds, 1)
    parts = dict(known.get("stage_parts", {}).get(stage, {}))
    for name, part in watch.parts.items():
        old = parts.get(name, {"seconds": 0.0, "cpu_seconds": 0.0})
        parts[name] = {key: round(old[key] + value, 1) for key, value in asdict(part).items()}
    all_parts = dict(known.get("stage_parts", {})) | {stage: parts}
    folder.note(stage_seconds=all_seconds, stage_parts=all_parts)
