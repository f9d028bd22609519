"""Stages of model-based trainings: cycle after cycle, saved after each."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stable_baselines3.common.utils import get_device

from sim2vr_harness.base.progress import View
from sim2vr_harness.policies.teacher import new_teacher
from sim2vr_harness.runs.checkpoint import write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.training.model_based.game_task import CycleReport, game_trainer
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer
from sim2vr_harness.training.run.stage import Callbacks, Stage
from sim2vr_harness.training.teacher.env import TeacherSimulation


class CycleStage(Stage):
    """A stage of a model-based training: cycle after cycle, saved after each."""

    unit, log_file = "cycles", "cycles.jsonl"

    _learner: ModelBasedTrainer[Any]

    @property
    def done(self) -> float:
        """Cycles that are over."""
        return self._learner.cycle

    @abstractmethod
    def describe(self, report: Any) -> str:
        """Return one line, for people, of a cycle."""

    @abstractmethod
    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        """Write what is learned; ``report`` is that of the last cycle, None before a first one."""

    def learned(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return what may not be NaN."""
        names = {"policy": "task.policy", "body model": "body", "critic": "_critic"}
        return {title: state[name] for title, name in (names | {"optimizer": "_optimizer"}).items()}

    def run(self, callbacks: Callbacks) -> None:
        """Go through the cycles that are left."""
        trainer, report = self._learner, None
        self.resume(callbacks)
        callbacks.say(f"Imagined rollouts on {trainer.device}.")
        while not trainer.finished:
            cycle = trainer.cycle

            def show(doing: str, share: float, cycle: int = cycle) -> None:
                callbacks.doing(doing)
                text = f"cycle {cycle + 1} of {self.total:.0f}: {doing}"
                callbacks.show(lambda: View(cycle + share, text))

            report = trainer.step(show)
            self.remember()
            self.save()
            callbacks.say(self.describe(report))
            self.log(callbacks, asdict(report))
        self.write_result(self.folder / self.result, trainer, report)
        self.tidy()


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

    def open(self) -> None:
        """Make the teacher and its simulation."""
        config = self._config
        sim = self._simulation = TeacherSimulation(config.env, config.teacher, config.seed)
        policy = new_teacher(sim.observation_space, sim.action_space, seed=config.seed)
        device = get_device(config.device) if sim.game.on_gpu else "cpu"
        imagined, seed = config.teacher.imagined, config.seed
        self._learner = game_trainer(imagined, policy, sim, seed=seed, device=device)

    def run(self, callbacks: Callbacks) -> None:
        """Say what is easier than the game, and learn."""
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
