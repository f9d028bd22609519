"""A run is a list of stages: what a stage is, and the one place that runs them.

Whatever a stage learns, it is stopped, saved, resumed and reported on in the same way. A stage
remembers its last consistent moment; :func:`run_stages` lets it write that moment however the stage
ends, and a resumed run continues to the same bits.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from sim2vr_harness.base.finite import NotFinite, require_finite
from sim2vr_harness.base.progress import ProgressDisplay, View
from sim2vr_harness.base.signals import interrupts_ignored, sigterm_interrupts
from sim2vr_harness.runs.checkpoint import take_in, write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder, append_row, keep_rows


class StageStopped(Exception):
    """The ``stop`` callback requested the end of the training."""


@dataclass(frozen=True)
class Report:
    """Progress of a training, as a ``report`` callback receives it.

    Attributes:
        stage: name of the stage.
        number: of the stage, from 1.
        stages: number of stages of the run.
        done: progress of the stage, out of ``total``.
        total: value of ``done`` at which the stage ends.
        unit: what ``done`` counts: ``cycles``, ``frames`` or ``user steps``.
        values: the row of the stage's log that belongs to this report.
    """

    stage: str
    number: int
    stages: int
    done: float
    total: float
    unit: str
    values: Mapping[str, Any]


class Stage(ABC):
    """A part of a run that trains something and saves it in the run's folder.

    A subclass makes its learner in :meth:`open` and trains it in :meth:`run`; a stopped stage
    continues from the learner's ``state_dict``. Subclasses set the attributes below.

    Args:
        total: value of ``done`` at which it ends, in ``unit``.
    """

    name: str
    """Of the stage, and of its folder unless it is the last one."""
    title: str
    """One sentence on what the stage trains."""
    unit: str
    """Unit of the stage's progress, such as ``cycles``."""
    result: str
    """Name of the file with the trained result, written at the end of the stage."""
    state_of = "the state of this stage"
    """Name in error messages of the file that holds the learner's state."""
    log_file = "metrics.jsonl"
    leftovers: tuple[str, ...] = ()
    """Patterns of further files that are deleted when the stage is over."""

    def __init__(self, config: TrainingConfig, folder: Path, total: float) -> None:
        self._config, self.folder, self.total = config, folder, float(total)
        self.state_file = folder / "state.pt"
        self._learner: Any = None
        self._simulation: Any = None
        self._state: dict[str, Any] | None = None
        """After the last consistent moment, unless it is on disk, and how far that was."""
        self._remembered = self._saved = 0.0

    @property
    def begun(self) -> bool:
        """Return whether the folder holds a saved state or the result of this stage.

        The stages before it are then finished.
        """
        return self.finished or self.state_file.is_file()

    @property
    def finished(self) -> bool:
        """Return whether the stage has written its result."""
        return (self.folder / self.result).is_file()

    @property
    def saved(self) -> str:
        """Saved progress as text, for example ``3 of 22 cycles``."""
        return f"{self._saved:,.0f} of {self.total:,.0f} {self.unit}" if self._saved else ""

    @property
    def work(self) -> float:
        """End of the progress bar: ``total``, or a quantity that takes equally long per unit."""
        return self.total

    @property
    @abstractmethod
    def done(self) -> float:
        """Progress of the learner, in ``unit``."""

    @abstractmethod
    def open(self) -> None:
        """Make what is expensive, from the settings and the results of the stages before.

        Raises:
            InputError: a setting cannot be used.
        """

    @abstractmethod
    def run(self, callbacks: Callbacks) -> None:
        """Continue from the folder's state and train to the end."""

    def learned(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parts of a learner's state that must be finite, by their names."""
        raise NotImplementedError

    # --- what a subclass calls in run ----------------------------------------------------------

    def resume(self, callbacks: Callbacks) -> None:
        """Let the learner continue from the folder's state, and drop later rows of the log."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.state_file.is_file():
            take_in(self.state_file, self.state_of, self.take)
            callbacks.say(f"Continuing after {self.done:,.0f} {self.unit}.")
        self._saved = self.done
        keep_rows(self.folder / self.log_file, lambda row: row[self._log_key] <= self.done)

    def take(self, state: dict[str, Any]) -> None:
        """Let the learner continue from a state."""
        self._require_finite(state, None)
        self._learner.load_state_dict(state)

    def log(self, callbacks: Callbacks, row: Mapping[str, Any]) -> None:
        """Write a row of the stage's log, and pass it on."""
        append_row(self.folder / self.log_file, row)
        callbacks.report(self.done, row)

    def remember(self) -> None:
        """Store the learner's state, which the stage saves however it ends.

        Raises:
            NotFinite: the learner is spoilt; the state before it is written.
        """
        state = self._learner.state_dict()
        try:
            self._require_finite(state, None)
        except NotFinite:
            self.save()
            self._require_finite(state, self.state_file if self.state_file.is_file() else None)
        self._state, self._remembered = state, self.done

    # --- what the runner calls -----------------------------------------------------------------

    def save(self) -> None:
        """Write the last consistent moment, unless it is on disk; called however ``run`` ended."""
        if self._state is not None:
            write_tensors(self.state_file, self._state)
            self._state, self._saved = None, self._remembered

    def close(self) -> None:
        """Free the resources that :meth:`open` has allocated."""
        if self._simulation is not None:
            self._simulation.close()
        self._simulation = self._learner = self._state = None

    def tidy(self) -> None:
        """Delete files that a finished stage does not need; also after a kill during deletion."""
        self._state = None
        for file in (self.state_file, *(f for p in self.leftovers for f in self.folder.glob(p))):
            file.unlink(missing_ok=True)

    @property
    def _log_key(self) -> str:
        return "cycle" if self.unit == "cycles" else "step"

    def _require_finite(self, state: Mapping[str, Any], last_good: Path | None) -> None:
        require_finite(self.learned(state), f"after {self.done:,.0f} {self.unit}", last_good)


@dataclass
class PartTime:
    """Time of a part of a stage.

    Attributes:
        seconds: of wall time.
        cpu_seconds: of all threads of this process.
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0


@dataclass
class Stopwatch:
    """Adds up the time of parts that alternate.

    Attributes:
        parts: their times, in the order of their first turns.
    """

    parts: dict[str, PartTime] = field(default_factory=dict)
    _now: str = "preparing"
    _began: float = field(default_factory=time.monotonic)
    _cpu_began: float = field(default_factory=time.process_time)

    def begin(self, part: str) -> None:
        """Add the following time to this part; it may be called at any rate."""
        if part == self._now:
            return
        self.stop()
        self._now = part

    def stop(self) -> None:
        """Add the time since the last call."""
        now, cpu = time.monotonic(), time.process_time()
        part = self.parts.setdefault(self._now, PartTime())
        part.seconds += now - self._began
        part.cpu_seconds += cpu - self._cpu_began
        self._began, self._cpu_began = now, cpu


class Callbacks:
    """Functions that a stage calls while it runs.

    Args:
        display: shows the progress.
        report: called with every row of the stage's log.
        stop: called at every step; True ends the training.
    """

    def __init__(
        self,
        stage: Stage,
        number: int,
        stages: int,
        folder: RunFolder,
        display: ProgressDisplay,
        report: Callable[[Report], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        self._stage, self._number, self._stages = stage, number, stages
        self._folder, self._display = folder, display
        self._report, self._stop = report, stop
        self.watch = Stopwatch()
        """Times of the stage's parts."""

    def doing(self, part: str) -> None:
        """Name the stage's present activity, for the table of its times."""
        self.watch.begin(part)

    def show(self, view: Callable[[], View], *, force: bool = False) -> None:
        """Show the stage's progress; to be called often.

        Args:
            view: called whenever something is drawn.
            force: print a line even if the last one is recent.

        Raises:
            StageStopped: the ``stop`` callback returned True.
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
        """Report a row of the stage's log."""
        if self._report is not None:
            stage = self._stage
            where = (stage.name, self._number, self._stages)
            self._report(Report(*where, done, stage.total, stage.unit, values))

    def note(self, **values: Any) -> None:
        """Write values on the session into run.json."""
        self._folder.note_session(**values)


@dataclass
class StageOutcome:
    """Outcome of a session.

    Attributes:
        status: ``finished``, ``interrupted`` (Ctrl-C, SIGTERM), ``stopped`` (by the callback) or
            ``failed``.
        stage: name of the last stage that ran; empty if there was nothing to do.
        saved: the saved progress of that stage, as text.
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
    """Run the remaining stages of a run, one after the other.

    Args:
        folder: of the run; every stage's wall time is noted in it.
        console: shows the progress.
        opened: the stage that was opened already.

    Returns:
        The outcome. An error passes through, after the stage has saved.
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
            display = ProgressDisplay(stage.name, stage.work, console)
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


def _run(stage: Stage, callbacks: Callbacks, display: ProgressDisplay, *, opened: bool) -> str:
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
