"""The reference's policy network (User-in-the-Box) for Stable-Baselines3.

Encoders -> 385 features, shared by actor and critic -> two separate MLPs of 256x256 with
LeakyReLU. The mean of the actions is tanh(linear(latent)); their standard deviation is one number
per action, independent of the observation. Samples are clipped to [-1, 1] by Stable-Baselines3,
not squashed. Weights are orthogonal: gain sqrt(2) in encoders and MLPs, 0.01 before the tanh, 1 in
the value's layer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from sim2vr_harness.training.config import PolicyConfig

__all__ = ["UserFeatures", "UserPolicy", "policy_arguments"]

VISION = "vision"
PROPRIOCEPTION = "proprioception"


class VisionEncoder(nn.Module):
    """3x3 convolutions of stride 2 and padding 1, flattened into one linear layer.

    Args:
        image_shape: (C, H, W) of the uint8 image.
        channels: Output channels of the convolutions.
        features: Number of outputs.
    """

    def __init__(self, image_shape: Sequence[int], channels: Sequence[int], features: int) -> None:
        super().__init__()
        inputs, height, width = image_shape
        layers: list[nn.Module] = []
        for outputs in channels:
            layers += [nn.Conv2d(inputs, outputs, 3, stride=2, padding=1), nn.LeakyReLU()]
            inputs, height, width = outputs, (height + 1) // 2, (width + 1) // 2
        self.convolutions = nn.Sequential(*layers)
        self.linear = nn.Sequential(nn.Linear(inputs * height * width, features), nn.LeakyReLU())

    def forward(self, image: Tensor) -> Tensor:
        """Encode a batch of images.

        Args:
            image: (B, C, H, W) uint8.

        Returns:
            (B, features) float32.
        """
        scaled = image.to(torch.float32, memory_format=torch.channels_last)
        scaled = scaled.div_(127.5).sub_(1.0) if scaled is not image else image / 127.5 - 1.0
        # .contiguous() first: the flattened order is the reference's, channel by channel.
        return self.linear(self.convolutions(scaled).contiguous().flatten(1))


class UserFeatures(BaseFeaturesExtractor):
    """Encoders side by side: vision, proprioception, and everything else as it is.

    Args:
        observation_space: A dictionary of boxes; ``vision`` and ``proprioception`` have encoders.
        config: Sizes of the encoders.
    """

    def __init__(self, observation_space: spaces.Dict, config: PolicyConfig) -> None:
        known = {
            VISION: config.vision_features,
            PROPRIOCEPTION: config.proprioception_features,
        }
        # A fixed order, whatever order the space was written in.
        names = [key for key in known if key in observation_space.spaces]
        names += sorted(observation_space.spaces.keys() - known.keys())
        sizes = {
            key: known[key] if key in known else spaces.flatdim(observation_space[key])
            for key in names
        }
        super().__init__(observation_space, features_dim=sum(sizes.values()))
        encoders: dict[str, nn.Module] = {}
        for key in names:
            shape = observation_space[key].shape or ()
            if key == VISION:
                encoders[key] = VisionEncoder(shape, config.vision_channels, sizes[key])
            elif key == PROPRIOCEPTION:
                encoders[key] = nn.Sequential(nn.Linear(shape[0], sizes[key]), nn.LeakyReLU())
            else:
                encoders[key] = nn.Flatten()
        self.encoders = nn.ModuleDict(encoders)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Encode a batch of observations.

        Args:
            observations: key -> (B, ...), in the dtypes of the observation space.

        Returns:
            (B, features_dim) float32.
        """
        parts = []
        for key, encoder in self.encoders.items():
            observation = observations[key]
            parts.append(encoder(observation if key == VISION else observation.float()))
        return torch.cat(parts, dim=1)


class _Mlp(nn.Module):
    """Hidden layers of actor and critic, separate or shared."""

    def __init__(self, inputs: int, widths: Sequence[int], shared: bool) -> None:
        super().__init__()
        self.latent_dim_pi = self.latent_dim_vf = widths[-1] if widths else inputs
        self.actor = _hidden_layers(inputs, widths)
        self.critic = self.actor if shared else _hidden_layers(inputs, widths)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        latent_pi = self.actor(features)
        return latent_pi, latent_pi if self.critic is self.actor else self.critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        return self.actor(features)

    def forward_critic(self, features: Tensor) -> Tensor:
        return self.critic(features)


def _hidden_layers(inputs: int, widths: Sequence[int]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in widths:
        layers += [nn.Linear(inputs, width), nn.LeakyReLU()]
        inputs = width
    return nn.Sequential(*layers)


class UserPolicy(ActorCriticPolicy):
    """Actor and critic of a simulated user; see the module's description.

    Args:
        observation_space: Dictionary space of the environment.
        action_space: Box(-1, 1, (A,)).
        lr_schedule: Learning rate of the optimiser (Adam, eps 1e-5).
        config: Sizes of the network.
        kwargs: Further arguments of :class:`ActorCriticPolicy`.
    """

    def __init__(
        self,
        observation_space: spaces.Space,
        action_space: spaces.Space,
        lr_schedule: Callable[[float], float],
        config: PolicyConfig | None = None,
        **kwargs: Any,
    ) -> None:
        self._config = config or PolicyConfig()
        kwargs |= {
            "net_arch": list(self._config.net_arch),
            "activation_fn": nn.LeakyReLU,
            "log_std_init": self._config.log_std_init,
            "features_extractor_class": UserFeatures,
            "features_extractor_kwargs": {"config": self._config},
            "normalize_images": False,
        }
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        # Channels last makes a minibatch about 1.8 times as fast on the CPU. Orthogonal weights
        # can only be drawn before.
        self.features_extractor.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def _build_mlp_extractor(self) -> None:
        mlp = _Mlp(self.features_dim, self._config.net_arch, self._config.shared_mlp)
        self.mlp_extractor = mlp.to(self.device)  # type: ignore[assignment]

    def _get_action_dist_from_latent(self, latent_pi: Tensor) -> Distribution:
        mean = torch.tanh(self.action_net(latent_pi))
        return self.action_dist.proba_distribution(mean, self.log_std)

    def extract_features(  # type: ignore[override]
        self, obs: dict[str, Tensor], features_extractor: BaseFeaturesExtractor | None = None
    ) -> Tensor:
        """Encode observations as they come: images stay uint8 until the encoder scales them."""
        return (features_extractor or self.features_extractor)(obs)

    def get_distribution(  # type: ignore[override]
        self, obs: dict[str, Tensor]
    ) -> Distribution:
        """Return the distribution of the actions; obs: key -> (B, ...)."""
        latent = self.mlp_extractor.forward_actor(self.extract_features(obs))
        return self._get_action_dist_from_latent(latent)

    def predict_values(self, obs: dict[str, Tensor]) -> Tensor:  # type: ignore[override]
        """Return the critic's values, (B, 1); obs: key -> (B, ...)."""
        return self.value_net(self.mlp_extractor.forward_critic(self.extract_features(obs)))

    def action_mean(self, obs: dict[str, Tensor]) -> Tensor:
        """Return the mean of the actions, (B, A); obs: key -> (B, ...)."""
        return torch.tanh(
            self.action_net(self.mlp_extractor.forward_actor(self.extract_features(obs)))
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        parameters = super()._get_constructor_parameters()
        ours = ("net_arch", "activation_fn", "log_std_init", "normalize_images")
        for name in (*ours, "features_extractor_class", "features_extractor_kwargs"):
            parameters.pop(name, None)
        return parameters | {"config": self._config}


def policy_arguments(config: PolicyConfig) -> dict[str, Any]:
    """Return the ``policy_kwargs`` with which PPO builds a :class:`UserPolicy`."""
    return {"config": config}
