"""Persons of imagined users: features a network observes, and exact factors."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.users import FEATURES, Body, Person, Population
from sim2vr_harness.users.people import TOLD

_SIZES, _FACTORS = 3, 2
_REFERENCES = (
    (1.6, 1.0, 1.0),
    (1.8, 1.0, 1.0),
    (1.6, 1.1, 1.0),
    (1.6, 1.0, 1.1),
    (1.75, 0.95, 0.95),
)
"""Stature, m, and factors of upper arm and forearm of bodies that all others follow from."""


class ImaginedPersons:
    """Tensor representation of persons, (B, P): features, sizes, motor noise and effort factors.

    Without a population P is 0.

    Args:
        env: environment of the true game.
    """

    def __init__(self, env: ResolvedEnv) -> None:
        self._people: Population | None = env.people
        self.names = tuple(f"person {name}" for name in FEATURES) if self._people else ()
        """Names of the values of :meth:`features`, as in a teacher's observation."""
        self.count = len(FEATURES) + _SIZES + _FACTORS if self._people else 0
        """Number of values per person, P."""
        self.references: list[tuple[tuple[float, ...], Body]] = []
        """Sizes with the bodies that have them; link lengths of all others are linear in them."""
        if self._people is not None:
            for stature, upper, fore in _REFERENCES:
                person = replace(
                    self._people.alike,
                    stature_m=stature,
                    upper_arm_factor=upper,
                    forearm_factor=fore,
                )
                body = env.body_for(self._people.physique(person))
                self.references.append((self._sizes_of(person), body))

    def of(self, simulation: Simulation) -> NDArray[np.float64]:
        """(N, P) the users' persons as they are now."""
        if self._people is None:
            return np.zeros((simulation.n, 0))
        rows = [
            (*person.features, *self._sizes_of(person), person.motor_noise, person.effort_weight)
            for person in simulation.users.persons
        ]
        return np.array(rows, dtype=np.float64)

    def told(self, features: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return a person (P,) from its observed features, :attr:`Person.features`."""
        assert self._people is not None
        values: dict[str, Any] = {
            trait.name: trait.of_feature(f) for trait, f in zip(TOLD, features, strict=False)
        }
        person = replace(self._people.alike, **values)
        row = (*features, *self._sizes_of(person), person.motor_noise, person.effort_weight)
        return np.array(row, dtype=np.float64)

    @staticmethod
    def visual_delay_s(person: NDArray[np.float64]) -> float:
        """Return the visual delay of a person (P,), s."""
        column = FEATURES.index("visual_delay_s")
        return TOLD[column].of_feature(float(person[column]))

    def _sizes_of(self, person: Person) -> tuple[float, ...]:
        assert self._people is not None
        varied = {trait.name for trait in self._people.varied}
        stature = person.stature_m if "stature_m" in varied else 1.0
        upper = person.upper_arm_factor if "upper_arm_factor" in varied else 1.0
        fore = person.forearm_factor if "forearm_factor" in varied else 1.0
        return (stature, stature * upper, stature * fore)

    def features(self, persons: Tensor) -> Tensor:
        """Return (B, F) features of persons (B, P)."""
        return persons[:, : len(self.names)]

    def sizes(self, persons: Tensor) -> Tensor | None:
        """(B, 3) of persons (B, P): stature, and stature times each arm segment's factor."""
        first = len(self.names)
        return persons[:, first : first + _SIZES] if self.count else None

    def motor_noise(self, persons: Tensor) -> Tensor | float:
        """(B, 1) factors on the noise."""
        return persons[:, -2:-1] if self.count else 1.0

    def effort(self, persons: Tensor) -> Tensor | float:
        """(B,) factors on the cost of effort."""
        return persons[:, -1] if self.count else 1.0
