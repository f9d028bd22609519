"""Touch: the vibrations of the controllers in the user's hands."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.perception.sense import IntArray, Sensed, StepContext, float_space

_HANDS = ("left", "right")
_ROUNDING_S = 1e-6


class Haptics(Sensed):
    """How strongly the left and the right controller vibrated since the user last felt for it.

    Each number is the largest amplitude, 0 to 1, of the vibrations that went on in that time. As in
    OpenXR a new vibration of a hand ends the one before, amplitude 0 ends it too, and one without a
    duration is as short as can be: it is felt once. Vibrations begin when the app's reply comes,
    at the end of the user step in whose frames it requested them.

    Args:
        name: key in the observation.
        n: number of users N.
    """

    _state = (*Sensed._state, "_amplitude", "_end_s", "_felt_s")

    def __init__(self, name: str, n: int) -> None:
        super().__init__(name, float_space(0.0, 1.0, 2), n, self._felt, needs="haptics")
        self._amplitude = np.zeros((n, 2))
        self._end_s = np.full((n, 2), -np.inf)
        self._felt_s = np.full(n, -np.inf)  # when it was last looked for

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        self._amplitude[ids] = 0.0
        self._end_s[ids] = self._felt_s[ids] = -np.inf

    def _felt(self, moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        rows = np.arange(self.n) if ids is None else ids
        going_on = self._end_s[rows] > self._felt_s[rows, None] + _ROUNDING_S
        strongest = np.where(going_on, self._amplitude[rows], 0.0)
        for k, i in enumerate(rows.tolist()):
            if i not in moment.haptics or moment.replied_s[i] <= self._felt_s[i] - _ROUNDING_S:
                continue
            for pulse in moment.haptics[i]:
                hand = _HANDS.index(pulse.hand)
                strongest[k, hand] = max(strongest[k, hand], min(pulse.amplitude, 1.0))
                self._amplitude[i, hand] = min(pulse.amplitude, 1.0)
                self._end_s[i, hand] = moment.replied_s[i] + max(pulse.duration_s, 0.0)
        self._felt_s[rows] = moment.users.time[rows]
        return strongest
