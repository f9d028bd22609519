"""Grip: the force that keeps a thing in the hand, and how long a person has it."""

import numpy as np
from numpy.typing import ArrayLike

from sim2vr_harness.audit.population import Limitation, Subject
from sim2vr_harness.audit.reaching import Bools, FloatArray
from sim2vr_harness.audit.targets import Target

SOURCE = (
    "strength 51 kg (men), 31 kg (women): Dodds et al. 2014; friction 0.5 and a margin of 1.4: "
    "assumed; endurance: Frey-Law and Avin 2010, second-hand"
)
_GRAVITY = 9.81
_KG_MEN, _KG_WOMEN = 51.0, 31.0
"""Median grip strength."""
_FRICTION, _MARGIN = 0.5, 1.4
_ENDURANCE_S, _ENDURANCE_POWER = 33.55, 1.61


def grip_share(subject: Subject, target: Target, limitation: Limitation) -> float:
    """Return the grip force that a target takes as a share of a person's strength.

    A thing between palm and fingers is pressed from two sides. The controller's own weight does not
    count.
    """
    held_n = _MARGIN * target.load_kg * _GRAVITY / (2.0 * _FRICTION)
    factor = float(np.asarray(subject.strength.factor)) * limitation.strength
    median_kg = _KG_MEN if subject.strength.man else _KG_WOMEN
    return (held_n + target.grip_n) / (_GRAVITY * median_kg * factor)


def grip_time(share: ArrayLike) -> FloatArray:
    """Return how long hands hold a share of their maximum, s; endless at 0, none above 1."""
    share = np.asarray(share, dtype=np.float64)
    with np.errstate(divide="ignore"):
        time = _ENDURANCE_S * share**-_ENDURANCE_POWER
    return np.asarray(np.where(share > 1.0, 0.0, time), dtype=np.float64)


def can_grip(share: ArrayLike, hold_s: float) -> Bools:
    """Return whether a share of the strength is held so long."""
    return np.asarray((np.asarray(share) <= 1.0) & (grip_time(share) >= hold_s))
