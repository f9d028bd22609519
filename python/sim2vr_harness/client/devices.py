"""Devices between user and app: what controllers tell the app, and what the app does to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
Hand = Literal["left", "right"]
HANDS: tuple[Hand, Hand] = ("left", "right")


@dataclass(frozen=True)
class Input:
    """An analogue or digital input of one controller (Oculus Touch, OpenXR's names).

    Attributes:
        hand: whose controller it is on.
        name: as in ``right.trigger``, without the hand.
        column: its place in a row of inputs.
        low: least value; 0, thumbstick axes -1.
        digital: whether it is 0 or 1; otherwise anything from ``low`` to 1.
    """

    hand: Hand
    name: str
    column: int
    low: float
    digital: bool


_ANALOGUE = 4
_COLUMNS: tuple[tuple[str, str], ...] = (
    ("trigger", "trigger"),
    ("squeeze", "squeeze"),
    ("thumbstick_x", "thumbstick_x"),
    ("thumbstick_y", "thumbstick_y"),
    ("thumbstick_click", "thumbstick_click"),
    ("x", "a"),
    ("y", "b"),
    ("menu", ""),
    ("trigger_touch", "trigger_touch"),
    ("thumbstick_touch", "thumbstick_touch"),
    ("x_touch", "a_touch"),
    ("y_touch", "b_touch"),
    ("thumbrest_touch", "thumbrest_touch"),
)
"""Name of each column on the left and on the right controller, as ``xr::kInputColumns``."""

INPUT_COUNT = len(_COLUMNS)
"""Numbers in a row of inputs."""

INPUTS: tuple[Input, ...] = tuple(
    Input(hand, names[h], k, -1.0 if k in (2, 3) else 0.0, k >= _ANALOGUE)
    for h, hand in enumerate(HANDS)
    for k, names in enumerate(_COLUMNS)
    if names[h]
)
"""Every input of both controllers, left first."""

INPUT_NAMES: tuple[str, ...] = tuple(f"{one.hand}.{one.name}" for one in INPUTS)
"""Names of :data:`INPUTS` as people write them, such as ``right.trigger`` and ``left.x``."""


def input_named(name: str) -> Input:
    """Return the input that people call ``name``; KeyError when there is none."""
    try:
        return INPUTS[INPUT_NAMES.index(name)]
    except ValueError:
        raise KeyError(name) from None


@dataclass(frozen=True)
class DevicePoses:
    """Poses of the devices, and inputs of the controllers.

    A pose is position x y z (m) and rotation x y z w, app frame; a row of inputs has
    :data:`INPUT_COUNT` numbers in the columns of :data:`INPUTS`. Arrays have one row for one
    moment, (K, ...) for K frames and (M, K, ...) for K frames of M apps.

    Attributes:
        head: (..., 7) float64.
        right_controller: (..., 7) float64; None: not tracked.
        left_controller: (..., 7) float64; None: not tracked.
        right_inputs: (..., INPUT_COUNT) float64; None: at rest. Inputs of a controller that is
            not tracked are ignored.
        left_inputs: as ``right_inputs``.
    """

    head: Float64Array
    right_controller: Float64Array | None = None
    left_controller: Float64Array | None = None
    right_inputs: Float64Array | None = None
    left_inputs: Float64Array | None = None

    def map(self, change: Callable[[Float64Array], Float64Array]) -> DevicePoses:
        """Return the same devices with ``change`` applied to every array that is there."""
        arrays: dict[str, Any] = {
            name: None if array is None else change(array) for name, array in vars(self).items()
        }
        return DevicePoses(**arrays)

    def __getitem__(self, index: int | slice | NDArray[Any]) -> DevicePoses:
        """Return what the first axis of every array has there, such as one app's poses."""
        return self.map(lambda rows: rows[index])

    @classmethod
    def stack(cls, poses: Sequence[DevicePoses], axis: int = 0) -> DevicePoses:
        """Return poses of the same devices along a new axis, such as those of M apps."""
        arrays: dict[str, Any] = {
            name: None if array is None else np.stack([getattr(one, name) for one in poses], axis)
            for name, array in vars(poses[0]).items()
        }
        return cls(**arrays)


@dataclass(frozen=True)
class HapticPulse:
    """A vibration that the app asked a controller for.

    Attributes:
        hand: whose controller.
        amplitude: 0 to 1; 0 stops the vibration.
        frequency_hz: 0: the device's own choice.
        duration_s: -1e-9 (OpenXR's ``XR_MIN_HAPTIC_DURATION``): the shortest the device can.
    """

    hand: Hand
    amplitude: float
    frequency_hz: float
    duration_s: float


@dataclass(frozen=True)
class SoundEvent:
    """A sound that the app began to play.

    Attributes:
        name: of the sound, the app's own.
        position_m: x y z of its source, app frame (left-handed, y up, z forward).
        gain: 0 to 1.
    """

    name: str
    position_m: tuple[float, float, float]
    gain: float
