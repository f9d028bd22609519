"""Coordinate frames of session files: WebXR's and the app's, grip and aim.

WebXR is right-handed with z backward, the app's frame left-handed with z forward (Unity). Both have
x right, y up, metres and rotations x y z w.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.rotations import product, turned

FloatArray = NDArray[np.float64]

_FLIPS = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0])
_GRIP_TO_AIM = np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, math.sqrt(0.75)])
"""A Touch controller's ray is 60 degrees below its grip's axis, as ``webxr/scripts`` has it."""
_INVERSE = np.array([-1.0, -1.0, -1.0, 1.0])


def from_webxr(poses: FloatArray) -> FloatArray:
    """Return (..., 7) poses of WebXR's frame in the app's."""
    return poses * _FLIPS


def to_webxr(poses: FloatArray) -> FloatArray:
    """Return (..., 7) poses of the app's frame in WebXR's."""
    return poses * _FLIPS


def aim_of(grip: FloatArray) -> FloatArray:
    """Return (..., 7) poses of the ray of a Touch controller whose grip is given."""
    return composed(grip, _GRIP_TO_AIM)


def grip_of(aim: FloatArray) -> FloatArray:
    """Return (..., 7) poses of the grip of a Touch controller whose ray is given."""
    return composed(aim, np.concatenate([np.zeros(3), _GRIP_TO_AIM[3:] * _INVERSE]))


def composed(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Return (..., 7): the pose ``inner``, given in the coordinates of ``outer``, in the world."""
    p = turned(outer[..., 3:6], outer[..., 6:], inner[..., :3])
    return np.concatenate([outer[..., :3] + p, product(outer[..., 3:], inner[..., 3:])], axis=-1)


def relative(outer: FloatArray, pose: FloatArray) -> FloatArray:
    """Return (..., 7): a pose of the world in the coordinates of ``outer``."""
    back = outer[..., 3:] * _INVERSE
    p = turned(back[..., :3], back[..., 3:], pose[..., :3] - outer[..., :3])
    return np.concatenate([p, product(back, pose[..., 3:])], axis=-1)
