"""System lag: the app receives the controllers' poses late; the head's are in time.

Every app has the option ``hand_lag_s``, in this process or outside it: the harness applies it, the
app does not know of it. What the hand holds is drawn, and touches, where the hand was.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.base.state import RowState
from sim2vr_harness.client import DevicePoses, OptionValue
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.perception import StepContext
from sim2vr_harness.perception.wrappers import Ring

HAND_LAG = "hand_lag_s"
_LONGEST_S = 2.0
IntArray = NDArray[np.int64]


def hand_lag_s(options: Mapping[str, OptionValue]) -> float:
    """Return by how much the app sees hands late, s.

    Raises:
        ValueError: it is no number from 0 to 2.
    """
    given = options.get(HAND_LAG, 0.0)
    if isinstance(given, bool | str | list) or not 0.0 <= given <= _LONGEST_S:
        raise ValueError(f"{HAND_LAG}: got {given!r}, expected 0 to {_LONGEST_S:g} s")
    return float(given)


def app_options(options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
    """Return the options that the app itself receives."""
    return {name: value for name, value in options.items() if name != HAND_LAG}


class LateHands(RowState):
    """Delays the controllers' poses of N users; a ``Sense``, so that saved states hold them."""

    _state = ("_ring",)

    name, pauses, frame = "hands as the app gets them", (), -1
    needs: str | None = None

    def __init__(self, config: EnvConfig, n: int) -> None:
        rate_hz = config.action_frequency_hz * config.frames_per_step
        self.frames = round(hand_lag_s(config.app.options) * rate_hz)
        self.space: spaces.Box[Any] = spaces.Box(-np.inf, np.inf, (2, 7), np.float64)
        self._ring = Ring(self.name, n, self.space, self.frames)

    def late(self, poses: DevicePoses, ids: IntArray) -> DevicePoses:
        """Return poses (K, F, 7) of a user step with the controllers of some frames before."""
        right, left = poses.right_controller, poses.left_controller
        if not self.frames or (right is None and left is None):
            return poses
        both = [np.zeros_like(poses.head) if part is None else part for part in (right, left)]
        now, late = np.stack(both, 2), np.empty((*poses.head.shape[:2], 2, 7))
        for frame in range(now.shape[1]):
            self._ring.push(now[:, frame], ids)
            late[:, frame] = self._ring.ago(self.frames)[ids]
        return replace(
            poses,
            right_controller=None if right is None else late[:, :, 0].astype(right.dtype),
            left_controller=None if left is None else late[:, :, 1].astype(left.dtype),
        )

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """Fill these users' past with their next poses."""
        self._ring.forget(ids)

    def sample(self, moment: StepContext, substep: int) -> None:
        """Do nothing: poses are recorded per user step."""

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        """Do nothing: poses are recorded per user step."""

    def observe(self) -> NDArray[np.float64]:
        """(N, 2, 7) the present poses."""
        newest: NDArray[np.float64] = self._ring.newest()
        return newest
