"""Events of the app that are felt and heard: vibrations of controllers, loudness at the ears."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.base.rotations import turned
from sim2vr_harness.perception.sense import IntArray, Sensed, Sound, StepContext, float_space

FloatArray = NDArray[np.float64]

_HANDS = ("left", "right")
_ROUNDING_S = 1e-6


class Haptics(Sensed):
    """Vibration amplitudes of the left and the right controller since the last sample.

    Each number is the largest amplitude, 0 to 1, of the vibrations in that time. As in OpenXR a new
    vibration of a hand ends the previous one, amplitude 0 ends it too, and one without a duration
    is as short as possible: it appears in one sample. Vibrations begin when the app's reply
    arrives, at the end of the user step in whose frames the app requested them.

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


HEAD_RADIUS_M = 0.0875
SPEED_OF_SOUND_MPS = 343.0
SOUND_HZ = 2000.0
"""The head's shadow grows with the frequency; sounds are taken to be of this one."""
NEAREST_M = 1.0
"""A sound is as loud as its gain says up to here, and falls with 1 / r from here on."""
LOUDEST = 10.0
"""Louder than this is not told apart."""

_ALPHA_MIN = 0.1
_THETA_MIN_DEG = 150.0


def ear_gains(towards: ArrayLike) -> FloatArray:
    """Return the gain (amplitude) of a sound at the ears relative to the free field.

    Head shadow of a rigid sphere, as the one-pole, one-zero filter of Brown and Duda (1998), "A
    structural model for binaural sound synthesis", IEEE Trans. Speech and Audio Processing 6(5):
    H(w, theta) = (1 + j alpha w / 2 w0) / (1 + j w / 2 w0) with w0 = c / a,
    alpha(theta) = 1.05 + 0.95 cos(1.2 theta), theta the angle between the ear's axis and the
    source; a = 8.75 cm, c = 343 m/s. Its magnitude at 2 kHz is 1.78 (+5.0 dB) with the source at
    the ear's side, 0.83 (-1.6 dB) in front, and least, 0.54 (-5.4 dB), 150 degrees away.

    Args:
        towards: (..., 3) directions of sources from the head, x right, y up, z forward, of any
            length above 0.

    Returns:
        (..., 2) left and right.
    """
    direction = np.asarray(towards, dtype=np.float64)
    right = direction[..., 0] / np.linalg.norm(direction, axis=-1)
    theta_deg = np.degrees(np.arccos(np.clip(np.stack([-right, right], axis=-1), -1.0, 1.0)))
    alpha = (1.0 + _ALPHA_MIN / 2.0) + (1.0 - _ALPHA_MIN / 2.0) * np.cos(
        np.radians(theta_deg / _THETA_MIN_DEG * 180.0)
    )
    w = 2.0 * np.pi * SOUND_HZ * HEAD_RADIUS_M / (2.0 * SPEED_OF_SOUND_MPS)
    gains: FloatArray = np.sqrt((1.0 + (alpha * w) ** 2) / (1.0 + w**2))
    return gains


class Hearing(Sensed):
    """Loudness, left and right, of the sounds that began since the user last listened.

    Amplitude at the ear, 1 for a sound of gain 1 at 1 m or nearer in the open: it falls with 1 / r
    from 1 m on, the head shadows the far ear (:func:`ear_gains`), and sounds at the same time add
    up by their powers. The head's centre is taken to be where the headset is. At most 10.

    Args:
        name: key in the observation.
        n: number of users N.
    """

    def __init__(self, name: str, n: int) -> None:
        space = float_space(0.0, LOUDEST, 2)
        super().__init__(name, space, n, self._heard, needs="sounds")

    def _heard(self, moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        rows = np.arange(self.n) if ids is None else ids
        loudness = np.zeros((len(rows), 2))
        if moment.sounds:
            heads = moment.head_poses()
            for k, i in enumerate(rows.tolist()):
                if i in moment.sounds:
                    loudness[k] = _at_ears(heads[i], moment.sounds[i])
        return np.minimum(loudness, LOUDEST)


def _at_ears(head: FloatArray, sounds: Sequence[Sound]) -> FloatArray:
    """(2,) amplitude at the ears of a head with this pose, (7,)."""
    offset = np.array([sound.position_m for sound in sounds], dtype=np.float64) - head[:3]
    distance = np.linalg.norm(offset, axis=1)
    apart = distance > 1e-6  # a sound within the head is not shadowed
    # Turn the others' directions into the frame of the head: by the inverse rotation.
    gains = np.ones((len(sounds), 2))
    gains[apart] = ear_gains(turned(-head[3:6], head[6], offset[apart]))
    loud = np.array([sound.gain for sound in sounds]) / np.maximum(distance, NEAREST_M)
    return np.asarray(np.sqrt(((loud[:, None] * gains) ** 2).sum(axis=0)))
