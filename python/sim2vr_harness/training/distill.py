"""``recipe: distill``: a teacher that knows, a student that sees, then PPO on what it senses.

1. ``teacher``: PPO on the privileged numbers that the game publishes; no pictures.
2. ``student``: the policy that sees imitates the teacher in the app, on real pictures (DAgger).
3. Fine-tuning: PPO from pixels begins with the student's weights, so that the result is a policy
   that is best for its own senses and its own effort; this is the run's ordinary training
   (training/trainer.py), whose checkpoints are the trained users.

Every stage has a folder of its own in the run's folder, and a stage that was stopped goes on
exactly where its last checkpoint was.
"""

from __future__ import annotations

import fnmatch
import json
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor

from sim2vr_harness.envs.config import with_options
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training import checkpoint
from sim2vr_harness.training.config import TrainingConfig
from sim2vr_harness.training.policy import UserPolicy
from sim2vr_harness.training.progress import StageDisplay
from sim2vr_harness.training.run_folder import RunFolder, keep_rows
from sim2vr_harness.training.student import Student, StudentProgress
from sim2vr_harness.training.teacher import load_teacher, train_teacher
from sim2vr_harness.training.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher_env import OBSERVATION, PrivilegedSenses

__all__ = ["STUDENT", "TEACHER", "TeacherGuide", "distill"]

TEACHER, STUDENT = "teacher", "student"
"""Folders of the first two stages in a run's folder."""

SCALE_STEPS, SCALE_EVERY = 120, 4
"""User steps in which the teacher shows what a body goes through."""
_POLICY = "policy.pt"

Weights = dict[str, Tensor]


class TeacherGuide:
    """A trained teacher beside a student: what it would do, and what the picture shows.

    Args:
        file: the teacher's checkpoint.
        config: the teacher's.
        simulation: the student's users, in this process.
    """

    def __init__(self, file: Path, config: TeacherConfig, simulation: Simulation) -> None:
        self._policy = load_teacher(file, config, simulation.config)
        self._senses = PrivilegedSenses(simulation, config.hidden_fields)
        self._facts = [
            name for name in self._senses.names if fnmatch.fnmatchcase(name, "cell*.present")
        ]

    def actions(self, simulation: Any) -> NDArray[np.float32]:
        """See :class:`~sim2vr_harness.training.student.Guide`."""
        return self._policy.act({OBSERVATION: self._senses.observe()}, None)

    def facts(self, simulation: Any) -> NDArray[np.float32]:
        """See :class:`~sim2vr_harness.training.student.Guide`: which cells have a target."""
        columns = [self._senses.field(name) for name in self._facts]
        if not columns:
            return np.zeros((simulation.n, 0), np.float32)
        return np.clip(np.stack(columns, axis=1), 0.0, 1.0)

    def proprioception_scale(
        self, simulation: Simulation
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and standard deviation of the proprioception while the teacher plays, (P,) each.

        The users' present rounds are lost.
        """
        simulation.reset(seeds=list(range(simulation.n)))
        seen = []
        for step in range(SCALE_STEPS):
            if step % SCALE_EVERY == 0:
                seen.append(simulation.proprioception.observe(simulation.users))
            result = simulation.step(self.actions(simulation))
            ended = np.flatnonzero(result.terminated | result.truncated)
            if len(ended):
                simulation.reset([int(i) for i in ended])
        values = np.concatenate(seen).astype(np.float64)
        return values.mean(0), values.std(0)


def distill(config: TrainingConfig, folder: RunFolder, console: Console) -> Weights | None:
    """Run the stages before the fine-tuning, or go on with them, exactly.

    Args:
        config: of the run.
        folder: of the run; exists.
        console: where to report.

    Returns:
        The student's weights, with which the fine-tuning begins; None if a stage was interrupted.

    Raises:
        InputError: the game publishes no privileged numbers.
    """
    finished = folder.path / STUDENT / _POLICY
    if finished.is_file():
        return _read(finished)
    _say(console, "Stage 1 of 3: a teacher learns from what the game knows, without pictures.")
    with _timed(folder, TEACHER):
        taught = train_teacher(
            config.teacher, config.env, folder.path / TEACHER, seed=config.seed, console=console
        )
    if taught.interrupted:
        return None
    _say(console, "Stage 2 of 3: a student learns to do the same from what the user sees.")
    with _timed(folder, STUDENT):
        return _teach(config, folder, taught.checkpoint, console)


def _say(console: Console, text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)


@contextmanager
def _timed(folder: RunFolder, stage: str) -> Iterator[None]:
    """Add the block's wall time to ``stage_seconds`` in run.json."""
    began = time.monotonic()
    try:
        yield
    finally:
        seconds = dict(folder.metadata().get("stage_seconds", {}))
        seconds[stage] = round(seconds.get(stage, 0.0) + time.monotonic() - began, 1)
        folder.note(stage_seconds=seconds)


def _teach(
    config: TrainingConfig, folder: RunFolder, teacher: Path, console: Console
) -> Weights | None:
    place = folder.path / STUDENT
    env = with_options(config.env, config.student.app_options)
    with closing(Simulation(env, config.student.n_envs)) as simulation:
        guide = TeacherGuide(teacher, config.teacher, simulation)
        policy = _new_policy(config, simulation, guide)
        student = Student(
            config.student, policy, simulation, guide, place, seed=config.seed, device="cpu"
        )
        if student.restore():
            _say(console, f"Continuing with {student.store.count:,} frames.")
        try:
            _learn(student, place / "metrics.jsonl", console)
        except KeyboardInterrupt:
            return None
        weights = {key: value.clone() for key, value in policy.state_dict().items()}
        checkpoint.write_tensors(place / _POLICY, weights)
        student.discard()
    return weights


def _new_policy(config: TrainingConfig, simulation: Simulation, guide: TeacherGuide) -> UserPolicy:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        policy = UserPolicy(
            simulation.observation_space,
            simulation.action_space,
            lambda _: 0.0,
            config=config.policy,
        )
    if config.policy.scale_proprioception:
        # What the teacher has met is what the student will meet.
        policy.fit_scaling(*guide.proprioception_scale(simulation))
    with torch.no_grad():
        policy.log_std.fill_(config.student.log_std)
    return policy


def _learn(student: Student, metrics: Path, console: Console) -> None:
    config = student.config
    keep_rows(metrics, lambda row: row["step"] <= student.store.count)
    began, first = time.monotonic(), student.store.count
    with StageDisplay("Student", config.frames, console) as display:
        over = student.finished
        while not over:
            progress = student.step()
            over = student.finished
            with metrics.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(_row(progress)) + "\n")
            rate = (progress.frames - first) / (time.monotonic() - began)
            left = max(0.0, config.frames - progress.frames) / rate
            display.update(progress.frames, _line(progress, rate), left)
            if over or student.round % config.checkpoint_rounds == 0:
                student.save()
            if over:
                display.say("Student: " + _line(progress, rate))


def _row(progress: StudentProgress) -> dict[str, Any]:
    return {
        "step": progress.frames,
        **{f"rollout/{key}": value for key, value in progress.means.items()},
        "student/imitation_error": progress.imitation_error,
        "student/facts_error": progress.facts_error,
        "student/teacher_share": progress.teacher_share,
        "time/collect_seconds": progress.collect_seconds,
        "time/learn_seconds": progress.learn_seconds,
    }


def _line(progress: StudentProgress, rate: float) -> str:
    hits = progress.means.get("ep_hit_rate")
    played = "" if hits is None else f"hit rate {hits:.2f} in its last rounds, "
    return (
        f"{progress.frames:,} frames, {played}differs from the teacher by "
        f"{progress.imitation_error:.3f} ({rate:,.0f} frames/s)"
    )


def _read(file: Path) -> Weights:
    weights: Weights = torch.load(file, weights_only=True, map_location="cpu")
    return weights
