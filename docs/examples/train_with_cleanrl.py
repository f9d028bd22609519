"""A simulated user learns by PPO in one file, in the manner of CleanRL: torch and Gymnasium only.

    python docs/examples/train_with_cleanrl.py --steps 20000

Everything that decides is on this page, to be changed at will. Users of a vector environment are
stepped together on all cores; `SAME_STEP` starts the next round in the step that ends one.
"""

from __future__ import annotations

import argparse

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn
from torch.distributions import Normal

import sim2vr_harness  # noqa: F401 - registers the environments

GAMMA, LAMBDA, CLIP, EPOCHS, MINIBATCHES, RATE = 0.99, 0.95, 0.2, 4, 8, 3e-4
Batch = dict[str, Tensor]


class Agent(nn.Module):
    """Pictures by two convolutions, everything else as it is; a Gaussian and a value."""

    def __init__(self, envs: gymnasium.vector.VectorEnv) -> None:
        super().__init__()
        space, actions = envs.single_observation_space, envs.single_action_space.shape[0]
        channels = space["vision"].shape[0]
        self.eye = nn.Sequential(
            *(nn.Conv2d(channels, 8, 4, 4), nn.ReLU(), nn.Conv2d(8, 16, 4, 4), nn.ReLU()),
            nn.Flatten(),
        )
        with torch.no_grad():
            seen = self.eye(torch.zeros(1, *space["vision"].shape)).shape[1]
        others = sum(int(np.prod(box.shape)) for key, box in space.items() if key != "vision")
        self.body = nn.Sequential(nn.Linear(seen + others, 256), nn.Tanh())
        self.mean, self.value = nn.Linear(256, actions), nn.Linear(256, 1)
        self.log_std = nn.Parameter(torch.full((actions,), -1.0))

    def forward(self, batch: Batch) -> tuple[Normal, Tensor]:
        """The distribution of the actions, and values (B,)."""
        rest = [value.flatten(1).float() for key, value in sorted(batch.items()) if key != "vision"]
        latent = self.body(torch.cat([self.eye(batch["vision"] / 255.0), *rest], 1))
        return Normal(self.mean(latent), self.log_std.exp()), self.value(latent)[:, 0]


def tensors(observation: dict[str, np.ndarray]) -> Batch:
    """The same memory for torch; key -> (N, ...)."""
    return {key: torch.from_numpy(value) for key, value in observation.items()}


def main() -> None:
    """Train, and print the mean return of the last rounds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000, help="user steps, of all users")
    parser.add_argument("--users", type=int, default=8)
    parser.add_argument("--n-steps", type=int, default=256, help="per user and iteration")
    arguments = parser.parse_args()
    n, length = arguments.users, arguments.n_steps

    torch.manual_seed(1)
    envs = gymnasium.make_vec(
        "sim2vr/WhacAMole-v0", num_envs=n, autoreset_mode=AutoresetMode.SAME_STEP
    )
    agent = Agent(envs)
    optimizer = torch.optim.Adam(agent.parameters(), lr=RATE, eps=1e-5)
    observation, _ = envs.reset(seed=1)
    returns, sums = [], np.zeros(n)
    for iteration in range(-(-arguments.steps // (n * length))):
        seen, acts, probs, values, rewards, ends = [], [], [], [], [], []
        for _ in range(length):
            batch = tensors(observation)
            with torch.no_grad():
                distribution, value = agent(batch)
                action = distribution.sample()
            observation, reward, over, cut, _ = envs.step(action.clamp(-1.0, 1.0).numpy())
            done = over | cut
            seen.append(batch)
            acts.append(action)
            probs.append(distribution.log_prob(action).sum(1))
            values.append(value)
            rewards.append(torch.as_tensor(reward, dtype=torch.float32))
            ends.append(torch.as_tensor(done, dtype=torch.float32))
            sums += reward
            returns += sums[done].tolist()
            sums[done] = 0.0

        # Generalised advantage estimation, backwards in time.
        with torch.no_grad():
            following = agent(tensors(observation))[1]
        advantages, advantage = [torch.zeros(n)] * length, torch.zeros(n)
        for t in reversed(range(length)):
            goes_on = 1.0 - ends[t]
            error = rewards[t] + GAMMA * goes_on * following - values[t]
            advantage = error + GAMMA * LAMBDA * goes_on * advantage
            advantages[t], following = advantage, values[t]

        flat = {key: torch.cat([batch[key] for batch in seen]) for key in seen[0]}
        act, old, gain = torch.cat(acts), torch.cat(probs), torch.cat(advantages)
        target = gain + torch.cat(values)
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(act)).chunk(MINIBATCHES):
                distribution, value = agent({key: part[rows] for key, part in flat.items()})
                ratio = (distribution.log_prob(act[rows]).sum(1) - old[rows]).exp()
                scaled = (gain[rows] - gain[rows].mean()) / (gain[rows].std() + 1e-8)
                clipped = ratio.clamp(1.0 - CLIP, 1.0 + CLIP)
                policy_loss = -torch.min(ratio * scaled, clipped * scaled).mean()
                loss = policy_loss + 0.5 * (value - target[rows]).square().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        mean = f"{np.mean(returns[-20:]):.1f}" if returns else "no round has ended yet"
        print(f"step {(iteration + 1) * n * length:,}: loss {loss.item():.3f}, return {mean}")
    envs.close()


if __name__ == "__main__":
    main()
