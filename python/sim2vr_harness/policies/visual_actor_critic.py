"""The reference's policy network (User-in-the-Box) for Stable-Baselines3.

Encoders -> 385 features, shared by actor and critic -> two separate MLPs of 256x256 with
LeakyReLU. The mean of the actions is tanh(linear(latent)); their standard deviation is one number
per action, independent of the observation. Samples are clipped to [-1, 1] by Stable-Baselines3,
not squashed. Weights are orthogonal: gain sqrt(2) in encoders and MLPs, 0.01 before the tanh, 1 in
the value's layer.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn
from torch.nn import functional

from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.policies.attention_crops import AttentionCrops
from sim2vr_harness.policies.conv import cast, centred, channels_last, convolutions, convolved
from sim2vr_harness.policies.protocol import shapes_in_words
from sim2vr_harness.policies.sharding import in_shards
from sim2vr_harness.runs.config import PolicyConfig

PROPRIOCEPTION = "proprioception"


def is_image(space: spaces.Space[Any]) -> bool:
    """Return whether an observation is a picture: (C, H, W) bytes, whatever it is called."""
    return space.dtype == np.uint8 and len(space.shape or ()) == 3


class VisionEncoder(nn.Module):
    """3x3 convolutions of stride 2 and padding 1, flattened into one linear layer.

    Args:
        image_shape: (C, H, W) of the uint8 image.
        dtype: What is computed in. Weights are float32 either way.
    """

    def __init__(
        self,
        image_shape: Sequence[int],
        channels: Sequence[int],
        features: int,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        self.dtype = dtype
        inputs, height, width = image_shape
        self.convolutions = convolutions(inputs, channels)
        smaller = 2 ** len(channels)
        flat = channels[-1] * -(-height // smaller) * -(-width // smaller)
        self.linear = nn.Sequential(nn.Linear(flat, features), nn.LeakyReLU())

    def forward(self, image: Tensor) -> Tensor:
        """Encode a batch of images.

        Args:
            image: (B, C, H, W) uint8. Quickest if stored channels last, as the rollout buffer does.

        Returns:
            (B, features) float32.
        """
        x = convolved(self.convolutions, centred(channels_last(image), self.dtype))
        layer = self.linear[0]
        assert isinstance(layer, nn.Linear)
        weight, bias = cast(layer.weight, layer.bias, self.dtype)
        if len(x) < len(weight) // 2:
            flat_linear = functional.linear(x.contiguous().flatten(1), weight, bias)
        else:
            weight = weight.view(len(weight), *x.shape[1:]).permute(0, 2, 3, 1).flatten(1)
            flat_linear = functional.linear(x.permute(0, 2, 3, 1).flatten(1), weight, bias)
        return functional.leaky_relu_(flat_linear).float()


class Scaling(nn.Module):
    """Standardises its inputs with a mean and a standard deviation that are not learned.

    Args:
        inputs: Number of inputs. Until they are set, the mean is 0 and the deviation 1.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("std", torch.ones(inputs))

    def forward(self, values: Tensor) -> Tensor:
        """Scale (B, inputs)."""
        return (values - self.mean) / self.std


class UserFeatures(BaseFeaturesExtractor):
    """Parallel encoders: pictures, proprioception, and everything else as it is.

    Args:
        observation_space: A dictionary of boxes; pictures and ``proprioception`` have encoders.
    """

    def __init__(self, observation_space: spaces.Dict, config: PolicyConfig) -> None:
        images = sorted(key for key, box in observation_space.spaces.items() if is_image(box))
        known = dict.fromkeys(images, config.vision_features)
        known[PROPRIOCEPTION] = config.proprioception_features
        # A fixed order, whatever order the space was written in.
        names = [key for key in known if key in observation_space.spaces]
        names += sorted(observation_space.spaces.keys() - known.keys())
        sizes = {
            key: known[key] if key in known else spaces.flatdim(observation_space[key])
            for key in names
        }
        dtype = getattr(torch, config.vision_precision)
        crops = None
        if config.attention_crops is not None:
            shapes = {key: observation_space[key].shape or () for key in images}
            crops = AttentionCrops(shapes, config.attention_crops, dtype)
        looked = 0 if crops is None else crops.outputs
        super().__init__(observation_space, features_dim=sum(sizes.values()) + looked)
        encoders: dict[str, nn.Module] = {}
        for key in names:
            shape = observation_space[key].shape or ()
            if key in images:
                encoders[key] = VisionEncoder(shape, config.vision_channels, sizes[key], dtype)
            elif key == PROPRIOCEPTION:
                layers = {"0": nn.Linear(shape[0], sizes[key]), "1": nn.LeakyReLU()}
                if config.scale_proprioception:
                    layers = {"scaling": Scaling(shape[0])} | layers
                encoders[key] = nn.Sequential(OrderedDict(layers))
            else:
                encoders[key] = nn.Flatten()
        self.encoders = nn.ModuleDict(encoders)
        self._images = frozenset(images)
        self.attention_crops = crops
        self.picture_features = looked + len(images) * config.vision_features
        """The first so many features are those of pictures."""

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Encode a batch of observations.

        Args:
            observations: key -> (B, ...), in the dtypes of the observation space.

        Returns:
            (B, features_dim) float32.
        """
        return self.look(observations)[0]

    def look(self, observations: dict[str, Tensor]) -> tuple[Tensor, Tensor | None]:
        """Encode as :meth:`forward` does; also return the places of the attention crops."""
        parts, where = [], None
        if self.attention_crops is not None:
            where = self.attention_crops.where(observations["vision"])
            parts.append(self.attention_crops(observations, where))
        for key, encoder in self.encoders.items():
            observation = observations[key]
            parts.append(encoder(observation if key in self._images else observation.float()))
        return torch.cat(parts, dim=1), where


class _Mlp(nn.Module):
    """Hidden layers of actor and critic."""

    def __init__(self, inputs: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.latent_dim_pi = self.latent_dim_vf = widths[-1] if widths else inputs
        self.actor = _hidden_layers(inputs, widths)
        self.critic = _hidden_layers(inputs, widths)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        return self.actor(features), self.critic(features)

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


class VisualActorCritic(ActorCriticPolicy):
    """Actor and critic of a simulated user; see the module's description.

    Args:
        action_space: Box(-1, 1, (A,)).
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
        # Stable-Baselines3's epsilon; one pass over the weights instead of a dozen.
        kwargs.setdefault("optimizer_kwargs", {"eps": 1e-5, "fused": True})
        self.workers = torch.get_num_threads()
        """Threads that share a batch of images on the CPU; the results do not depend on it."""
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    def __repr__(self) -> str:
        """Return what it observes, and the sizes of its action and its network."""
        observed = self.observation_space
        boxes = observed.spaces if isinstance(observed, spaces.Dict) else {"": observed}
        shapes = shapes_in_words({key: box.shape or () for key, box in boxes.items()})
        size = sum(each.numel() for each in self.parameters())
        actions = f"{self.action_space.shape} actions"
        return f"{type(self).__name__}({shapes}; {actions}; {size:,} weights)"

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        # The last bits of orthogonal weights depend on the number of threads.
        with torch_threads(1):
            super()._build(lr_schedule)
        # Channels last makes a minibatch about 1.8 times as fast on the CPU. Orthogonal weights
        # can only be drawn before.
        self.features_extractor.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def _build_mlp_extractor(self) -> None:
        mlp = _Mlp(self.features_dim, self._config.net_arch)
        self.mlp_extractor = mlp.to(self.device)  # type: ignore[assignment]

    def _get_action_dist_from_latent(self, latent_pi: Tensor) -> Distribution:
        return self._distribution(torch.tanh(self.action_net(latent_pi)))

    def _distribution(self, mean: Tensor) -> Distribution:
        return self.action_dist.proba_distribution(mean, self.log_std)

    def forward(
        self,
        obs: dict[str, Tensor],  # type: ignore[override]
        deterministic: bool = False,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return actions (B, A), values (B, 1) and log probabilities (B,); obs: key -> (B, ...)."""
        mean, values = self._mean_and_value(obs)
        distribution = self._distribution(mean)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, values, distribution.log_prob(actions)

    def evaluate_actions(  # type: ignore[override]
        self, obs: dict[str, Tensor], actions: Tensor
    ) -> tuple[Tensor, Tensor, Tensor | None]:
        """Return values (B, 1), log probabilities (B,) and entropy (B,) of actions (B, A)."""
        mean, values = self._mean_and_value(obs)
        distribution = self._distribution(mean)
        return values, distribution.log_prob(actions), distribution.entropy()

    def _mean_and_value(self, obs: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Return the mean of the actions (B, A) and the values (B, 1)."""
        if not self.in_shards:
            return self._actor_and_critic(obs)
        parameters = [
            parameter
            for parameter in self.parameters()
            if parameter.requires_grad and parameter is not self.log_std
        ]
        mean, values = in_shards(self._actor_and_critic, parameters, obs, self.workers)
        return mean, values

    def _actor_and_critic(self, obs: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        latent_pi, latent_vf = self.mlp_extractor(self.extract_features(obs))
        return torch.tanh(self.action_net(latent_pi)), self.value_net(latent_vf)

    def _actor(self, obs: dict[str, Tensor]) -> tuple[Tensor]:
        latent = self.mlp_extractor.forward_actor(self.extract_features(obs))
        return (torch.tanh(self.action_net(latent)),)

    @property
    def in_shards(self) -> bool:
        """True if batches are computed in shards, one thread each: images on the CPU."""
        entries: Any = self.observation_space
        has_images = any(is_image(space) for space in entries.spaces.values())
        return has_images and self.device.type == "cpu"

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
        if self.in_shards and not torch.is_grad_enabled():
            return in_shards(self._actor, (), obs, self.workers)[0]
        return self._actor(obs)[0]

    def critic_parameters(self) -> list[Tensor]:
        """Return the weights that only the values depend on."""
        mlp: Any = self.mlp_extractor
        hidden = [] if mlp.critic is mlp.actor else list(mlp.critic.parameters())
        return [*hidden, *self.value_net.parameters()]

    def fit_scaling(self, mean: NDArray, std: NDArray) -> None:
        """Set with what proprioception is standardised (``policy.scale_proprioception``).

        Args:
            mean: (P,) means of the proprioception's numbers.
            std: (P,) their standard deviations; 0, of a number that never changes, counts as 1.

        Raises:
            RuntimeError: The policy does not scale its proprioception.
            ValueError: A shape is wrong, or a number is negative or not finite.
        """
        extractor: Any = self.features_extractor
        scaling = getattr(extractor.encoders[PROPRIOCEPTION], "scaling", None)
        if scaling is None:
            raise RuntimeError("policy.scale_proprioception: got False, expected True to set it")
        for name, values in (("mean", mean), ("std", std)):
            if np.shape(values) != tuple(scaling.mean.shape):
                expected = tuple(scaling.mean.shape)
                raise ValueError(f"{name}: got shape {np.shape(values)}, expected {expected}")
            if not np.isfinite(values).all() or (name == "std" and np.min(values) < 0.0):
                raise ValueError(
                    f"{name}: got {values}, expected finite numbers, no deviation below 0"
                )
        scaling.mean.copy_(torch.as_tensor(mean))
        scaling.std.copy_(torch.as_tensor(np.where(np.asarray(std) == 0.0, 1.0, std)))

    def _get_constructor_parameters(self) -> dict[str, Any]:
        parameters = super()._get_constructor_parameters()
        ours = ("net_arch", "activation_fn", "log_std_init", "normalize_images")
        for name in (*ours, "features_extractor_class", "features_extractor_kwargs"):
            parameters.pop(name, None)
        return parameters | {"config": self._config}
