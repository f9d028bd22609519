"""The teacher's network: actor and critic on normalised numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.policies.sb3_base import StagePolicy
from sim2vr_harness.policies.sharding import in_shards
from sim2vr_harness.runs.checkpoint import load_policy_weights
from sim2vr_harness.runs.teacher_config import TeacherPolicyConfig

_HIDDEN_WIDTHS = (256, 256)
"""Of actor and critic each: privileged observations are few numbers."""
_ACTION_SCALE = 0.5
"""Factor on the actor's outputs: actions begin well within their range."""
_OBSERVATION_CLIP = 8.0
"""Largest normalised observation, in standard deviations."""


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


class TeacherPolicy(StagePolicy):
    """Two separate networks with SiLU on the normalised observation, and a Gaussian.

    The mean is not squashed; what acts is clipped to [-1, 1], as the student's actions are.

    Args:
        observation_space: ``{"teacher": Box}``.
        action_space: Box(-1, 1, (A,)).
        lr_schedule: of the optimiser, Adam.
        config: sizes.
        kwargs: further arguments of Stable-Baselines3's ``ActorCriticPolicy``.
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Callable[[float], float],
        config: TeacherPolicyConfig | None = None,
        **kwargs: Any,
    ) -> None:
        self._config = config or TeacherPolicyConfig()
        widths = list(_HIDDEN_WIDTHS)
        kwargs |= {
            "net_arch": {"pi": widths, "vf": widths},
            "activation_fn": nn.SiLU,
            "log_std_init": self._config.log_std_init,
            "features_extractor_class": _Normalised,
            "features_extractor_kwargs": {"clip": _OBSERVATION_CLIP},
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
        mean = _ACTION_SCALE * self.action_net(latent_pi)
        return self.action_dist.proba_distribution(mean, self.standard_log())

    def standard_log(self) -> Tensor:
        """Logarithm of the actions' standard deviations, (A,)."""
        return self.log_std.clamp(min=self._config.log_std_min)

    def action_mean(self, observations: dict[str, Tensor]) -> Tensor:
        """The mean of the actions, (B, A), not clipped."""
        latent = self.mlp_extractor.forward_actor(self.normaliser(observations))
        return _ACTION_SCALE * self.action_net(latent)

    @property
    def in_shards(self) -> bool:
        """See the base class."""
        return self.device.type == "cpu"

    def critic_parameters(self) -> list[Tensor]:
        """See the base class."""
        mlp = self.mlp_extractor
        return [*mlp.value_net.parameters(), *self.value_net.parameters()]

    def end_update(self, observations: dict[str, Any]) -> None:
        """Take the rollout's observations into the statistics."""
        seen = torch.from_numpy(observations[OBSERVATION]).to(self.device)
        self.normaliser.update(seen.flatten(0, 1))

    def evaluate_actions(  # type: ignore[override]
        self, obs: dict[str, Tensor], actions: Tensor
    ) -> tuple[Tensor, Tensor, Tensor | None]:
        """Return values (B, 1), log probabilities (B,) and entropy (B,) of actions (B, A)."""
        mean, values = self._mean_and_value(obs)
        distribution = self.action_dist.proba_distribution(mean, self.standard_log())
        return values, distribution.log_prob(actions), distribution.entropy()

    def _mean_and_value(self, obs: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        if not self.in_shards:
            return self._actor_and_critic(obs)
        parameters = [
            weight
            for weight in self.parameters()
            if weight.requires_grad and weight is not self.log_std
        ]
        mean, values = in_shards(self._actor_and_critic, parameters, obs, self.workers)
        return mean, values

    def _actor_and_critic(self, observations: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        latent_pi, latent_vf = self.mlp_extractor(self.normaliser(observations))
        return _ACTION_SCALE * self.action_net(latent_pi), self.value_net(latent_vf)

    def act(
        self, observations: dict[str, np.ndarray], rng: np.random.Generator | None
    ) -> np.ndarray:
        """Actions of all users, (N, A) float32 in [-1, 1].

        Args:
            observations: key -> (N, ...).
            rng: Draws the deviation from the mean; None takes the mean.
        """
        with torch.no_grad():
            tensors = {
                key: torch.as_tensor(value, device=self.device)
                for key, value in observations.items()
            }
            mean = self.action_mean(tensors).cpu().numpy()
            if rng is not None:
                deviation = np.exp(self.standard_log().cpu().numpy())
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


def new_teacher(
    observation_space: spaces.Dict,
    action_space: spaces.Space[Any],
    config: TeacherPolicyConfig,
    *,
    seed: int,
) -> TeacherPolicy:
    """Return a teacher that has learned nothing, with the weights that PPO would draw."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return TeacherPolicy(observation_space, action_space, lambda _: 0.0, config=config)


def load_teacher(
    file: Path,
    observation_space: spaces.Dict,
    action_space: spaces.Space[Any],
    config: TeacherPolicyConfig,
) -> TeacherPolicy:
    """Return the policy of a checkpoint, ready to act.

    Raises:
        InputError: the file is no checkpoint, or its network has other shapes.
    """
    policy = new_teacher(observation_space, action_space, config, seed=0)
    load_policy_weights(file, policy)
    policy.set_training_mode(False)
    return policy
