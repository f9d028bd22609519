"""The teacher's network, and PPO as it suits cheap updates on numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from sim2vr_harness.training import ppo
from sim2vr_harness.training.buffer import FrameRolloutBuffer
from sim2vr_harness.training.sharding import in_shards
from sim2vr_harness.training.teacher_config import TeacherPPOConfig
from sim2vr_harness.training.teacher_env import OBSERVATION
from sim2vr_harness.training.threads import torch_threads
from sim2vr_harness.training.vec_env import SimulationVecEnv

__all__ = ["TeacherPPO", "TeacherPolicy", "build_teacher"]


class _Normalised(BaseFeaturesExtractor):
    """Observations with the mean and deviation of all that was seen so far, clipped.

    The statistics are part of the network's state, and change between updates only, so that the
    policy that acted is the policy that learns.
    """

    mean: Tensor
    variance: Tensor
    count: Tensor

    def __init__(self, observation_space: spaces.Dict, clip: float) -> None:
        size = spaces.flatdim(observation_space[OBSERVATION])
        super().__init__(observation_space, features_dim=size)
        self._clip = clip
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(size, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        scale = torch.rsqrt(self.variance + 1e-6)
        centred = (observations[OBSERVATION] - self.mean.float()) * scale.float()
        return torch.clamp(centred, -self._clip, self._clip)

    def update(self, observations: Tensor) -> None:
        """Take a batch, (B, size), into the statistics."""
        values = observations.double()
        count = float(len(values))
        mean, variance = values.mean(0), values.var(0, unbiased=False)
        total = self.count + count
        shift = mean - self.mean
        pooled = self.variance * self.count + variance * count
        self.variance = (pooled + shift**2 * self.count * count / total) / total
        self.mean = self.mean + shift * count / total
        self.count = total


class TeacherPolicy(ActorCriticPolicy):
    """Two separate networks with SiLU on the normalised observation, and a Gaussian.

    The mean is not squashed; what acts is clipped to [-1, 1], as the student's actions are.

    Args:
        observation_space: ``{"teacher": Box}``.
        action_space: Box(-1, 1, (A,)).
        lr_schedule: of the optimiser, Adam.
        config: sizes.
        kwargs: further arguments of :class:`ActorCriticPolicy`.
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Callable[[float], float],
        config: TeacherPPOConfig | None = None,
        **kwargs: Any,
    ) -> None:
        self._config = config or TeacherPPOConfig()
        widths = list(self._config.net_arch)
        kwargs |= {
            "net_arch": {"pi": widths, "vf": widths},
            "activation_fn": nn.SiLU,
            "log_std_init": self._config.log_std_init,
            "features_extractor_class": _Normalised,
            "features_extractor_kwargs": {"clip": self._config.observation_clip},
            "normalize_images": False,
        }
        self.workers = torch.get_num_threads()
        """Threads that share a minibatch; the results do not depend on it."""
        # The last bits of orthogonal weights depend on the number of threads.
        with torch_threads(1):
            super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    @property
    def normaliser(self) -> _Normalised:
        """The observation's statistics."""
        assert isinstance(self.features_extractor, _Normalised)
        return self.features_extractor

    def _get_action_dist_from_latent(self, latent_pi: Tensor) -> Distribution:
        mean = self._config.action_scale * self.action_net(latent_pi)
        return self.action_dist.proba_distribution(mean, self.standard_log())

    def standard_log(self) -> Tensor:
        """Logarithm of the actions' standard deviations, (A,)."""
        return self.log_std.clamp(min=self._config.log_std_min)

    def action_mean(self, observations: dict[str, Tensor]) -> Tensor:
        """The mean of the actions, (B, A), not clipped."""
        latent = self.mlp_extractor.forward_actor(self.normaliser(observations))
        return self._config.action_scale * self.action_net(latent)

    def mean_and_value(self, observations: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """The mean of the actions (B, A) and the values (B, 1), computed in shards."""
        weights = [weight for weight in self.parameters() if weight is not self.log_std]
        mean, values = in_shards(self._actor_and_critic, weights, observations, self.workers)
        return mean, values

    def _actor_and_critic(self, observations: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        latent_pi, latent_vf = self.mlp_extractor(self.normaliser(observations))
        return self._config.action_scale * self.action_net(latent_pi), self.value_net(latent_vf)

    def act(
        self, observations: dict[str, np.ndarray], rng: np.random.Generator | None
    ) -> np.ndarray:
        """Actions of all users, (N, A) float32 in [-1, 1].

        Args:
            observations: key -> (N, ...).
            rng: Draws the deviation from the mean; None takes the mean.
        """
        with torch.no_grad():
            tensors = {key: torch.as_tensor(value) for key, value in observations.items()}
            mean = self.action_mean(tensors).numpy()
            if rng is not None:
                deviation = np.exp(self.standard_log().numpy())
                mean = mean + deviation * rng.standard_normal(mean.shape, dtype=np.float32)
        return np.clip(mean, -1.0, 1.0).astype(np.float32)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        parameters = super()._get_constructor_parameters()
        for name in (
            *("net_arch", "activation_fn", "log_std_init", "normalize_images"),
            *("features_extractor_class", "features_extractor_kwargs"),
        ):
            parameters.pop(name, None)
        return parameters | {"config": self._config}


class TeacherPPO(ppo.PPO):
    """PPO with a learning rate that follows the policy's change, as updates cost little here.

    Differs from Stable-Baselines3's in this: the learning rate is raised and lowered to keep the
    divergence of an update near ``target_kl``; actor's and critic's gradients are clipped apart;
    means beyond the actions' range cost; the observation's statistics are updated after the
    networks. The first rollout only fills these statistics.
    """

    teacher: TeacherPPOConfig

    def train(self) -> None:
        """Update the networks, then write the iteration's log row."""
        with torch_threads(1):  # shards have threads of their own
            self._update()

    def _update(self) -> None:
        config = self.teacher
        policy = self.policy
        assert isinstance(policy, TeacherPolicy)
        policy.set_training_mode(True)
        buffer = self.rollout_buffer
        observations = torch.from_numpy(buffer.observations[OBSERVATION])
        if policy.normaliser.count == 0:
            policy.normaliser.update(observations.flatten(0, 1))
            self._finish_update({})
            return
        sums: dict[str, list[float]] = {}
        kl = 0.0
        iteration = self.num_timesteps // (self.n_steps * self.n_envs)
        learning = iteration > config.critic_first_iterations
        for _ in range(self.n_epochs):
            kls = []
            for batch in buffer.get(self.batch_size):
                losses, divergence = self._losses(batch)
                policy.optimizer.zero_grad()
                loss = losses["critic"] + (losses["actor"] if learning else 0.0)
                loss.backward()  # type: ignore[no-untyped-call]
                for part in self._parts():
                    nn.utils.clip_grad_norm_(part, config.max_grad_norm)
                policy.optimizer.step()
                kls.append(divergence)
                for name, value in losses.items():
                    sums.setdefault(name, []).append(float(value.detach()))
            kl = float(np.mean(kls))
            self._n_updates += 1
        # The divergence of the last pass, from where the rollout was played.
        if learning:
            self._follow(kl)
        policy.normaliser.update(observations.flatten(0, 1))
        means = {f"train/{name}": float(np.mean(values)) for name, values in sums.items()}
        self._finish_update({**means, "train/approx_kl": kl})

    def _losses(self, batch: Any) -> tuple[dict[str, Tensor], float]:
        config = self.teacher
        policy = self.policy
        assert isinstance(policy, TeacherPolicy)
        mean, values = policy.mean_and_value(batch.observations)
        distribution = policy.action_dist.proba_distribution(mean, policy.standard_log())
        log_prob = distribution.log_prob(batch.actions)
        values = values.flatten()
        advantages = batch.advantages
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        log_ratio = log_prob - batch.old_log_prob
        ratio = torch.exp(log_ratio)
        clipped = torch.clamp(ratio, 1.0 - config.clip_range, 1.0 + config.clip_range)
        surrogate = -torch.min(advantages * ratio, advantages * clipped).mean()
        beyond = torch.relu(mean.abs() - 1.0).square().sum(1).mean()
        entropy = distribution.entropy()
        assert entropy is not None
        actor = surrogate + config.mean_penalty * beyond - config.ent_coef * entropy.mean()
        critic = 0.5 * torch.nn.functional.mse_loss(values, batch.returns)
        with torch.no_grad():
            kl = float((ratio - 1.0 - log_ratio).mean())
            clip_fraction = ((ratio - 1.0).abs() > config.clip_range).float().mean()
        return {
            "actor": actor,
            "critic": critic,
            "policy_gradient_loss": surrogate,
            "entropy_loss": -entropy.mean(),
            "clip_fraction": clip_fraction,
            "mean_beyond": beyond,
        }, kl

    def _parts(self) -> tuple[list[nn.Parameter], list[nn.Parameter]]:
        """Parameters of the actor and of the critic."""
        policy = self.policy
        extractor = policy.mlp_extractor
        actor = [*extractor.policy_net.parameters(), *policy.action_net.parameters()]
        critic = [*extractor.value_net.parameters(), *policy.value_net.parameters()]
        return [*actor, policy.log_std], critic

    def _follow(self, kl: float) -> None:
        target = self.teacher.target_kl
        if target is None:
            return
        least, most = self.teacher.learning_rate_range
        for group in self.policy.optimizer.param_groups:
            rate = group["lr"]
            if kl > 2.0 * target:
                rate /= 1.5
            elif kl < target / 2.0:
                rate *= 1.5
            group["lr"] = min(max(rate, least), most)

    def _finish_update(self, values: dict[str, float]) -> None:
        policy = self.policy
        assert isinstance(policy, TeacherPolicy)
        deviation = torch.exp(policy.standard_log().detach())
        self.logger.record("train/std", float(deviation.mean()))
        self.logger.record("train/learning_rate", policy.optimizer.param_groups[0]["lr"])
        buffer = self.rollout_buffer
        spread = np.var(buffer.returns)
        unexplained = np.var(buffer.returns - buffer.values) / max(float(spread), 1e-8)
        self.logger.record("train/explained_variance", 1.0 - float(unexplained))
        for name, value in values.items():
            self.logger.record(name, value)
        self._write_row()


def build_teacher(
    config: TeacherPPOConfig, env: SimulationVecEnv, *, seed: int, device: str = "cpu"
) -> TeacherPPO:
    """Return a fresh learner, its networks initialised from ``seed``."""
    model = TeacherPPO(
        TeacherPolicy,
        env,
        learning_rate=config.learning_rate,
        n_steps=config.n_steps,
        batch_size=config.batch_size,
        n_epochs=config.n_epochs,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        clip_range=config.clip_range,
        rollout_buffer_class=FrameRolloutBuffer,
        policy_kwargs={"config": config},
        seed=seed,
        device=device,
    )
    model.teacher = config
    return model
