"""Hearing: how loud the app's sounds are at the left and the right ear."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.perception.sense import IntArray, Sensed, StepContext, float_space

FloatArray = NDArray[np.float64]

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
    """How much louder (amplitude) a sound is at the ears than in the open.

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
                    # (2,) amplitude at the ears of a head with this pose, (7,).
                    head = heads[i]
                    sounds = moment.sounds[i]
                    offset = (
                        np.array([sound.position_m for sound in sounds], dtype=np.float64)
                        - head[:3]
                    )
                    distance = np.linalg.norm(offset, axis=1)
                    gains = np.ones((len(sounds), 2))  # a sound within the head is not shadowed
                    apart = distance > 1e-6
                    # Turns (K, 3) world vectors into the frame of a head with this rotation.
                    quat_xyzw = head[3:]
                    vectors = offset[apart]
                    axis, w = -quat_xyzw[:3], quat_xyzw[3]  # the inverse rotation
                    cross = 2.0 * np.cross(axis, vectors)
                    turned: FloatArray = vectors + w * cross + np.cross(axis, cross)
                    gains[apart] = ear_gains(turned)
                    ears_loudness = np.array([sound.gain for sound in sounds]) / np.maximum(
                        distance, NEAREST_M
                    )
                    total: FloatArray = np.sqrt(((ears_loudness[:, None] * gains) ** 2).sum(axis=0))
                    loudness[k] = total
        return np.minimum(loudness, LOUDEST)
