"""Motor noise on muscle controls, off unless requested.

Levels and forms follow the SIM2VR paper's User-in-the-Box reference: signal-dependent noise whose
standard deviation is 0.103 times the control, and constant noise of 0.185 that all muscles share.
"White" noise is drawn afresh each step, "red" noise adds up over the episode.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.state import RowState

FloatArray = NDArray[np.float64]
Colour = Literal["white", "red"]


@dataclass(frozen=True)
class MotorNoiseSettings:
    """Settings of the noise that is added to the muscle controls.

    Attributes:
        signal_dependent: colour of the noise that grows with the control, None for none.
        constant: colour of the noise that is the same for all muscles, None for none.
        signal_dependent_level: standard deviation per unit of control.
        constant_level: standard deviation, in units of control.

    Raises:
        ValueError: unknown colour or negative level.
    """

    signal_dependent: Colour | None = "white"
    constant: Colour | None = "white"
    signal_dependent_level: float = 0.103
    constant_level: float = 0.185

    def __post_init__(self) -> None:
        for field in ("signal_dependent", "constant"):
            colour = getattr(self, field)
            if colour is not None and colour not in get_args(Colour):
                raise ValueError(f"{field}: got {colour!r}, expected 'white', 'red' or None")
        for field in ("signal_dependent_level", "constant_level"):
            level = getattr(self, field)
            if not (np.isfinite(level) and level >= 0):
                raise ValueError(f"{field}: got {level}, expected a finite number, at least 0")


class MotorNoise(RowState):
    """Noise for N users, each with a random stream of its own.

    A user's noise therefore depends on its own seed only, not on who else is simulated.

    Args:
        settings: which noise.
        n: number of users.
        muscle_count: number of muscles M.
    """

    _state = ("_rngs", "_signal_red", "_constant_red")

    def __init__(self, settings: MotorNoiseSettings, n: int, muscle_count: int) -> None:
        self.settings = settings
        self._rngs = [np.random.default_rng(i) for i in range(n)]
        self._signal_red = np.zeros((n, muscle_count))
        self._constant_red = np.zeros(n)

    def reset(self, ids: Sequence[int] | NDArray[np.integer], seeds: Sequence[int]) -> None:
        """Starts new random streams and forgets accumulated red noise, for these users."""
        for i, seed in zip(ids, seeds, strict=True):
            self._rngs[int(i)] = np.random.default_rng(seed)
            self._signal_red[i] = 0.0
            self._constant_red[i] = 0.0

    def apply(
        self,
        ctrl: FloatArray,
        ids: Sequence[int] | NDArray[np.integer],
        factors: FloatArray | None = None,
    ) -> FloatArray:
        """Returns noisy controls.

        Args:
            ctrl: (K, M) controls in [0, 1] of the users `ids`; left unchanged.
            ids: the K users.
            factors: (K,) on both standard deviations; None: 1.

        Returns:
            (K, M) controls clipped to [0, 1].
        """
        settings, noisy = self.settings, np.array(ctrl, dtype=np.float64)
        factors = np.ones(len(ids)) if factors is None else factors
        for row, i in enumerate(ids):
            rng = self._rngs[int(i)]
            if settings.signal_dependent is not None:
                level = factors[row] * settings.signal_dependent_level
                drawn = level * rng.normal(scale=ctrl[row])
                if settings.signal_dependent == "red":
                    self._signal_red[i] += drawn
                    drawn = self._signal_red[i]
                noisy[row] += drawn
            if settings.constant is not None:
                shared = factors[row] * settings.constant_level * rng.standard_normal()
                if settings.constant == "red":
                    self._constant_red[i] += shared
                    shared = self._constant_red[i]
                noisy[row] += shared
        return np.clip(noisy, 0.0, 1.0)
