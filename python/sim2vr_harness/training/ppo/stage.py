"""The stage that learns by PPO, from checkpoints that continue exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.logger import Logger
from torch import nn

from sim2vr_harness.base.finite import NotFinite
from sim2vr_harness.envs.protocols import SimulationLike
from sim2vr_harness.runs.config import CheckpointConfig
from sim2vr_harness.runs.ppo_config import PPOConfig
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.ppo import checkpoint, ppo
from sim2vr_harness.training.ppo.rollout_buffer import buffer_bytes
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.callbacks import CheckpointCallback, ProgressCallback
from sim2vr_harness.training.run.progress import TrainingProgress
from sim2vr_harness.training.run.stage import Callbacks

NOT_EXACT = "--resume starts new rounds, since this app cannot save its state."


class PPOStage:
    """See :class:`~sim2vr_harness.training.run.stage.Stage`.

    Args:
        name: of the stage.
        title: one sentence for people.
        folder: of the run.
        config: of the learner.
        make_simulation: makes the users.
        build: makes the learner that plays with them.
        make_logger: makes the logger of a session that begins at this step.
        begin: puts the weights to begin with into the policy, when the stage begins.
        stop: user steps after which the stage ends, rounded up to whole iterations.
        checkpoints: how often, and how many are kept.
    """

    unit = "user steps"

    def __init__(
        self,
        name: str,
        title: str,
        folder: RunFolder,
        config: PPOConfig,
        make_simulation: Callable[[], SimulationLike],
        build: Callable[[SimulationVecEnv], ppo.PPO],
        make_logger: Callable[[int], Logger],
        *,
        begin: Callable[[nn.Module], object] = lambda policy: None,
        stop: int,
        checkpoints: CheckpointConfig,
    ) -> None:
        self.name, self.title, self.folder, self.config = name, title, folder, config
        size = config.steps_per_iteration
        self.stop = -(-stop // size) * size
        self.total = float(self.stop)
        self._make_simulation, self._build = make_simulation, build
        self._make_logger, self._begin = make_logger, begin
        self._checkpoint_config = checkpoints
        self._env: SimulationVecEnv | None = None
        self._model: ppo.PPO | None = None
        self._checkpoints: CheckpointCallback | None = None
        self.lost_steps = 0
        """User steps of an unfinished iteration, which resuming takes again."""

    @property
    def begun(self) -> bool:
        """See the protocol."""
        return bool(self.folder.checkpoints())

    @property
    def finished(self) -> bool:
        """See the protocol."""
        return self.begun and self.folder.step >= self.stop

    @property
    def saved(self) -> str:
        """See the protocol."""
        return f"step {self.folder.step:,} of {self.stop:,}" if self.begun else ""

    def open(self) -> None:
        """See the protocol."""
        self._env = SimulationVecEnv(self._make_simulation())
        self._model = self._build(self._env)

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        model, env = self._model, self._env
        assert model is not None
        assert env is not None
        start = self._restore(model)
        logger = self._make_logger(start)
        model.set_logger(logger)
        size = self.config.steps_per_iteration
        progress = TrainingProgress(
            step=start,
            start_step=start,
            stop_step=self.stop,
            iteration_steps=size,
            minibatches=size // self.config.batch_size * self.config.n_epochs,
            game=env.facts,
        )
        kept = self._checkpoint_config
        self._checkpoints = CheckpointCallback(
            self.folder, kept.every_steps, kept.keep, lambda file, step: _note(progress, file)
        )
        tracker = ProgressCallback(progress, callbacks)
        self._greet(callbacks, progress)
        try:
            model.learn(
                self.stop - start,
                callback=[self._checkpoints, tracker],
                reset_num_timesteps=start == 0,
            )
            self._checkpoints.remember()
            self._finish(model, callbacks)
        except NotFinite:
            raise
        except Exception:
            # What torch says of weights that are NaN is pages of them.
            if self._checkpoints.snapshot_step is not None:
                self._checkpoints.require_finite()
            raise
        finally:
            tracker.detach()
            logger.close()
            if tracker.failures:
                callbacks.note(app_failures=tracker.failures)

    def _finish(self, model: ppo.PPO, callbacks: Callbacks) -> None:
        """Judge what was learned, once the stage has reached its end."""

    def _restore(self, model: ppo.PPO) -> int:
        if self.begun:
            checkpoint.restore(self.folder.latest_checkpoint(), model)
            self.folder.drop_metrics_after(model.num_timesteps)
            return model.num_timesteps
        self.folder.drop_metrics_after(0)
        self._begin(model.policy)
        return 0

    def save(self) -> None:
        """See the protocol."""
        if self._checkpoints is None or self._checkpoints.write() is None:
            return
        assert self._model is not None
        self.lost_steps = max(0, self._model.num_timesteps - self.folder.step)
        self.folder.note_session(end_step=self.folder.step)

    def close(self) -> None:
        """See the protocol."""
        if self._env is not None:
            self._env.close()
        self._env = self._model = self._checkpoints = None

    def tidy(self) -> None:
        """See the protocol; checkpoints are kept."""

    def _greet(self, callbacks: Callbacks, progress: TrainingProgress) -> None:
        model, env = self._model, self._env
        assert model is not None
        assert env is not None
        space = model.rollout_buffer.observation_space
        assert isinstance(space, spaces.Dict)
        steps = self.config.steps_per_iteration
        memory = buffer_bytes(space, steps) / 2**20
        exact = getattr(env.simulation, "exact_states", True)
        renderer = getattr(env.simulation, "renderer_description", None)
        verb = "Continuing" if progress.start_step else "Training"
        callbacks.say(
            f"{verb} in {self.folder.path}, from step {progress.start_step:,} to "
            f"{progress.stop_step:,} in iterations of {steps:,} user steps ({model.n_envs} users, "
            f"{model.device})."
        )
        if renderer is not None:
            callbacks.say(f"Headset images by {renderer}.")
        callbacks.say(
            f"Observations of one iteration: {memory:,.0f} MiB. Ctrl-C saves and stops; "
            + ("--resume continues exactly." if exact else NOT_EXACT)
        )
        callbacks.note(
            start_step=progress.start_step,
            device=str(model.device),
            renderer=renderer,
            torch_threads=torch.get_num_threads(),
            parameters=sum(weight.numel() for weight in model.policy.parameters()),
        )


def _note(progress: TrainingProgress, file: Any) -> None:
    progress.note = f"Saved {file}"
