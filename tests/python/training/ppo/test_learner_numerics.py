"""What is quick must compute what Stable-Baselines3 and plain torch compute."""

from typing import Any

import numpy as np
import pytest
import torch
from fake_simulation import FakeSimulation
from stable_baselines3.common.buffers import DictRolloutBuffer
from stable_baselines3.common.logger import Logger
from test_trainer import tiny
from test_visual_actor_critic import batch, make, reference_forward
from torch import Tensor, nn

from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.training.ppo import ppo
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv


class PlainEncoder(nn.Module):
    """The vision encoder as the reference writes it; the weights are another's."""

    def __init__(self, encoder: Any) -> None:
        super().__init__()
        self.convolutions = encoder.convolutions.to(memory_format=torch.contiguous_format)
        self.linear = encoder.linear

    def forward(self, image: Tensor) -> Tensor:
        scaled = (image.to(self.linear[0].weight.dtype) / 255.0 - 0.5) * 2.0
        return self.linear(self.convolutions(scaled).flatten(1))


class Whole(VisualActorCritic):
    """Takes batches as a whole."""

    in_shards = False


def make_plain(policy: VisualActorCritic) -> VisualActorCritic:
    """Take all that is ours out of a policy: layout, folding, shards, fused Adam."""
    encoders: Any = policy.features_extractor.encoders
    encoders["vision"] = PlainEncoder(encoders["vision"])
    policy.__class__ = Whole
    settings = policy.optimizer.defaults | {"fused": None}
    policy.optimizer = torch.optim.Adam(policy.parameters(), settings["lr"], eps=settings["eps"])
    return policy


def spread(policy: VisualActorCritic) -> VisualActorCritic:
    """Make the actions depend on the image: initially they are all but zero."""
    with torch.no_grad():
        policy.action_net.weight.mul_(50.0)
    return policy


def ppo_loss(mean: Tensor, values: Tensor, log_std: Tensor) -> Tensor:
    """PPO's loss of a minibatch with some actions and advantages, every third sample clipped."""
    generator = torch.Generator().manual_seed(7)
    actions = torch.randn(mean.shape, generator=generator).to(mean.dtype)
    advantages = torch.randn(len(mean), generator=generator).to(mean.dtype)
    normal = torch.distributions.Normal(mean, log_std.exp())
    log_prob = normal.log_prob(actions).sum(1)
    ratio = torch.exp(log_prob - log_prob.detach() + 0.3 * advantages)
    policy_loss = -torch.min(advantages * ratio, advantages * ratio.clamp(0.8, 1.2)).mean()
    value_loss = (values.flatten() - advantages).square().mean()
    return policy_loss + 0.5 * value_loss - 0.01 * normal.entropy().sum(1).mean()


def minibatch(policy: VisualActorCritic, size: int) -> dict[str, Tensor]:
    """The policy's outputs, PPO's loss and its gradients, by name."""
    mean, values = policy._mean_and_value(batch(size))
    loss = ppo_loss(mean, values, policy.log_std)
    policy.zero_grad()
    loss.backward()
    found = {"mean": mean, "values": values, "loss": loss}
    return {key: value.detach() for key, value in found.items()} | gradients(policy)


def gradients(policy: VisualActorCritic) -> dict[str, Tensor]:
    return {f"gradient of {name}": p.grad for name, p in policy.named_parameters()}


def exact_minibatch(policy: VisualActorCritic, size: int) -> dict[str, Tensor]:
    """The same in float64, by the network that the test of the forward pass writes by hand."""
    weights = {name: p.detach().double().requires_grad_() for name, p in policy.named_parameters()}
    mean, values = reference_forward(weights, batch(size))
    loss = ppo_loss(mean, values, weights["log_std"])
    loss.backward()
    found = {"mean": mean.detach(), "values": values.detach(), "loss": loss.detach()}
    return found | {f"gradient of {name}": value.grad for name, value in weights.items()}


def errors(found: dict[str, Tensor], exact: dict[str, Tensor]) -> dict[str, float]:
    """Largest error of each, relative to the largest value."""
    assert found.keys() == exact.keys()
    return {
        name: float((found[name].double() - exact[name]).abs().max() / exact[name].abs().max())
        for name in found
    }


def test_losses_and_gradients_are_as_exact_as_plain_torch() -> None:
    policy = spread(make())
    policy.workers = 3
    size = 200  # in three shards of 67, 67 and 66
    exact = exact_minibatch(policy, size)
    for found in (minibatch(policy, size), minibatch(make_plain(policy), size)):
        for name, error in errors(found, exact).items():
            # Of the million numbers before a LeakyReLU a few change their sign with the rounding,
            # and with it their derivative, 1 or 0.01, in either way of computing.
            kinks = "convolutions" in name
            assert error < (1e-2 if kinks else 3e-6), (name, error)
            cosine = nn.functional.cosine_similarity(
                found[name].flatten().double(), exact[name].flatten(), 0
            )
            assert cosine > (1 - 1e-5 if kinks else 1 - 1e-10), name


def test_bfloat16_stays_near() -> None:
    policy = spread(make(vision_precision="bfloat16"))
    policy.workers = 3
    assert all(p.dtype == torch.float32 for p in policy.parameters())
    exact = exact_minibatch(policy, 200)
    found = minibatch(policy, 200)
    wrong = errors(found, exact)
    # 8 significant bits: up to 0.4 % per number, less where 256 features are summed.
    assert wrong["loss"] < 0.005
    assert wrong["mean"] < 0.01
    assert wrong["values"] < 0.02
    for name, gradient in gradients(policy).items():
        ours, true = gradient.flatten().double(), exact[name].flatten()
        assert nn.functional.cosine_similarity(ours, true, 0) > 0.98, name
        assert 0.9 < ours.norm() / true.norm() < 1.1, name


def test_the_number_of_threads_does_not_change_a_bit() -> None:
    found = []
    for threads in (1, 2, 3):
        with torch_threads(threads):
            policy = spread(make())
            assert policy.workers == threads
            with torch_threads(1):  # as in PPO.train
                found.append(minibatch(policy, 300))
            with torch.no_grad():
                found[-1]["acting"] = policy.action_mean(batch(70))
                found[-1]["alone"] = policy.action_mean(batch(1))
    for other in found[1:]:
        assert all(torch.equal(value, other[name]) for name, value in found[0].items())


BIG = {"n_envs": 40, "n_steps": 10, "batch_size": 200, "n_epochs": 3,
       "learning_rate": {"initial": 1e-3, "final": 1e-5}}  # fmt: skip
"""Two shards in every step and in every minibatch."""


def learn(plain: bool, monkeypatch: pytest.MonkeyPatch, iterations: int) -> dict[str, Tensor]:
    config = tiny(ppo=BIG)
    env = SimulationVecEnv(FakeSimulation(config.env, 40))
    with monkeypatch.context() as patch:
        if plain:
            patch.setattr(ppo, "FrameRolloutBuffer", DictRolloutBuffer)
        model = ppo.build(config, env)
    policy = model.policy
    assert isinstance(policy, VisualActorCritic)
    assert policy.in_shards
    if plain:
        make_plain(policy)
        assert not policy.in_shards
        assert type(model.rollout_buffer) is DictRolloutBuffer
    model.set_logger(Logger(folder=None, output_formats=[]))
    model.learn(iterations * 400)
    return {key: value.clone() for key, value in model.policy.state_dict().items()}


def test_a_training_ends_where_plain_stable_baselines3_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with torch_threads(2):
        start = learn(False, monkeypatch, 0)
        ours, plain = learn(False, monkeypatch, 3), learn(True, monkeypatch, 3)
    assert ours.keys() == plain.keys()
    moved = max(float((ours[key] - start[key]).abs().max()) for key in ours)
    assert moved > 2e-3, "18 steps of Adam at up to 1e-3"
    for key in ours:
        np.testing.assert_allclose(ours[key], plain[key], atol=1e-5, err_msg=key)


def test_a_critic_learns_at_a_rate_of_its_own() -> None:
    rates = {"learning_rate": {"initial": 1e-3, "final": 1e-3}, "critic_learning_rate_factor": 5.0}
    config = tiny(ppo=BIG | rates)
    model = ppo.build(config, SimulationVecEnv(FakeSimulation(config.env, 40)))
    model.set_logger(Logger(folder=None, output_formats=[]))
    before = {key: value.clone() for key, value in model.policy.state_dict().items()}
    model.learn(400)
    moved = {
        key: float((value - before[key]).abs().max())
        for key, value in model.policy.state_dict().items()
    }
    # Adam's first steps are near the rate itself; there are 2 minibatches in 3 epochs.
    critic = {key for key in moved if "critic" in key or key.startswith("value_net")}
    assert 3e-3 < max(moved[key] for key in moved.keys() - critic) < 6.5e-3
    assert 15e-3 < max(moved[key] for key in critic) < 32e-3
