"""Stable-Baselines3's PPO with the reference's schedule and one log row per iteration."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import stable_baselines3
import torch

from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.client import GameFacts
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.ppo_config import LearningRateConfig
from sim2vr_harness.training.ppo.rollout_buffer import FrameRolloutBuffer
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.loggers import episode_means


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
    """PPO whose schedule runs over ``schedule_timesteps``, independent of where a session stops.

    The reference restarts its schedule when it resumes. Here a run that is stopped and resumed is
    the same as one that is not. One log row per iteration holds the rollout and the update that
    followed it (Stable-Baselines3 logs the update before).
    """

    schedule_timesteps: int | None = None
    critic_first_updates: int = 0
    critic_learning_rate_factor: float = 1.0
    on_row: Callable[[int, dict[str, Any]], None] | None = None
    """Called with the step and the values of every log row."""
    last_times: tuple[float, float] = (0.0, 0.0)
    """Seconds of the last rollout and of the update that followed it."""
    _rollout_began = _rollout_ended = 0.0

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "on_row"]

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
        critic = self.user_policy.critic_parameters()
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

    @property
    def user_policy(self) -> VisualActorCritic:
        """Return the policy, typed as :class:`VisualActorCritic`."""
        assert isinstance(self.policy, VisualActorCritic)
        return self.policy

    def dump_logs(self, iteration: int = 0) -> None:
        """Record the rollout's values; they are written after the update."""
        for key, value in self.episode_means().items():
            self.logger.record(f"rollout/{key}", value)
        self._rollout_ended = time.monotonic()

    def train(self) -> None:
        """Update the networks, then write the iteration's log row."""
        policy = self.user_policy
        # Shards have their own threads; those of torch's operations would only wait for each other.
        threads = 1 if policy.in_shards else torch.get_num_threads()
        with torch_threads(threads), self._critic_first():
            super().train()
        self._write_row()

    @contextmanager
    def _critic_first(self) -> Iterator[None]:
        """Freeze the actor, including weights that the critic shares, in the first updates."""
        update = self.num_timesteps // (self.n_steps * self.n_envs)
        if update > self.critic_first_updates:
            yield
            return
        critic = {id(weight) for weight in self.user_policy.critic_parameters()}
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
        row = dict(self.logger.name_to_value)
        self.logger.dump(step=self.num_timesteps)
        if self.on_row is not None:
            self.on_row(self.num_timesteps, row)


def build(config: TrainingConfig, env: SimulationVecEnv) -> PPO:
    """Return a new learner for a user with vision, with networks initialised from the seed."""
    learner = config.ppo
    model = PPO(
        VisualActorCritic,
        env,
        learning_rate=LearningRate(learner.learning_rate),
        n_steps=learner.n_steps,
        batch_size=learner.batch_size,
        n_epochs=learner.n_epochs,
        gamma=learner.gamma,
        gae_lambda=learner.gae_lambda,
        clip_range=learner.clip_range,
        ent_coef=learner.ent_coef,
        vf_coef=learner.vf_coef,
        max_grad_norm=learner.max_grad_norm,
        target_kl=learner.target_kl,
        rollout_buffer_class=FrameRolloutBuffer,
        policy_kwargs={"config": config.policy},
        seed=config.seed,
        device=config.device,
    )
    model.schedule_timesteps = config.total_timesteps
    model.critic_first_updates = learner.critic_first_updates
    if learner.critic_learning_rate_factor != 1.0:
        model.critic_apart(learner.critic_learning_rate_factor)
    return model
