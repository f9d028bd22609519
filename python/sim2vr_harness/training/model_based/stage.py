"""Stages of model-based trainings: cycle after cycle, saved after each."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar

from stable_baselines3.common.utils import get_device

from sim2vr_harness.base.finite import require_finite
from sim2vr_harness.policies.teacher import new_teacher
from sim2vr_harness.runs.checkpoint import take_in, write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import append_row, keep_rows
from sim2vr_harness.training.model_based.game_task import CycleReport, game_trainer
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer
from sim2vr_harness.training.run.progress import View
from sim2vr_harness.training.run.stage import Callbacks
from sim2vr_harness.training.teacher.env import TeacherSimulation

_STATE, _LOG = "state.pt", "cycles.jsonl"


class CycleStage(ABC):
    """See :class:`~sim2vr_harness.training.run.stage.Stage`.

    Args:
        config: of the run.
        folder: of the stage.
        cycles: how many.
    """

    name: str
    title: str
    unit = "cycles"
    result: ClassVar[str]
    """Name of the file that holds what is learned, once all cycles are over."""
    state_of: ClassVar[str]
    """What the file of the trainer's state is called in errors."""

    def __init__(self, config: TrainingConfig, folder: Path, cycles: int) -> None:
        self._config, self.folder = config, folder
        self.total = float(cycles)
        self._trainer: ModelBasedTrainer[Any] | None = None
        self._state: dict[str, Any] | None = None
        """After the last cycle, unless it is on disk."""
        self._cycles_saved = 0

    @property
    def begun(self) -> bool:
        """See the protocol."""
        return self.finished or (self.folder / _STATE).is_file()

    @property
    def finished(self) -> bool:
        """See the protocol."""
        return (self.folder / self.result).is_file()

    @property
    def saved(self) -> str:
        """See the protocol."""
        return f"cycle {self._cycles_saved} of {self.total:.0f}" if self._cycles_saved else ""

    @abstractmethod
    def open(self) -> None:
        """See the protocol; makes the trainer."""

    @abstractmethod
    def describe(self, report: Any) -> str:
        """Return one line, for people, of a cycle."""

    @abstractmethod
    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        """Write what is learned; ``report`` is that of the last cycle, None before a first one."""

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        trainer, file = self._trainer, self.folder / _STATE
        assert trainer is not None
        if file.is_file():
            take_in(file, self.state_of, lambda state: _load(trainer, state))
            callbacks.say(f"Continuing after cycle {trainer.cycle}.")
        self._cycles_saved = trainer.cycle
        callbacks.say(f"Imagined rollouts on {trainer.device}.")
        log = self.folder / _LOG
        self.folder.mkdir(parents=True, exist_ok=True)
        keep_rows(log, lambda row: row["cycle"] <= trainer.cycle)
        report, cycle_s = None, None
        while not trainer.finished:
            began, first = time.monotonic(), trainer.cycle == 0
            report = self._cycle(trainer, callbacks, cycle_s)
            if not first:  # which takes longer
                cycle_s = time.monotonic() - began
            append_row(log, asdict(report))
            state = trainer.state_dict()
            _require_finite(state, trainer.cycle, file if file.is_file() else None)
            self._state = state
            self.save()
            callbacks.say(self.describe(report))
            callbacks.report(report.cycle, asdict(report))
        self.write_result(self.folder / self.result, trainer, report)
        self.tidy()

    def _cycle(
        self, trainer: ModelBasedTrainer[Any], callbacks: Callbacks, cycle_s: float | None
    ) -> Any:
        began, cycle = time.monotonic(), trainer.cycle

        def show(doing: str, share: float) -> None:
            def view() -> View:
                left = None
                if cycle_s is not None:
                    spent = min(time.monotonic() - began, cycle_s)
                    left = (self.total - cycle) * cycle_s - spent
                text = f"cycle {cycle + 1} of {self.total:.0f}: {doing}"
                return View(cycle + share, text, left)

            callbacks.doing(doing)
            callbacks.show(view)

        return trainer.step(show)

    def save(self) -> None:
        """See the protocol."""
        if self._state is not None:
            assert self._trainer is not None
            write_tensors(self.folder / _STATE, self._state)
            self._state, self._cycles_saved = None, self._trainer.cycle

    def tidy(self) -> None:
        """See the protocol."""
        (self.folder / _STATE).unlink(missing_ok=True)

    def close(self) -> None:
        """See the protocol."""
        self._trainer = self._state = None


def _load(trainer: ModelBasedTrainer[Any], state: Mapping[str, Any]) -> None:
    trainer.load_state_dict(state)
    _require_finite(trainer.state_dict(), trainer.cycle, None)


def _require_finite(state: Mapping[str, Any], cycle: int, last_good: Path | None) -> None:
    """Check what is learned of a trainer's state; see :func:`require_finite`."""
    learned = {
        "policy": state["policy"],
        "body model": state["body"],
        "critic": state["critic"],
        "optimizer": state["optimizer"],
    }
    require_finite(learned, f"after cycle {cycle}", last_good)


class ImaginedStage(CycleStage):
    """The training of a teacher in a game's model.

    Args:
        config: of the run.
        folder: of the stage.

    Raises:
        InputError: it shall begin with a teacher that is not there, or is of another kind.
    """

    name = "imagined"
    title = "a teacher learns from imagined rollouts, by gradients through a body model."
    result, state_of = "policy.pt", "the state of these rollouts"

    def __init__(self, config: TrainingConfig, folder: Path) -> None:
        super().__init__(config, folder, config.teacher.imagined.cycles)
        self._simulation: TeacherSimulation | None = None

    def open(self) -> None:
        """See the protocol."""
        config = self._config
        sim = self._simulation = TeacherSimulation(config.env, config.teacher, config.seed)
        policy = new_teacher(sim.observation_space, sim.action_space, seed=config.seed)
        device = get_device(config.device) if sim.game.on_gpu else "cpu"
        imagined, seed = config.teacher.imagined, config.seed
        self._trainer = game_trainer(imagined, policy, sim, seed=seed, device=device)

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        imagined = self._config.teacher.imagined
        if imagined.cycles <= imagined.easier_cycles:
            callbacks.say(
                f"All of the {imagined.cycles} cycles are easier than the game: senses as late, "
                f"muscles as noisy and ways as dear as they will be after {imagined.easier_cycles}."
            )
        super().run(callbacks)

    def describe(self, report: CycleReport) -> str:
        """See :class:`CycleStage`."""
        return describe(report, self.total)

    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        """See :class:`CycleStage`."""
        write_tensors(file, trainer.task.policy.state_dict())

    def close(self) -> None:
        """See the protocol."""
        super().close()
        if self._simulation is not None:
            self._simulation.close()
        self._simulation = None


def describe(report: CycleReport, cycles: float) -> str:
    """One line for people: where a cycle has led to."""

    def rates(values: Sequence[float]) -> str:
        return ", ".join("-" if math.isnan(value) else f"{value:.2f}" for value in values)

    known = any(not math.isnan(rate) for rate in report.played)
    played = f", {rates(report.played)} in the app" if known else ""
    return (
        f"Cycle {report.cycle}/{cycles:.0f}: success rates {rates(report.imagined)} in imagined "
        f"rollouts (worst cell {report.worst_cell:.2f}){played}; body model error "
        f"{1000.0 * report.place_error_m:.1f} mm in a step"
    )
