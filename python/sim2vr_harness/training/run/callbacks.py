"""Callbacks of the learner's iterations: checkpoints and progress."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.callbacks import BaseCallback

from sim2vr_harness.base.finite import NotFinite
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.ppo import checkpoint
from sim2vr_harness.training.ppo.ppo import PPO
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.progress import Phase, TrainingProgress
from sim2vr_harness.training.run.stage import Callbacks


class CheckpointCallback(BaseCallback):
    """Remembers the moment between two iterations and writes it when it is due.

    Args:
        folder: The run's folder.
        every_steps: User steps between two checkpoints.
        keep: How many of the newest checkpoints to keep; None keeps all.
        on_written: Called with the file and the step of every checkpoint.
    """

    model: PPO

    def __init__(
        self,
        folder: RunFolder,
        every_steps: int,
        keep: int | None = None,
        on_written: Callable[[Path, int], None] = lambda file, step: None,
    ) -> None:
        super().__init__()
        self._folder = folder
        self._every_steps = every_steps
        self._keep = keep
        self._on_written = on_written
        self._snapshot: checkpoint.Snapshot | None = None
        self._written_step: int | None = None

    @property
    def snapshot_step(self) -> int | None:
        """The step that :meth:`write` would save, None before the first iteration."""
        return None if self._snapshot is None else self._snapshot.step

    def _on_rollout_start(self) -> None:
        self.remember()

    def _on_step(self) -> bool:
        return True

    def remember(self) -> None:
        """Take a snapshot now, between two iterations, and write it if it is due.

        Raises:
            NotFinite: The last update has spoilt the learner; the snapshot before it is written.
        """
        self.require_finite()
        self._snapshot = checkpoint.take(self.model)
        step = self._snapshot.step
        if self._written_step is None:  # The session starts: on disk already, or step 0.
            self._written_step = step
        elif step // self._every_steps > self._written_step // self._every_steps:
            self.write()

    def require_finite(self) -> None:
        """Check that the learner may be saved; otherwise write the last snapshot and say so.

        Raises:
            NotFinite: A weight or a moment of the optimiser is NaN or infinite.
        """
        try:
            checkpoint.require_finite_learner(self.model, None)
        except NotFinite:
            checkpoint.require_finite_learner(self.model, self.write())
            raise

    def write(self) -> Path | None:
        """Write the last snapshot unless it is on disk, and return its file."""
        if self._snapshot is None:
            return None
        step = self._snapshot.step
        file = self._folder.checkpoint_file(step)
        if not file.is_file():
            self._snapshot.write(file, self.model)
            self._on_written(file, step)
            self._remove_old()
        self._written_step = step
        return file

    def _remove_old(self) -> None:
        if self._keep is not None:
            for file in self._folder.checkpoints()[: -self._keep]:
                file.unlink(missing_ok=True)


class ProgressCallback(BaseCallback):
    """Keeps a :class:`TrainingProgress` up to date, during the update as well, and passes rows on.

    Args:
        progress: The numbers to keep.
        callbacks: The stage's.
    """

    model: PPO

    def __init__(self, progress: TrainingProgress, callbacks: Callbacks) -> None:
        super().__init__()
        self._progress, self._callbacks = progress, callbacks
        self._hook: Any = None
        self.failures: list[dict[str, Any]] = []
        """Every app that failed in this session: step of the training, user, step of its round and
        error."""

    def _on_training_start(self) -> None:
        self.model.on_row = self._pass_on
        self._progress.minibatch_seconds = _minibatch_seconds(self.model)
        self._hook = self.model.policy.optimizer.register_step_post_hook(self._count_minibatch)

    def _on_rollout_start(self) -> None:
        if self._progress.phase == Phase.LEARNING:
            self._end_learning()
        self._progress.begin(Phase.PLAYING, self._progress.iteration_steps)
        self._show()

    def _on_step(self) -> bool:
        progress = self._progress
        progress.step = self.model.num_timesteps
        progress.phase_done += self.model.n_envs
        env = self.model.get_env()
        if isinstance(env, SimulationVecEnv) and env.last_logs is not None:
            progress.counts_now = {
                measure.label: env.last_logs.total(measure.log_key)
                for measure in progress.game.counters[:2]
            }
        self._report_failures()
        ended = sum("episode" in info for info in self.locals["infos"])
        progress.episodes += ended
        # SB3 takes the ended rounds into its statistics after this call, hence the next step.
        if progress.phase_done % (50 * self.model.n_envs) == 0:
            progress.means = self.model.episode_means()
        self._show()
        return True

    def _report_failures(self) -> None:
        """Say which apps failed since the last step; their users go on with new ones."""
        env = self.model.get_env()
        assert isinstance(env, SimulationVecEnv)
        failed = getattr(env.simulation, "app_failures", [])
        for failure in failed[len(self.failures) :]:
            self.failures.append(
                {
                    "training_step": self.model.num_timesteps,
                    "user": failure.user,
                    "round_step": failure.step,
                    "error": failure.error,
                }
            )
            self._callbacks.say(
                f"User {failure.user}: {failure.error.splitlines()[0]}\n"
                "Its round is over; the app is started again and the training goes on."
            )
        self._progress.app_failures = len(self.failures)

    def _on_rollout_end(self) -> None:
        if self._progress.app_failures:
            self.logger.record("rollout/app_failures", self._progress.app_failures)
        self._progress.means = self.model.episode_means()
        self._progress.end_playing(self._progress.iteration_steps)
        self._progress.begin(Phase.LEARNING, self._progress.minibatches)
        self._show()

    def _on_training_end(self) -> None:
        if self._progress.phase == Phase.LEARNING:
            self._end_learning()
            self._progress.phase_done = self._progress.phase_total
        self.detach()
        self._show(force=True)

    def detach(self) -> None:
        """Stop counting minibatches and passing rows on."""
        if getattr(self, "model", None) is not None:
            self.model.on_row = None
        if self._hook is not None:
            self._hook.remove()
            self._hook = None

    def _show(self, force: bool = False) -> None:
        self._callbacks.doing(self._progress.phase)
        self._callbacks.show(self._progress.view, force=force)

    def _pass_on(self, step: int, row: dict[str, Any]) -> None:
        self._callbacks.report(step, row)

    def _end_learning(self) -> None:
        self._progress.end_learning(self._progress.iteration_steps)

    def _count_minibatch(self, *_: Any) -> None:
        self._progress.phase_done += 1
        self._show()


def _minibatch_seconds(model: PPO) -> float:
    """Return the time of one minibatch, forward and backward; nothing is learned from it."""
    space = model.rollout_buffer.observation_space
    assert isinstance(space, spaces.Dict)
    observations = {
        key: torch.from_numpy(np.zeros((model.batch_size, *(box.shape or ())), box.dtype)).to(
            model.device
        )
        for key, box in space.spaces.items()
    }
    actions = torch.zeros((model.batch_size, model.rollout_buffer.action_dim), device=model.device)
    seconds = 0.0
    for _ in range(2):  # The first one is slow for reasons that never come back.
        began = time.monotonic()
        values, log_probabilities, _ = model.policy.evaluate_actions(observations, actions)
        (values.sum() + log_probabilities.sum()).backward()  # type: ignore[no-untyped-call]
        model.policy.optimizer.zero_grad()
        seconds = time.monotonic() - began
    return seconds
