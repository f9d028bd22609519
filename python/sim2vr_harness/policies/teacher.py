"""The teacher's network, on normalised numbers."""

import math
from pathlib import Path

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.runs.checkpoint import take_in

_WIDTH = 256
"""Width of both hidden layers; privileged observations have few dimensions."""
_ACTION_SCALE = 0.5
"""Factor on the outputs: actions begin well within their range."""
_OBSERVATION_CLIP = 8.0
"""Largest normalised observation, in standard deviations."""


class _Normaliser(nn.Module):
    """Observations by the mean and variance that imagined rollouts have set, clipped."""

    mean: Tensor
    variance: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(size, dtype=torch.float64))

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        scale = torch.rsqrt(self.variance + 1e-6)
        centred = (observations[OBSERVATION] - self.mean.float()) * scale.float()
        return torch.clamp(centred, -_OBSERVATION_CLIP, _OBSERVATION_CLIP)


class TeacherPolicy(nn.Module):
    """Two layers with SiLU on the normalised observation.

    The action is not squashed; what acts is clipped to [-1, 1], as the student's actions are.
    """

    def __init__(self, size: int, actions: int) -> None:
        super().__init__()
        self.normaliser = _Normaliser(size)
        first, second = nn.Linear(size, _WIDTH), nn.Linear(_WIDTH, _WIDTH)
        self.hidden = nn.Sequential(first, nn.SiLU(), second, nn.SiLU())
        self.action_net = nn.Linear(_WIDTH, actions)
        gains = ((first, math.sqrt(2.0)), (second, math.sqrt(2.0)), (self.action_net, 0.01))
        # The last bits of orthogonal weights depend on the number of threads.
        with torch_threads(1):
            for layer, gain in gains:
                nn.init.orthogonal_(layer.weight, gain)
                nn.init.zeros_(layer.bias)

    def action_mean(self, observations: dict[str, Tensor]) -> Tensor:
        """The actions, (B, A), not clipped."""
        return _ACTION_SCALE * self.action_net(self.hidden(self.normaliser(observations)))

    def act(self, observations: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        """Actions of all users, (N, A) in [-1, 1]; observations: key -> (N, ...)."""
        device = self.action_net.weight.device
        with torch.no_grad():
            tensors = {
                key: torch.as_tensor(value, device=device) for key, value in observations.items()
            }
            return self.action_mean(tensors).clamp(-1.0, 1.0).cpu().numpy()


def new_teacher(
    observation_space: spaces.Dict, action_space: spaces.Box, *, seed: int
) -> TeacherPolicy:
    """Return a teacher that has learned nothing, with weights drawn from ``seed``."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        size = spaces.flatdim(observation_space[OBSERVATION])
        return TeacherPolicy(size, action_space.shape[0])


def load_teacher(
    file: Path, observation_space: spaces.Dict, action_space: spaces.Box
) -> TeacherPolicy:
    """Return the teacher that imagined rollouts have left, ready to act.

    Raises:
        UnusableFile: the file is none, is damaged or its network has other shapes.
    """
    policy = new_teacher(observation_space, action_space, seed=0)
    take_in(file, "the weights of imagined rollouts", policy.load_state_dict)
    return policy
