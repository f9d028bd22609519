"""B imagined users: bodies of a learned model, moved by changes of activation."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from sim2vr_harness.training.imagined.body import BodyModel
from sim2vr_harness.training.imagined.experience import Motion
from sim2vr_harness.training.imagined.noise import ImaginedNoise
from sim2vr_harness.users import Body
from sim2vr_harness.users.noise import MotorNoiseSettings

__all__ = ["ImaginedUsers"]

_BROKEN_RADPS, _WILD_RADPS = 40.0, 15.0
_BEYOND_COST, _WILD_COST = 0.5, 0.02


class ImaginedUsers:
    """Users whose next motion is what a body model says; differentiable by their actions.

    Args:
        user: the body.
        body: its model.
        n: number of users B.
        noise: of the muscles' controls; None for none.
    """

    def __init__(
        self, user: Body, body: BodyModel, n: int, *, noise: MotorNoiseSettings | None = None
    ) -> None:
        self.n, self.body = n, body
        joints, muscles = len(user.independent_joints), len(user.muscles)
        self.names: tuple[str, ...] = (
            *(f"{joint} qpos" for joint in user.independent_joints),
            *(f"{joint} qvel" for joint in user.independent_joints),
            *(f"{muscle} act" for muscle in user.muscles),
        )
        """What :meth:`observe` gives, by the names of the proprioception."""
        self._low, self._high = torch.tensor(user.joint_ranges.T.copy(), dtype=torch.float32)
        self.motion = Motion(
            torch.zeros(n, joints), torch.zeros(n, joints), torch.zeros(n, muscles)
        )
        self._noise = None if noise is None else ImaginedNoise(noise, n, muscles)
        self._placed: tuple[Motion, Tensor] | None = None

    @property
    def place(self) -> Tensor:
        """(B, 4, 4) where the devices are now, MuJoCo's world frame; one tensor per motion."""
        if self._placed is None or self._placed[0] is not self.motion:
            self._placed = (self.motion, self.body.chain(self.motion.angles))
        return self._placed[1]

    def start(self, ids: Tensor, motion: Motion) -> None:
        """Let users ``ids`` (K,) go on from ``motion``, of K users."""
        self._placed = None
        with torch.no_grad():
            for name in ("angles", "speeds", "act"):
                getattr(self.motion, name)[ids] = getattr(motion, name)
            if self._noise is not None:
                self._noise.forget(ids)

    def cut(self) -> None:
        """Forget what led to the present: gradients end here."""
        self.motion = self.motion.detach()

    def step(self, actions: Tensor, *, error_share: float) -> None:
        """Advance everyone by one user step.

        Args:
            actions: (B, M) changes of activation.
            error_share: noise on the motion, in units of the body model's error.
        """
        control = (self.motion.act + actions.clamp(-1.0, 1.0)).clamp(0.0, 1.0)
        if self._noise is not None:
            control = self._noise.apply(control)
        after = self.body(self.motion, control)
        self.motion = self.body.disturbed(after, error_share) if error_share > 0.0 else after

    def costs(self, effort: float) -> tuple[Tensor, Tensor, Tensor]:
        """(B,) each: of effort, of joints beyond their limits, and of wild speeds.

        Args:
            effort: of the mean square of activations.
        """
        motion = self.motion
        unit = 2.0 * (motion.angles - self._low) / (self._high - self._low) - 1.0
        beyond = torch.relu(unit.abs() - 1.0).sum(1)
        wild = torch.relu(motion.speeds.abs() - _WILD_RADPS).sum(1)
        return effort * motion.act.square().mean(1), _BEYOND_COST * beyond, _WILD_COST * wild

    def broken(self) -> Tensor:
        """(B,) whether a user's body has left what a body can do."""
        motion = self.motion
        wild = motion.speeds.detach().abs().amax(1) > _BROKEN_RADPS
        return wild | ~torch.isfinite(motion.angles.detach()).all(1)

    def observe(self) -> Tensor:
        """(B, F) in the order of :attr:`names`, differentiable by the motion."""
        motion = self.motion
        parts = [
            2.0 * (motion.angles - self._low) / (self._high - self._low) - 1.0,
            motion.speeds,
            2.0 * motion.act - 1.0,
        ]
        return torch.cat(parts, 1)

    def state(self) -> dict[str, Tensor]:
        """Everything that their future depends on, but for the body model."""
        own = {} if self._noise is None else self._noise.state()
        return own | {
            "angles": self.motion.angles.clone(),
            "speeds": self.motion.speeds.clone(),
            "act": self.motion.act.clone(),
        }

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on from :meth:`state`."""
        self._placed = None
        self.motion = Motion(*(state[name].clone() for name in ("angles", "speeds", "act")))
        if self._noise is not None:
            self._noise.load_state(state)
