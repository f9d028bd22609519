"""The stage in which a policy that sees learns from the teacher."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.utils import get_device
from torch import Tensor

from sim2vr_harness.base.finite import NotFinite, require_finite
from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.config import with_options
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.runs.checkpoint import read_tensors, take_in, write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import append_row, keep_rows, metric_key
from sim2vr_harness.training.dagger.dagger import (
    CHECKPOINT_ROUNDS,
    COLLECTED,
    PICTURE_FILES,
    Expert,
    Student,
    StudentProgress,
)
from sim2vr_harness.training.run.progress import View
from sim2vr_harness.training.run.stage import Callbacks

_POLICY, _STATE, _LOG = "policy.pt", "state.pt", "metrics.jsonl"


class StudentStage:
    """See :class:`~sim2vr_harness.training.run.stage.Stage`.

    Args:
        config: of the run.
        folder: of the stage.
        guide: makes the teacher of N users.
    """

    name, unit = "student", "frames"
    title = "a student learns to do the same from what the user sees."

    def __init__(
        self, config: TrainingConfig, folder: Path, guide: Callable[[Simulation], Expert]
    ) -> None:
        self._config, self.folder, self._guide = config, folder, guide
        self.total = float(config.student.frames)
        self._simulation: Simulation | None = None
        self._student: Student | None = None
        self._snapshot: dict[str, Any] | None = None
        """After the last round, unless it is on disk."""
        self._frames_saved = 0

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
        done = self._frames_saved
        return f"{done:,} of {self.total:,.0f} frames" if done else ""

    def weights(self) -> dict[str, Tensor]:
        """Return the policy's weights in the end."""
        return read_tensors(self.folder / _POLICY, "the student's weights")

    def open(self) -> None:
        """See the protocol."""
        config = self._config
        env = with_options(config.env, config.student.app_options)
        self._simulation = simulation = Simulation(env, config.student.n_envs)
        guide = self._guide(simulation)
        policy = _new_policy(config, simulation, guide).to(get_device(config.device))
        self.folder.mkdir(parents=True, exist_ok=True)
        self._student = Student(
            config.student,
            policy,
            simulation,
            guide,
            self.folder,
            seed=config.seed,
            game=game_facts(env.app),
        )

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        student = self._student
        assert student is not None
        if (self.folder / _STATE).is_file():
            self._restore(student, self.folder / _STATE)
            callbacks.say(f"Continuing with {student.store.count:,} frames.")
        first = self._frames_saved = student.store.count
        log = self.folder / _LOG
        keep_rows(log, lambda row: row["step"] <= first)
        began, doing = time.monotonic(), "collecting the first frames"
        while not student.finished:
            view = self._view(student.store.count, first, began, doing)
            progress = student.step(partial(_show, callbacks, view))
            row = _row(progress)
            append_row(log, row)
            self._remember(student)
            if student.finished or student.round % CHECKPOINT_ROUNDS == 0:
                self.save()
            rate = (progress.frames - first) / (time.monotonic() - began)
            doing = _line(progress, rate, student.game)
            callbacks.report(progress.frames, row)
        callbacks.say("Student: " + doing)
        write_tensors(self.folder / _POLICY, student.policy.state_dict())
        self.tidy()

    def _restore(self, student: Student, file: Path) -> None:
        def take(state: dict[str, Any]) -> None:
            _require_finite(state, None)
            student.load_state_dict(state)

        take_in(file, "the state of this student", take)

    def _remember(self, student: Student) -> None:
        """Take a snapshot after a round.

        Raises:
            NotFinite: the round has spoilt the student; the snapshot before it is written.
        """
        snapshot = student.state_dict()
        try:
            _require_finite(snapshot, None)
        except NotFinite:
            self.save()
            file = self.folder / _STATE
            _require_finite(snapshot, file if file.is_file() else None)
        self._snapshot = snapshot

    def _view(self, done: int, first: int, began: float, doing: str) -> Callable[[], View]:
        def view() -> View:
            elapsed = time.monotonic() - began
            left = (self.total - done) * elapsed / (done - first) if done > first else None
            return View(done, doing, left)

        return view

    def save(self) -> None:
        """See the protocol."""
        if self._snapshot is None:
            return
        write_tensors(self.folder / _STATE, self._snapshot)
        self._frames_saved = json.loads(self._snapshot["header"])["count"]
        self._snapshot = None

    def close(self) -> None:
        """See the protocol."""
        if self._simulation is not None:
            self._simulation.close()
        self._simulation = self._student = self._snapshot = None

    def tidy(self) -> None:
        """See the protocol: the collected frames and the state, which no one needs any more."""
        self._snapshot = None
        for file in (self.folder / _STATE, *self.folder.glob(PICTURE_FILES)):
            file.unlink(missing_ok=True)


def _require_finite(snapshot: Mapping[str, Any], last_good: Path | None) -> None:
    learned = {part: snapshot[part] for part in ("policy", "heads", "tell", "read", "optimizer")}
    frames = json.loads(snapshot["header"])["count"]
    require_finite(learned, f"after {frames:,} frames", last_good)


def _show(callbacks: Callbacks, view: Callable[[], View], share: float) -> None:
    callbacks.doing("playing" if share < COLLECTED else "learning")
    callbacks.show(view)


def _new_policy(config: TrainingConfig, simulation: Simulation, guide: Expert) -> VisualActorCritic:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        policy = VisualActorCritic(
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


def _row(progress: StudentProgress) -> dict[str, Any]:
    return {
        "step": progress.frames,
        **{f"rollout/{key}": value for key, value in progress.means.items()},
        "student/imitation_error": progress.imitation_error,
        "student/facts_error": progress.facts_error,
        "student/numbers_error": progress.numbers_error,
        "student/crops_error": progress.crops_error,
        "student/reading_error": progress.reading_error,
        "student/teacher_share": progress.teacher_share,
        "time/collect_seconds": progress.collect_seconds,
        "time/learn_seconds": progress.learn_seconds,
    }


def _line(progress: StudentProgress, rate: float, game: GameFacts) -> str:
    played = "".join(
        f"{measure.heading.lower()} {value:.{measure.digits}f} in its last rounds, "
        for measure in game.scalars
        if measure.name == game.score
        and (value := progress.means.get(metric_key(measure))) is not None
    )
    return (
        f"{progress.frames:,} frames, {played}differs from the teacher by "
        f"{progress.imitation_error:.3f} ({rate:,.0f} frames/s)"
    )
