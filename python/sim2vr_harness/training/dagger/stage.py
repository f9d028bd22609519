"""The stage in which a policy that sees learns from the teacher."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.utils import get_device
from torch import Tensor

from sim2vr_harness.base.progress import View
from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.config import with_options
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.runs.checkpoint import read_tensors, write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import metric_key
from sim2vr_harness.training.dagger.dagger import (
    CHECKPOINT_ROUNDS,
    COLLECTED,
    PICTURE_FILES,
    Expert,
    Student,
    StudentProgress,
)
from sim2vr_harness.training.run.stage import Callbacks, Stage


class StudentStage(Stage):
    """The training of a student.

    Args:
        config: of the run.
        folder: of the stage.
        guide: makes the teacher of N users.
    """

    name, unit, result = "student", "frames", "policy.pt"
    title = "a student learns to do the same from what the user sees."
    state_of, leftovers = "the state of this student", (PICTURE_FILES,)

    _learner: Student

    def __init__(
        self, config: TrainingConfig, folder: Path, guide: Callable[[Simulation], Expert]
    ) -> None:
        super().__init__(config, folder, config.student.frames)
        self._guide = guide

    @property
    def done(self) -> float:
        """Frames that the student has had."""
        return self._learner.store.count

    def weights(self) -> dict[str, Tensor]:
        """Return the policy's weights in the end."""
        return read_tensors(self.folder / self.result, "the student's weights")

    def open(self) -> None:
        """Make the student, its teacher and users."""
        config = self._config
        env = with_options(config.env, config.student.app_options)
        self._simulation = simulation = Simulation(env, config.student.n_envs)
        guide = self._guide(simulation)
        policy = _new_policy(config, simulation, guide).to(get_device(config.device))
        self.folder.mkdir(parents=True, exist_ok=True)
        self._learner = Student(
            config.student,
            policy,
            simulation,
            guide,
            self.folder,
            seed=config.seed,
            game=simulation.resolved.facts,
        )

    def learned(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return what may not be NaN."""
        heads = {"heads": "_heads", "tell": "_tell", "read": "_read", "optimizer": "_optimizer"}
        return {"policy": state["policy"]} | {title: state[k] for title, k in heads.items()}

    def run(self, callbacks: Callbacks) -> None:
        """Go through the rounds that are left."""
        student = self._learner
        self.resume(callbacks)
        first, began, doing = student.store.count, time.monotonic(), "collecting the first frames"
        while not student.finished:
            view = View(student.store.count, doing)

            def show(share: float, view: View = view) -> None:
                callbacks.doing("playing" if share < COLLECTED else "learning")
                callbacks.show(lambda: view)

            progress = student.step(show)
            self.remember()
            if student.finished or student.round % CHECKPOINT_ROUNDS == 0:
                self.save()
            rate = (progress.frames - first) / (time.monotonic() - began)
            doing = _line(progress, rate, student.game)
            self.log(callbacks, _row(progress))
        callbacks.say("Student: " + doing)
        write_tensors(self.folder / self.result, student.policy.state_dict())
        self.tidy()


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
