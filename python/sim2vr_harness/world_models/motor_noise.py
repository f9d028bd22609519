"""Motor noise of imagined users."""

import torch
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.users.noise import MotorNoiseSettings


class ImaginedNoise(State):
    """What :class:`~sim2vr_harness.users.noise.MotorNoise` does, differentiable by the controls.

    Draws from torch's global generator. Red noise starts from nothing where a user goes on from a
    state of the true game.

    Args:
        settings: which noise.
        n: number of users B.
        muscles: number of muscles M.
    """

    _state = ("_signal_red", "_constant_red")

    def __init__(self, settings: MotorNoiseSettings, n: int, muscles: int) -> None:
        self._settings = settings
        self._signal_red, self._constant_red = torch.zeros(n, muscles), torch.zeros(n, 1)

    def apply(self, control: Tensor, factor: Tensor | float = 1.0) -> Tensor:
        """(B, M) noisy controls, in [0, 1] as ``control`` is.

        Args:
            control: (B, M).
            factor: (B, 1) on the noise of each user.
        """
        settings, noisy = self._settings, control
        if settings.signal_dependent is not None:
            drawn = settings.signal_dependent_level * factor * control * torch.randn_like(control)
            if settings.signal_dependent == "red":
                drawn = self._signal_red + drawn
                self._signal_red = drawn.detach()
            noisy = noisy + drawn
        if settings.constant is not None:
            shared = settings.constant_level * factor * torch.randn(len(control), 1)
            if settings.constant == "red":
                shared = self._constant_red + shared
                self._constant_red = shared
            noisy = noisy + shared
        return noisy.clamp(0.0, 1.0)

    def forget(self, ids: Tensor) -> None:
        """Let accumulated noise of some users start anew."""
        self._signal_red[ids], self._constant_red[ids] = 0.0, 0.0
