"""The stage of imagined rollouts: cycle after cycle, saved after each."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stable_baselines3.common.utils import get_device
from torch import Tensor

from sim2vr_harness.base.finite import require_finite
from sim2vr_harness.policies.state_actor_critic import new_teacher
from sim2vr_harness.runs.checkpoint import read_tensors, take_in, write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import append_row, keep_rows
from sim2vr_harness.training.model_based.game_task import CycleReport, GameTrainer, game_trainer
from sim2vr_harness.training.run.progress import View
from sim2vr_harness.training.run.stage import Callbacks
from sim2vr_harness.training.teacher.env import TeacherSimulation

__all__ = ["ImaginedStage"]

_STATE, _POLICY, _LOG = "state.pt", "policy.pt", "cycles.jsonl"


class ImaginedStage:
    """See :class:`~sim2vr_harness.training.run.stage.Stage`.

    Args:
        config: of the run.
        folder: of the stage.
        resumed: whether it goes on with what is in there.

    Raises:
        InputError: it shall begin with a teacher that is not there, or is of another kind.
    """

    name, unit = "imagined", "cycles"
    title = "a teacher learns from imagined rollouts, by gradients through a body model."

    def __init__(self, config: TrainingConfig, folder: Path) -> None:
        self._config, self.folder = config, folder
        self.total = float(config.teacher.imagined.cycles)
        self._simulation: TeacherSimulation | None = None
        self._rollouts: GameTrainer | None = None
        self._state: dict[str, Any] | None = None
        """After the last cycle, unless it is on disk."""
        self._cycle_s: float | None = None

    @property
    def begun(self) -> bool:
        """See the protocol."""
        return self.finished or (self.folder / _STATE).is_file()

    @property
    def finished(self) -> bool:
        """See the protocol."""
        return (self.folder / _POLICY).is_file()

    @property
    def saved(self) -> str:
        """See the protocol."""
        if self._cycles_saved == 0:
            return ""
        return f"cycle {self._cycles_saved} of {self.total:.0f}"

    def weights(self) -> dict[str, Tensor]:
        """Return the policy's weights after the last cycle."""
        return read_tensors(self.folder / _POLICY, "the weights of imagined rollouts")

    def open(self) -> None:
        """See the protocol."""
        config = self._config
        self._simulation = TeacherSimulation(config.env, config.teacher, config.seed)
        policy = new_teacher(
            self._simulation.observation_space,
            self._simulation.action_space,
            config.teacher.policy,
            seed=config.seed,
        )
        self._rollouts = game_trainer(
            config.teacher.imagined,
            policy,
            self._simulation,
            seed=config.seed,
            device=get_device(config.device) if self._simulation.game.on_gpu else "cpu",
        )

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        rollouts = self._rollouts
        assert rollouts is not None
        if (self.folder / _STATE).is_file():
            _restore(rollouts, self.folder / _STATE)
            callbacks.say(f"Continuing after cycle {rollouts.cycle}.")
        self._cycles_saved = rollouts.cycle
        callbacks.say(f"Imagined rollouts on {rollouts.device}.")
        imagined = self._config.teacher.imagined
        if 0 < imagined.cycles <= imagined.easier_cycles:
            callbacks.say(
                f"All of the {imagined.cycles} cycles are easier than the game: senses as late, "
                f"muscles as noisy and ways as dear as they will be after {imagined.easier_cycles}."
            )
        log = self.folder / _LOG
        self.folder.mkdir(parents=True, exist_ok=True)
        keep_rows(log, lambda row: row["cycle"] <= rollouts.cycle)
        while not rollouts.finished:
            report = self._cycle(rollouts, callbacks)
            append_row(log, asdict(report))
            state, file = rollouts.state_dict(), self.folder / _STATE
            _require_finite(state, file if file.is_file() else None)
            self._state = state
            self.save()
            callbacks.say(describe(report, self.total))
            callbacks.report(report.cycle, asdict(report))
        write_tensors(self.folder / _POLICY, rollouts.policy.state_dict())
        self.tidy()

    def _cycle(self, rollouts: GameTrainer, callbacks: Callbacks) -> CycleReport:
        began, cycle, cycle_s = time.monotonic(), rollouts.cycle, self._cycle_s

        def show(doing: str, share: float) -> None:
            def view() -> View:
                left = None
                if cycle_s is not None:
                    spent = min(time.monotonic() - began, cycle_s)
                    left = (self.total - cycle) * cycle_s - spent
                text = f"cycle {cycle + 1} of {self.total:.0f}: {doing}"
                return View(cycle + share, text, left)

            callbacks.show(view)

        report: CycleReport = rollouts.step(show)
        if cycle > 0:  # the first one takes longer
            self._cycle_s = time.monotonic() - began
        return report

    _cycles_saved = 0

    def save(self) -> None:
        """See the protocol."""
        if self._state is None:
            return
        assert self._rollouts is not None
        write_tensors(self.folder / _STATE, self._state)
        self._state, self._cycles_saved = None, self._rollouts.cycle

    def tidy(self) -> None:
        """See the protocol."""
        (self.folder / _STATE).unlink(missing_ok=True)

    def close(self) -> None:
        """See the protocol."""
        if self._simulation is not None:
            self._simulation.close()
        self._simulation = self._rollouts = self._state = None


def _restore(rollouts: GameTrainer, file: Path) -> None:
    def take(state: dict[str, Any]) -> None:
        _require_finite(state, None)
        rollouts.load_state_dict(state)

    take_in(file, "the state of these rollouts", take)


def _require_finite(state: Mapping[str, Any], last_good: Path | None) -> None:
    learned = {
        "policy": state["policy"],
        "body model": state["body"],
        "critic": state["critic"],
        "optimizer": state["optimizer"],
    }
    cycle = json.loads(state["header"])["cycle"]
    require_finite(learned, f"after cycle {cycle}", last_good)


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
