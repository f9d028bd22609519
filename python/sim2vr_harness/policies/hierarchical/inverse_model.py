"""Muscle commands for wanted velocities of the hands: the inverse of a learned forward model.

The forward model predicts a user step and its derivative by the commands. Of the commands that
bring points of the hands to their velocities, the cheapest are taken by regularised least squares
(paired forward and inverse models: Wolpert and Kawato 1998, Neural Networks 11).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.motor_goals import tips
from sim2vr_harness.world_models.body_dynamics import BodyModel
from sim2vr_harness.world_models.transitions import Motion

_MOMENT_RAD = 1e-3
_PASSES = 3


@dataclass(frozen=True)
class InverseSettings:
    """What commands are chosen by: sizes and weights of squared costs.

    Attributes:
        velocity_mps: error of a wanted velocity that costs 1.
        speed_radps: joint speed away from the way back that costs 1.
        return_hz: how fast joints go back to the middle of their ranges where nothing else counts.
        limit: how many times as much that counts at the ends of their ranges as in the middle.
        effort: cost of the sum of squared controls, weighted by muscle volume.
        change: cost of the sum of squared changes of activation.
    """

    velocity_mps: float = 0.01
    speed_radps: float = 1.0
    return_hz: float = 1.5
    limit: float = 3.0
    effort: float = 0.2
    change: float = 0.1


class InverseModel:
    """Finds controls of a body for velocities of its hands.

    Args:
        model: the forward model of the body, of its hands.
        low: (J,) least joint angles, rad; in the middle of their ranges joints are comfortable.
        high: (J,) greatest joint angles, rad.
        shares: (A,) relative volume of the muscles.
        settings: costs.
    """

    def __init__(
        self,
        model: BodyModel,
        low: Tensor,
        high: Tensor,
        shares: Tensor,
        settings: InverseSettings,
    ) -> None:
        self._model, self._shares, self._settings = model, shares, settings
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)

    def velocities(self, motion: Motion, tip: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H, 3) each: where points (B, H, 3) of the devices are, and how they move."""
        place, jacobian = self.jacobian(motion, tip)
        return place, (jacobian @ motion.speeds[:, None, :, None])[..., 0]

    def jacobian(self, motion: Motion, tip: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H, 3) where points are, and (B, H, 3, J) how they move with the joints."""
        count, joints = motion.angles.shape
        each = joints + 1
        away = torch.cat([torch.zeros(1, joints), _MOMENT_RAD * torch.eye(joints)])
        angles = (motion.angles[:, None] + away).flatten(0, 1)
        persons = motion.persons.repeat_interleave(each, 0)
        with torch.no_grad():
            placed = self._model.places(angles, persons)
            every = tips(placed, tip.repeat_interleave(each, 0)).reshape(count, each, -1, 3)
        moved = (every[:, 1:] - every[:, :1]) / _MOMENT_RAD
        return every[:, 0], moved.permute(0, 2, 3, 1)

    def controls(
        self,
        now: Motion,
        tip: Tensor,
        velocity: Tensor,
        active: Tensor,
        bias: Tensor,
        seen: Tensor | None = None,
    ) -> Tensor:
        """(B, A) controls, shares of their ranges, of the user step that begins.

        Args:
            now: the present.
            tip: (B, H, 3) points of the devices.
            velocity: (B, H, 3) wanted at the end of the user step, m/s.
            active: (B, H) 1 for hands that move, 0 for those that rest.
            bias: (B, J) what the forward model has got wrong of joint speeds lately, rad/s.
            seen: (B, H, 3, 3) what of the points' velocities is wanted; None: all of it.
        """
        start, costs = now.drives.detach(), self._settings
        after, by_control = self._after(now, start)
        then = Motion(after.angles, after.speeds + bias, start, now.persons)
        _, jacobian = self.jacobian(then, tip)
        jacobian = jacobian if seen is None else seen @ jacobian
        weight = (active / costs.velocity_mps)[..., None]
        reached = (jacobian @ then.speeds[:, None, :, None])[..., 0]
        back = costs.return_hz * (self._middle - now.angles)
        away = ((now.angles - self._middle) / self._half).clamp(-1.2, 1.2)
        counts = (1.0 + (costs.limit - 1.0) * away**6) / costs.speed_radps
        wrong = torch.cat(
            [((velocity - reached) * weight).flatten(1), (back - then.speeds) * counts],
            1,
        )
        moved = (jacobian * weight[..., None]).flatten(1, 2) @ by_control
        rows = torch.cat([moved, by_control * counts[..., None]], 1)
        effort = costs.effort * self._shares
        square = rows.transpose(1, 2) @ rows + torch.diag(effort + costs.change)
        pull = (rows.transpose(1, 2) @ wrong[..., None])[..., 0] - effort * start
        return _within_range(square, pull, start)

    def _after(self, now: Motion, start: Tensor) -> tuple[Motion, Tensor]:
        """Motion after a user step with controls (B, A), and (B, J, A) its speeds by the controls.

        A row of a larger batch for each joint: one way back through the network for all of them.
        """
        count, joints = now.angles.shape
        rows = torch.arange(count).repeat_interleave(joints)
        each = start[rows].requires_grad_(True)
        with torch.enable_grad():
            after = self._model(now.rows(rows), each)
            speeds = after.speeds.reshape(count, joints, joints)
            own = speeds.diagonal(dim1=1, dim2=2).sum()
            by_control = torch.autograd.grad(own, each)[0]
        first = after.detach().rows(torch.arange(0, count * joints, joints))
        return first, by_control.reshape(count, joints, -1)


def _within_range(square: Tensor, pull: Tensor, start: Tensor) -> Tensor:
    """(B, A) least squares between 0 and 1: those beyond are held there, the others solved anew."""
    held = torch.zeros_like(start, dtype=torch.bool)
    change = limit = torch.zeros_like(start)
    for _ in range(_PASSES):
        free = (~held).float()
        known = (pull - (square @ limit[..., None])[..., 0]) * free
        part = square * free[:, None] * free[:, :, None] + torch.diag_embed(1.0 - free)
        change = torch.linalg.solve(part, known[..., None])[..., 0] + limit
        wanted = start + change
        beyond = ((wanted < 0.0) | (wanted > 1.0)) & ~held
        if not beyond.any():  # another pass would find the same
            break
        limit = torch.where(beyond, wanted.clamp(0.0, 1.0) - start, limit)
        held = held | beyond
    return (start + change).clamp(0.0, 1.0)
