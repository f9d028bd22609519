"""Stable-Baselines3's PPO with the reference's schedule and one log row per iteration."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import stable_baselines3
import torch

from sim2vr_harness.client import GameFacts
from sim2vr_harness.training.buffer import FrameRolloutBuffer
from sim2vr_harness.training.config import LearningRateConfig, TrainingConfig
from sim2vr_harness.training.episodes import episode_means
from sim2vr_harness.training.policy import UserPolicy, policy_arguments
from sim2vr_harness.training.threads import torch_threads
from sim2vr_harness.training.vec_env import SimulationVecEnv

__all__ = ["PPO", "LearningRate", "build"]


class LearningRate:
    """Constant for the first part of the training, then linear to the final value.

    Args:
        config: The schedule; the defaults are the reference's numbers.
    """

    def __init__(self, config: LearningRateConfig) -> None:
        self.config = config

    def __call__(self, progress_remaining: float) -> float:
        """Return the learning rate; ``progress_remaining`` falls from 1 to 0."""
        start = 1.0 - self.config.constant_fraction
        share = min(max(progress_remaining / start, 0.0), 1.0)
        return self.config.final + share * (self.config.initial - self.config.final)


class PPO(stable_baselines3.PPO):
    """PPO whose schedule runs over ``schedule_timesteps``, wherever a session stops.

    The reference restarts its schedule when it resumes; here a run that is stopped and resumed is
    the same as one that is not. One log row per iteration holds the rollout and the update that
    followed it (Stable-Baselines3 logs the update before).
    """

    schedule_timesteps: int | None = None
    value_warmup_iterations: int = 0
    critic_learning_rate_factor: float = 1.0
    last_times: tuple[float, float] = (0.0, 0.0)
    """Seconds of the last rollout and of the update that followed it."""
    _rollout_began = _rollout_ended = 0.0

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Play ``n_steps`` user steps in every environment; see the base class."""
        self._rollout_began = time.monotonic()
        with torch_threads(1):
            return bool(super().collect_rollouts(*args, **kwargs))

    def _update_current_progress_remaining(self, num_timesteps: int, total_timesteps: int) -> None:
        total = self.schedule_timesteps or total_timesteps
        self._current_progress_remaining = max(0.0, 1.0 - num_timesteps / total)

    def _update_learning_rate(self, optimizers: Any) -> None:
        super()._update_learning_rate(optimizers)
        for group in self.policy.optimizer.param_groups[1:]:
            group["lr"] *= self.critic_learning_rate_factor

    def critic_apart(self, factor: float) -> None:
        """Give the weights that only the values depend on a learning rate of their own."""
        assert isinstance(self.policy, UserPolicy)
        critic = self.policy.critic_parameters()
        known = {id(weight) for weight in critic}
        both = self.policy.optimizer.param_groups[0]
        both["params"] = [weight for weight in both["params"] if id(weight) not in known]
        self.policy.optimizer.add_param_group({"params": critic})
        self.critic_learning_rate_factor = factor

    def episode_means(self) -> dict[str, float]:
        """Return the means of the last episodes; see :func:`episode_means`."""
        env = self.get_env()
        facts = env.facts if isinstance(env, SimulationVecEnv) else GameFacts("")
        return episode_means(list(self.ep_info_buffer or []), facts)

    def dump_logs(self, iteration: int = 0) -> None:
        """Record the rollout's values; they are written after the update."""
        for key, value in self.episode_means().items():
            self.logger.record(f"rollout/{key}", value)
        self._rollout_ended = time.monotonic()

    def train(self) -> None:
        """Update the networks, then write the iteration's log row."""
        # Shards have their own threads; those of torch's operations would only wait for each other.
        in_shards = isinstance(self.policy, UserPolicy) and self.policy.in_shards
        with torch_threads(1 if in_shards else torch.get_num_threads()), self._critic_alone():
            super().train()
        self._write_row()

    @contextmanager
    def _critic_alone(self) -> Iterator[None]:
        """Keep the actor, and what it shares with the critic, as it is in the first iterations."""
        iteration = self.num_timesteps // (self.n_steps * self.n_envs)
        if iteration > self.value_warmup_iterations or not isinstance(self.policy, UserPolicy):
            yield
            return
        critic = {id(weight) for weight in self.policy.critic_parameters()}
        kept = [weight for weight in self.policy.parameters() if id(weight) not in critic]
        asked = [weight.requires_grad for weight in kept]
        for weight in kept:
            weight.requires_grad_(False)
        try:
            yield
        finally:
            for weight, wanted in zip(kept, asked, strict=True):
                weight.requires_grad_(wanted)

    def _write_row(self) -> None:
        """Write the iteration's log row, after the update."""
        now = time.monotonic()
        self.last_times = (self._rollout_ended - self._rollout_began, now - self._rollout_ended)
        self.logger.record("time/rollout_seconds", self.last_times[0])
        self.logger.record("time/update_seconds", self.last_times[1])
        steps = self.n_steps * self.n_envs
        self.logger.record("time/steps_per_second", steps / sum(self.last_times))
        self.logger.dump(step=self.num_timesteps)


def build(config: TrainingConfig, env: SimulationVecEnv) -> PPO:
    """Return a fresh PPO learner for ``config``, networks initialised from its seed."""
    ppo = config.ppo
    model = PPO(
        UserPolicy,
        env,
        learning_rate=LearningRate(ppo.learning_rate),
        n_steps=ppo.n_steps,
        batch_size=ppo.batch_size,
        n_epochs=ppo.n_epochs,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=ppo.ent_coef,
        vf_coef=ppo.vf_coef,
        max_grad_norm=ppo.max_grad_norm,
        target_kl=ppo.target_kl,
        rollout_buffer_class=FrameRolloutBuffer,
        policy_kwargs=policy_arguments(config.policy),
        seed=config.seed,
        device=config.device,
    )
    model.schedule_timesteps = config.total_timesteps
    model.value_warmup_iterations = ppo.value_warmup_iterations
    if ppo.critic_learning_rate_factor != 1.0:
        model.critic_apart(ppo.critic_learning_rate_factor)
    return model
