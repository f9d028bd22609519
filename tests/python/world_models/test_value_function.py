"""The critic behind imagined windows, against values worked out by hand."""

import torch

from sim2vr_harness.world_models.value_function import ValueFunction


def test_both_critics_learn_the_values_of_a_world_that_stands_still() -> None:
    """Statistics that come after the critic is made count for the slow one as well.

    In a world in which nothing moves and a step is worth r, a state is worth r / (1 - gamma).
    """
    torch.manual_seed(3)
    mean, std = torch.zeros(2), torch.ones(2)
    critic = ValueFunction(
        2,
        32,
        lambda observation: (observation - mean) / std,
        learning_rate=3e-3,
        gamma=0.8,
        lam=0.9,
    )
    mean.copy_(torch.tensor([500.0, -3.0]))
    std.copy_(torch.tensor([20.0, 0.01]))

    def states(count: int) -> torch.Tensor:
        return mean + std * torch.randn(count, 2)

    def reward(state: torch.Tensor) -> torch.Tensor:
        return 1.0 + 0.05 * (state[..., 0] - 500.0)  # 0 to 2, mostly

    for _ in range(400):
        here = states(64)
        critic.learn(here.expand(9, 64, 2), reward(here).expand(8, 64))
    seen = states(256)
    error = (critic(seen) - reward(seen) / (1.0 - 0.8)).abs()
    assert float(error.median()) < 0.15  # of 5 on average


def test_lambda_says_how_far_a_reward_reaches_back() -> None:
    """Of eight states before a reward: with lambda 1 the first learns as the last, with 0 later."""
    seen = torch.cat([torch.eye(8), torch.zeros(1, 8)])[:, None]
    rewards = torch.zeros(8, 1)
    rewards[-1] = 5.0
    shares = []
    for lam in (1.0, 0.0):
        torch.manual_seed(3)
        critic = ValueFunction(8, 32, lambda state: state, learning_rate=3e-3, gamma=1.0, lam=lam)
        for _ in range(30):
            critic.learn(seen, rewards)
        first, last = critic(seen[[0, 7], 0]).tolist()
        shares.append(first / last)
    assert shares[0] > 0.8 and shares[1] < 0.4, shares
