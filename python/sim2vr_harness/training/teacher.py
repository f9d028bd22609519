"""The first stage of a distilled training: a teacher who knows what the picture only shows."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
import torch
import yaml
from rich.console import Console
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.training import checkpoint
from sim2vr_harness.training.callbacks import CheckpointCallback, ProgressCallback
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.imagination import Practice, PracticeReport
from sim2vr_harness.training.metrics_log import JsonLines
from sim2vr_harness.training.progress import Progress, ProgressDisplay, StageDisplay
from sim2vr_harness.training.run_folder import RunFolder, keep_rows, write_atomically
from sim2vr_harness.training.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher_env import TeacherSimulation
from sim2vr_harness.training.teacher_evaluation import TeacherScore, evaluate_teacher
from sim2vr_harness.training.teacher_policy import TeacherPolicy, TeacherPPO, build_teacher
from sim2vr_harness.training.vec_env import SimulationVecEnv

__all__ = ["TeacherResult", "load_teacher", "train_teacher"]

_CONFIG_FILE = "teacher.yaml"
_SCORES_FILE = "scores.jsonl"
_PRACTICE_FILE = "practice.jsonl"
_PRACTISED = "practised.pt"


@dataclass(frozen=True)
class TeacherResult:
    """How a session ended.

    Attributes:
        checkpoint: the newest one: the teacher.
        step: user steps taken in all sessions, as far as saved.
        interrupted: whether it was stopped by Ctrl-C or SIGTERM.
        scores: of the last evaluation.
        seconds: wall time of the session.
    """

    checkpoint: Path
    step: int
    interrupted: bool
    scores: tuple[TeacherScore, ...]
    seconds: float


@dataclass(frozen=True)
class _Phase:
    """A part of the training with one physics step: up to ``until`` user steps."""

    timestep_s: float | None
    until: int


def _phases(config: TeacherConfig) -> list[_Phase]:
    size = config.ppo.steps_per_iteration
    end = -(-config.total_timesteps // size) * size
    phases = [_Phase(None, end)]
    if config.coarse_physics_s is not None and config.coarse_until_step > 0:
        coarse = min(end, -(-config.coarse_until_step // size) * size)
        phases.insert(0, _Phase(config.coarse_physics_s, coarse))
    return phases


def train_teacher(
    config: TeacherConfig,
    env: EnvConfig,
    path: Path,
    *,
    seed: int,
    timesteps: int | None = None,
    checkpoint_every: int = 250_000,
    keep: int | None = None,
    console: Console | None = None,
) -> TeacherResult:
    """Train a teacher, or go on with the one in ``path``, exactly.

    Args:
        config: of the teacher.
        env: the true environment: user, app, rates. Pictures are not drawn.
        path: the stage's folder: checkpoints, ``metrics.jsonl``, ``scores.jsonl``.
        seed: of networks, users and games.
        timesteps: where this session stops; None goes to ``config.total_timesteps``.
        checkpoint_every: user steps between two checkpoints.
        keep: keep only so many of the newest checkpoints; None keeps all.
        console: where to report; None reports to the standard error stream.

    Raises:
        InputError: the folder holds a teacher of other settings, or the game helps no teachers.
    """
    began = time.monotonic()
    stage = _Stage(config, env, RunFolder(path), seed, console or Console(stderr=True))
    stage.open()
    stop = min(timesteps or config.total_timesteps, config.total_timesteps)
    try:
        interrupted = stage.run(stop, checkpoint_every, keep)
    finally:
        stage.close()
    newest = stage.folder.latest_checkpoint()
    return TeacherResult(
        checkpoint=newest,
        step=_step_of(newest),
        interrupted=interrupted,
        scores=tuple(stage.scores),
        seconds=time.monotonic() - began,
    )


def load_teacher(file: Path, config: TeacherConfig, env: EnvConfig) -> TeacherPolicy:
    """Return the policy of a checkpoint, ready to act.

    Args:
        file: one of a teacher's checkpoints.
        config: the teacher's.
        env: the environment it was trained for.
    """
    small = config.model_copy(
        update={
            "ppo": config.ppo.model_copy(update={"n_envs": 1}),
            "aids": config.aids.model_copy(
                update={"near_starts": config.aids.near_starts.model_copy(update={"start": 0.0})}
            ),
        }
    )
    with torch.random.fork_rng(devices=[]):
        simulation = TeacherSimulation(env, small, seed=0)
        policy = TeacherPolicy(
            simulation.observation_space,
            simulation.action_space,
            lambda _: 0.0,
            config=config.ppo,
        )
        simulation.close()
    checkpoint.load_policy_weights(file, policy)
    policy.set_training_mode(False)
    return policy


def _filled(tree: Any) -> Any:
    """What a teacher's file says, with today's defaults for settings that are younger than it."""
    try:
        return {
            "seed": tree["seed"],
            "env": EnvConfig.model_validate(tree["env"]).model_dump(mode="json"),
            "teacher": TeacherConfig.model_validate(tree["teacher"]).model_dump(mode="json"),
        }
    except (KeyError, TypeError, pydantic.ValidationError):
        return None


def _step_of(file: Path) -> int:
    return int(file.stem.removeprefix("step_"))


class _Stage:
    """One session of a teacher's training."""

    def __init__(
        self,
        config: TeacherConfig,
        env: EnvConfig,
        folder: RunFolder,
        seed: int,
        console: Console,
    ) -> None:
        self.config, self.env, self.folder, self.seed = config, env, folder, seed
        self.console = console
        self.scores: list[TeacherScore] = []
        self._model: TeacherPPO | None = None
        self._simulation: TeacherSimulation | None = None

    def open(self) -> None:
        """Check that the folder is this teacher's, or make it so."""
        file = self.folder.path / _CONFIG_FILE
        tree = {
            "seed": self.seed,
            "env": self.env.model_dump(mode="json"),
            "teacher": self.config.model_dump(mode="json"),
        }
        text = yaml.safe_dump(tree, sort_keys=False)
        if file.is_file():
            if _filled(yaml.safe_load(file.read_text(encoding="utf-8"))) != tree:
                raise InputError(
                    str(self.folder.path), "a teacher of other settings", f"those of {file}"
                )
            return
        self.folder.checkpoint_dir.mkdir(parents=True, exist_ok=True)
        write_atomically(file, text.encode())

    def run(self, stop: int, checkpoint_every: int, keep: int | None) -> bool:
        """Learn until ``stop``; returns whether it was interrupted."""
        reached = 0
        files = self.folder.checkpoints()
        if files:
            reached = _step_of(files[-1])
            if reached >= stop:
                return False
        practised = {} if files else self._practised()
        if practised is None:
            return True
        for phase in _phases(self.config):
            if phase.until < reached or (phase.until == reached and self._model is not None):
                continue
            self._enter(phase)
            assert self._model is not None
            fresh = self._model.num_timesteps == 0
            if practised and fresh:
                self._model.policy.load_state_dict(practised)
            elif files and fresh:
                checkpoint.restore(files[-1], self._model)
                self.folder.drop_metrics_after(reached)
            until = min(phase.until, stop)
            left = until - self._model.num_timesteps
            if left > 0 and self._learn(until, checkpoint_every, keep):
                return True
            reached = self._model.num_timesteps
            if reached >= stop:
                break
        return False

    def _practised(self) -> dict[str, torch.Tensor] | None:
        """The policy's weights after practice in the mind; None if it was interrupted."""
        if self.config.imagination.cycles == 0:
            return {}
        file = self.folder.path / _PRACTISED
        if not file.is_file():
            simulation = TeacherSimulation(self.env, self.config, self.seed)
            try:
                model = build_teacher(self.config.ppo, SimulationVecEnv(simulation), seed=self.seed)
                policy = model.policy
                assert isinstance(policy, TeacherPolicy)
                practice = Practice(self.config.imagination, policy, simulation, seed=self.seed)
                self._practise(practice)
                checkpoint.write_tensors(file, policy.state_dict())
                practice.discard(self.folder.path)
            except KeyboardInterrupt:
                return None
            finally:
                simulation.close()
        weights: dict[str, torch.Tensor] = torch.load(file, weights_only=True)
        return weights

    def _practise(self, practice: Practice) -> None:
        practice.restore(self.folder.path)
        log = self.folder.path / _PRACTICE_FILE
        keep_rows(log, lambda row: row["cycle"] <= practice.cycle)
        cycles = self.config.imagination.cycles
        cycle_s: float | None = None
        with StageDisplay("Practice", cycles, self.console) as display:

            def tell(doing: str, share: float) -> None:
                left = None
                if cycle_s is not None:
                    spent = min(time.monotonic() - began, cycle_s)
                    left = (cycles - practice.cycle) * cycle_s - spent
                text = f"cycle {practice.cycle + 1} of {cycles}: {doing}"
                display.update(practice.cycle + share, text, left)

            while not practice.finished:
                began, first = time.monotonic(), practice.cycle == 0
                report = practice.step(tell)
                with log.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(asdict(report)) + "\n")
                practice.save(self.folder.path)
                display.say(describe_practice(report, cycles))
                if not first:  # which takes longer
                    cycle_s = time.monotonic() - began

    def _enter(self, phase: _Phase) -> None:
        """Make the users of a phase; the learner and what it remembers of the task go on."""
        before = self._simulation
        simulation = TeacherSimulation(
            self.env,
            self.config,
            self.seed,
            postures=None if before is None else before.postures,
            physics_timestep_s=phase.timestep_s,
        )
        self._simulation = simulation
        vector = SimulationVecEnv(simulation)
        if self._model is None or before is None:
            self._model = build_teacher(self.config.ppo, vector, seed=self.seed)
            self._model.schedule_timesteps = self.config.total_timesteps
            return
        simulation.step_count = before.step_count
        simulation.fail_rates[...] = before.fail_rates
        before.close()
        vector.seed(self.seed + 1)
        self._model.set_env(vector)
        self._model._last_obs = None  # starts new rounds

    def _learn(self, until: int, checkpoint_every: int, keep: int | None) -> bool:
        model = self._model
        assert model is not None
        start = model.num_timesteps
        logger = Logger(str(self.folder.path), [JsonLines(self.folder.metrics_file)])
        model.set_logger(logger)
        size = self.config.ppo.steps_per_iteration
        progress = Progress(
            step=start,
            start_step=start,
            stop_step=-(-until // size) * size,
            iteration_steps=size,
            minibatches=size // self.config.ppo.batch_size * self.config.ppo.n_epochs,
        )
        display = ProgressDisplay(progress, self.console)
        checkpoints = CheckpointCallback(self.folder, checkpoint_every, keep)
        tracker = ProgressCallback(display)
        scorer = _ScoreCallback(self._score, self.config.evaluate_every_steps)
        interrupted = False
        try:
            with display:
                model.learn(
                    until - start,
                    callback=[checkpoints, tracker, scorer],
                    reset_num_timesteps=start == 0,
                )
                checkpoints.remember()
                scorer.score_if_due(until)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            tracker.detach()
            checkpoints.write()
            logger.close()
        return interrupted

    def _score(self, step: int) -> None:
        """Play by the true rules, and note how it went."""
        if self.config.evaluate_rounds == 0:
            return
        assert self._model is not None
        policy = self._model.policy
        assert isinstance(policy, TeacherPolicy)
        self.scores = evaluate_teacher(
            policy, self.env, self.config, rounds=self.config.evaluate_rounds
        )
        row: dict[str, Any] = {
            "step": step,
            "cpu_seconds": round(time.process_time(), 1),
            "scores": [asdict(score) for score in self.scores],
        }
        with (self.folder.path / _SCORES_FILE).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        self.console.print(f"{step:,}: " + describe(self.scores), highlight=False, soft_wrap=True)

    def close(self) -> None:
        """Free the users."""
        if self._simulation is not None:
            self._simulation.close()


def describe(scores: Sequence[TeacherScore]) -> str:
    """One line for people: hit rate of every condition, and its worst cell's."""
    return "; ".join(
        f"{score.condition} {score.hit_rate:.3f} ({score.hits:.0f} hits, "
        f"worst cell {int(np.nanargmin(score.cell_rates))} {score.worst_cell:.2f})"
        for score in scores
    )


def describe_practice(report: PracticeReport, cycles: int) -> str:
    """One line for people: where a cycle of practice has led to."""

    def rates(values: Sequence[float]) -> str:
        return ", ".join(f"{value:.2f}" for value in values)

    known = any(not math.isnan(rate) for rate in report.played)
    played = f", {rates(report.played)} in the app" if known else ""
    return (
        f"Practice {report.cycle}/{cycles}: hit rates {rates(report.imagined)} in the mind "
        f"(worst cell {report.worst_cell:.2f}){played}; "
        f"its hand goes {1000.0 * report.place_error_m:.1f} mm astray in a step"
    )


class _ScoreCallback(BaseCallback):
    """Lets the teacher play whole rounds every so often, between two iterations."""

    def __init__(self, score: Callable[[int], None], every_steps: int) -> None:
        super().__init__()
        self._score = score
        self._every_steps = every_steps
        self._scored: int | None = None

    def _on_rollout_start(self) -> None:
        self.score_if_due(None)

    def score_if_due(self, end: int | None) -> None:
        """Score when a multiple of the interval is passed, or the end is reached."""
        step = self.model.num_timesteps
        if self._scored is None:
            self._scored = step
        due = step // self._every_steps > self._scored // self._every_steps
        if due or (end is not None and step >= end and step > self._scored):
            self._score(step)
            self._scored = step

    def _on_step(self) -> bool:
        return True
