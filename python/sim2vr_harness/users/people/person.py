"""A person: everything in which one user differs from another, and the features that say so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.people.traits import TOLD


@dataclass(frozen=True)
class Person:
    """Who a user is.

    Attributes:
        index: number among the people that it was drawn from; None: no particular person.
        stature_m: body height; segments are shares of it, masses go with its square.
        upper_arm_factor: length of the upper arm over its share of the stature.
        forearm_factor: the same of the forearm.
        strength: factor on the peak forces of the muscles.
        visual_delay_s: from what happens to what is seen.
        proprioceptive_delay_s: from what the body does to what is felt.
        motor_noise: factor on the standard deviations of the motor noise.
        effort_weight: factor on the cost of effort.
        head_movement: factor on how far the head moves, where a reflex moves it.
        handedness: the hand that plays.
    """

    index: int | None = None
    stature_m: float = 1.70
    upper_arm_factor: float = 1.0
    forearm_factor: float = 1.0
    strength: float = 1.0
    visual_delay_s: float = 0.1
    proprioceptive_delay_s: float = 0.05
    motor_noise: float = 1.0
    effort_weight: float = 1.0
    head_movement: float = 1.0
    handedness: Literal["right", "left"] = "right"

    @property
    def features(self) -> NDArray[np.float32]:
        """(F,) what a policy observes of the person, as `FEATURES` names it; about -1 to 1.

        Zero is the mean of people, 1 two standard deviations above it (delays: 0.03 s and 0.02 s);
        the scale is fixed, whatever distribution the person was drawn from.
        """
        values = [trait.feature(getattr(self, trait.name)) for trait in TOLD]
        values.append(1.0 if self.handedness == "left" else -1.0)
        return np.array(values, dtype=np.float32)

    def as_dict(self) -> dict[str, Any]:
        """All fields, ready for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Person:
        """The person of `as_dict`.

        Raises:
            ValueError: other fields.
        """
        if set(fields) != set(asdict(AVERAGE)):
            raise ValueError(
                f"person: got fields {sorted(fields)}, expected {list(asdict(AVERAGE))}"
            )
        return cls(**fields)


AVERAGE = Person()
"""The one that the MoBL ARMS bodies and the motor noise were measured on."""

FEATURES: tuple[str, ...] = (*(trait.name for trait in TOLD), "left_handed")
"""Names of a person's features."""
