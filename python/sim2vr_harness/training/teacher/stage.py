"""The teacher's PPO: on the privileged numbers that the game publishes, without pictures."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from stable_baselines3.common.logger import Logger
from torch import nn

from sim2vr_harness.policies.state_actor_critic import TeacherPolicy
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder, append_row, keep_rows, read_rows
from sim2vr_harness.training.ppo import ppo
from sim2vr_harness.training.ppo.stage import PPOStage
from sim2vr_harness.training.run.loggers import JsonLines
from sim2vr_harness.training.run.progress import View
from sim2vr_harness.training.run.stage import Callbacks
from sim2vr_harness.training.teacher.env import TeacherSimulation
from sim2vr_harness.training.teacher.evaluation import describe, evaluate_teacher

_EVALUATE_ROUNDS = 4
"""Rounds per condition that judge a trained teacher, by the true rules and with its stochastic
policy; 0: none."""


class TeacherStage(PPOStage):
    """PPO in the true game, from where the imagined rollouts have led to.

    Args:
        config: of the run.
        folder: of the stage.
        begin: puts the weights to begin with into the policy.
    """

    def __init__(
        self,
        config: TrainingConfig,
        folder: Path,
        begin: Callable[[nn.Module], object],
    ) -> None:
        self._run_config = config
        teacher, place = config.teacher, RunFolder(folder)
        learner = teacher.ppo.complete()
        super().__init__(
            "teacher",
            "the teacher plays the true game on what the game knows, without pictures.",
            place,
            learner,
            lambda: TeacherSimulation(config.env, teacher, config.seed),
            lambda env: ppo.new_learner(
                learner,
                env,
                TeacherPolicy,
                {"config": teacher.policy},
                total_timesteps=teacher.total_timesteps,
                seed=config.seed,
            ),
            lambda _: Logger(str(folder), [JsonLines(place.metrics_file)]),
            begin=begin,
            stop=teacher.total_timesteps,
            checkpoints=config.checkpoint,
        )

    @property
    def _scores_file(self) -> Path:
        return self.folder.path / "scores.jsonl"

    @property
    def finished(self) -> bool:
        """See the protocol; a teacher that was to be judged and was not is judged first."""
        judged = _EVALUATE_ROUNDS == 0 or any(
            row["step"] >= self.folder.step for row in read_rows(self._scores_file)
        )
        return super().finished and judged

    def _finish(self, model: ppo.PPO, callbacks: Callbacks) -> None:
        teacher = self._run_config.teacher
        if _EVALUATE_ROUNDS == 0:
            return
        policy = model.policy
        assert isinstance(policy, TeacherPolicy)
        callbacks.check()
        step, began = model.num_timesteps, True

        def show(ended: int, rounds: int) -> None:
            nonlocal began
            doing = f"evaluating the teacher, {ended} of {rounds} rounds have ended"
            callbacks.show(lambda: View(step, doing), force=began)
            began = False

        scores = evaluate_teacher(
            policy,
            self._run_config.env,
            teacher,
            rounds=_EVALUATE_ROUNDS,
            on_progress=show,
        )
        row = {
            "step": model.num_timesteps,
            "cpu_seconds": round(time.process_time(), 1),
            "scores": [asdict(score) for score in scores],
        }
        keep_rows(self._scores_file, lambda old: old["step"] < model.num_timesteps)
        append_row(self._scores_file, row)
        callbacks.say("Teacher: " + describe(scores))
