"""The network against a hand-written one and a parameter count by hand."""

import math

import numpy as np
import pytest
import torch
from gymnasium import spaces
from torch.nn import functional as F

from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.runs.config import PolicyConfig

SPACE = spaces.Dict(
    {
        "vision": spaces.Box(0, 255, (2, 80, 120), np.uint8),
        "proprioception": spaces.Box(-np.inf, np.inf, (56,), np.float32),
        "stateful_information": spaces.Box(-1, 1, (1,), np.float32),
    }
)
ACTIONS = spaces.Box(-1, 1, (32,), np.float32)


def make(**settings: object) -> VisualActorCritic:
    torch.manual_seed(3)
    return VisualActorCritic(SPACE, ACTIONS, lambda _: 5e-5, config=PolicyConfig(**settings))


def batch(size: int) -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(5)
    return {
        "vision": torch.randint(0, 256, (size, 2, 80, 120), generator=generator, dtype=torch.uint8),
        "proprioception": torch.randn((size, 56), generator=generator),
        "stateful_information": torch.rand((size, 1), generator=generator),
    }


def test_parameter_count_by_hand() -> None:
    convolutions = (2 * 9 * 8 + 8) + (8 * 9 * 16 + 16) + (16 * 9 * 32 + 32)
    vision = convolutions + 4800 * 256 + 256  # 80x120 -> 40x60 -> 20x30 -> 10x15, 32 channels
    proprioception = 56 * 128 + 128
    mlp = 385 * 256 + 256 + 256 * 256 + 256  # 256 + 128 + 1 features
    heads = (256 * 32 + 32) + (256 + 1) + 32  # action mean, value, log_std
    policy = make()
    assert policy.features_dim == 385
    expected = vision + proprioception + 2 * mlp + heads
    assert sum(p.numel() for p in policy.parameters()) == expected == 1_580_041


def reference_forward(
    weights: dict[str, torch.Tensor], observation: dict[str, torch.Tensor]
) -> tuple[torch.Tensor, torch.Tensor]:
    """The network written down once more, in float64 and channel by channel."""
    w = {key: value.double() for key, value in weights.items()}
    x = (observation["vision"].double() / 255 - 0.5) * 2
    encoder = "features_extractor.encoders"
    for layer in (0, 2, 4):
        name = f"{encoder}.vision.convolutions.{layer}"
        x = F.conv2d(x, w[f"{name}.weight"], w[f"{name}.bias"], stride=2, padding=1)
        x = torch.where(x > 0, x, 0.01 * x)

    def linear(value: torch.Tensor, name: str) -> torch.Tensor:
        return value @ w[f"{name}.weight"].T + w[f"{name}.bias"]

    def leaky(value: torch.Tensor) -> torch.Tensor:
        return torch.where(value > 0, value, 0.01 * value)

    vision = leaky(linear(x.reshape(len(x), -1), f"{encoder}.vision.linear.0"))
    body = leaky(linear(observation["proprioception"].double(), f"{encoder}.proprioception.0"))
    features = torch.cat([vision, body, observation["stateful_information"].double()], 1)
    latent = {}
    for net in ("actor", "critic"):
        hidden = leaky(linear(features, f"mlp_extractor.{net}.0"))
        latent[net] = leaky(linear(hidden, f"mlp_extractor.{net}.2"))
    mean = torch.tanh(linear(latent["actor"], "action_net"))
    return mean, linear(latent["critic"], "value_net")


def test_forward_equals_a_hand_written_network() -> None:
    policy = make()
    with torch.no_grad():
        policy.action_net.weight.mul_(100.0)  # else tanh is all but linear
        policy.action_net.bias.uniform_(-1, 1)
        observation = batch(6)
        mean, value = reference_forward(policy.state_dict(), observation)
        actions, values, _ = policy(observation, deterministic=True)
        assert mean.abs().max() > 0.5
        np.testing.assert_allclose(actions, mean, atol=2e-6)
        np.testing.assert_allclose(values, value, atol=2e-5)
        np.testing.assert_allclose(policy.action_mean(observation), mean, atol=2e-6)
        np.testing.assert_allclose(policy.predict_values(observation), value, atol=2e-5)
        np.testing.assert_allclose(policy.get_distribution(observation).mode(), mean, atol=2e-6)


def test_samples_are_gaussian_around_the_squashed_mean() -> None:
    policy = make()
    observation = {key: value[:1].repeat(4000, *[1] * (value.dim() - 1)) for key, value in
                   batch(1).items()}  # fmt: skip
    with torch.no_grad():
        torch.manual_seed(0)
        features = policy.extract_features({key: value[:1] for key, value in observation.items()})
        latent = policy.mlp_extractor.forward_actor(features)
        distribution = policy._get_action_dist_from_latent(latent.repeat(4000, 1))
        samples = distribution.get_actions()
        assert samples.abs().max() > 2.0, "samples are not squashed"
        np.testing.assert_allclose(samples.std(0), 1.0, atol=0.06)
        np.testing.assert_allclose(samples.mean(0), distribution.mode()[0], atol=0.08)
        # log N(m; m, 1) = -log(2 pi) / 2 per action
        log_prob = distribution.log_prob(distribution.mode())[0]
        assert log_prob.item() == pytest.approx(-16 * math.log(2 * math.pi), rel=1e-6)


def gain(weight: torch.Tensor) -> np.ndarray:
    """Singular values of a layer's matrix."""
    return torch.linalg.svdvals(weight.detach().reshape(len(weight), -1).double()).numpy()


def test_orthogonal_initialisation() -> None:
    policy = make()
    expected = {"action_net": 0.01, "value_net": 1.0}
    checked = 0
    for name, parameter in policy.named_parameters():
        if name.endswith("bias") or name == "log_std":
            assert not parameter.detach().any(), name
        else:
            want = expected.get(name.split(".")[0], math.sqrt(2))
            np.testing.assert_allclose(gain(parameter), want, rtol=1e-5, err_msg=name)
            checked += 1
    assert checked == 11


def test_scaled_proprioception_by_hand() -> None:
    plain, scaled = make(), make(scale_proprioception=True)
    observation = batch(3)
    with torch.no_grad():
        assert torch.equal(plain.action_mean(observation), scaled.action_mean(observation))
        mean = np.linspace(-2, 2, 56)
        std = np.linspace(0.5, 4, 56)
        std[7] = 0.0  # never changes: counts as 1
        scaled.fit_scaling(mean, std)
        divisor = np.where(std == 0.0, 1.0, std)
        by_hand = (observation["proprioception"].double().numpy() - mean) / divisor
        turned = observation | {"proprioception": torch.from_numpy(by_hand).float()}
        np.testing.assert_allclose(
            scaled.action_mean(observation), plain.action_mean(turned), atol=1e-6
        )
    other = make(scale_proprioception=True)
    other.load_state_dict(scaled.state_dict())
    with torch.no_grad():
        assert torch.equal(other.action_mean(observation), scaled.action_mean(observation))
    names = plain.state_dict().keys()
    extra = [name for name in scaled.state_dict() if name not in names]
    assert {name.rpartition("proprioception.")[2] for name in extra} == {
        "scaling.mean",
        "scaling.std",
    }
    count = sum(p.numel() for p in plain.parameters())
    assert sum(p.numel() for p in scaled.parameters()) == count, "nothing more to learn"


def test_any_picture_has_an_encoder_and_any_other_sense_is_taken_as_it_is() -> None:
    space = spaces.Dict(
        {
            "sight": spaces.Box(0, 255, (4, 16, 24), np.uint8),
            "fingers": spaces.Box(-1, 1, (2,), np.float32),
            "haptics": spaces.Box(0, 1, (2,), np.float32),
            "proprioception": spaces.Box(-np.inf, np.inf, (112,), np.float32),  # with its history
        }
    )
    policy = VisualActorCritic(space, ACTIONS, lambda _: 5e-5, config=PolicyConfig())
    assert list(policy.features_extractor.encoders) == [
        "sight",
        "proprioception",
        "fingers",
        "haptics",
    ]
    assert policy.features_dim == 256 + 128 + 2 + 2
    assert policy.in_shards
    seen = {key: torch.as_tensor(box.sample()[None]) for key, box in space.spaces.items()}
    seen["proprioception"] = torch.zeros((1, 112))
    with torch.no_grad():
        one = policy.action_mean(seen)
        other = policy.action_mean({**seen, "sight": 255 - seen["sight"]})
    assert (one != other).any()
    blind = spaces.Dict({"proprioception": space["proprioception"]})
    assert not VisualActorCritic(blind, ACTIONS, lambda _: 5e-5).in_shards
