"""Policy in space: the next velocity of a hand, and whether its movement is over.

The policy sees a goal relative to the hand, and answers with a velocity. It does not depend on
where the goal is or in which direction: its inputs are lengths and angles, its output is a
combination of the way to the goal, the hand's velocity and the velocity wanted.
"""

import torch
from torch import Tensor, nn

from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.world_models.body_dynamics import mlp

_WIDTH_M, _LEAST_M, _NEAR_M = 0.04, 0.002, 0.02
_INPUTS = 13
_MOST_MPS = 2.0
"""Largest change of velocity in a user step."""
_LOGIT, _FIRST_LOGIT = 3.0, -0.8
"""Of the decision that a movement is over: factor on the network's output, and its first bias."""


class HandPolicy(nn.Module):
    """A feedback policy of hands in space, for all bodies and persons.

    Args:
        width: of the two hidden layers.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.net = mlp(_INPUTS, width, width, 4)
        last = self.net[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(0.1)
            last.bias.copy_(torch.tensor([0.1, -0.3, 0.0, _FIRST_LOGIT]))

    def forward(
        self, way: Tensor, velocity: Tensor, goals: HumanGoals, noise: Tensor, effort: Tensor
    ) -> tuple[Tensor, Tensor]:
        """(B, H, 3) velocities wanted at the end of a user step, and (B, H) logits of its end.

        Args:
            way: (B, H, 3) from the hands to their goals as believed, m.
            velocity: (B, H, 3) of the hands as believed, m/s.
            goals: for widths, velocities and whether to stop.
            noise: (B, 1) the persons' factors on motor noise.
            effort: (B, 1) their factors on the cost of effort.
        """
        far = way.square().sum(-1).add(1e-8).sqrt()
        ahead = way / (far[..., None] + _NEAR_M)
        wanted = goals.velocity
        speed, through = (x.square().sum(-1).add(1e-6).sqrt() for x in (velocity, wanted))
        passes = (through > 2e-3).float()
        inputs = [
            far / 0.3,
            (far + 0.01).log() + 2.0,
            ((far + _LEAST_M) / (0.5 * goals.width + _LEAST_M)).log(),
            (goals.width / _WIDTH_M).log(),
            speed,
            (velocity * ahead).sum(-1),
            through,
            (wanted * ahead).sum(-1),
            (wanted * velocity).sum(-1),
            goals.stops,
            passes,
            noise.log().expand_as(far) * 4.0,
            effort.log().expand_as(far),
        ]
        out = self.net(torch.stack(inputs, -1))
        onwards, keeps, takes, over = out.unbind(-1)
        change = (
            onwards[..., None] * ahead + keeps[..., None] * velocity + takes[..., None] * wanted
        )
        size = change.square().sum(-1, keepdim=True)
        return velocity + change / (1.0 + size / _MOST_MPS**2).sqrt(), _LOGIT * over
