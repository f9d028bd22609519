"""Present persons of N users: bodies, features and the factors that act on them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.people.people import Population
from sim2vr_harness.users.people.person import AVERAGE, FEATURES, Person

FloatArray = NDArray[np.float64]

_KEPT_BODIES = 256


class Persons:
    """N users, each of them someone.

    Args:
        body: of people who have no body of their own.
        batch: the users' simulations.
        people: the population that they are drawn from; None: all are average.
        cut: makes the body of a physique; None: bodies do not differ, whatever people do.

    Attributes:
        strength, motor_noise, effort_weight, head_movement: (N,) factors relative to `body` and
            the settings.
        features: (N, F) float32, see `Person.features`.
    """

    def __init__(
        self,
        body: Body,
        batch: Batch,
        people: Population | None = None,
        cut: Callable[[Physique], Body] | None = None,
    ) -> None:
        n = batch.nsim
        self.people = people
        self._body, self._batch = body, batch
        self._cut = None if cut is None else lru_cache(maxsize=_KEPT_BODIES)(_by_key(cut))
        alike = AVERAGE if people is None else people.alike
        self._alike_strength, self._alike_hand = alike.strength, alike.handedness
        self._now = [alike] * n
        self._bodies: list[Body] = [body] * n
        self._models: list[mujoco.MjModel] = [body.physics_model] * n
        self.strength, self.motor_noise = np.ones((2, n))
        self.effort_weight, self.head_movement = np.ones((2, n))
        self.delays_s = {
            name: np.full(n, getattr(alike, name))
            for name in ("visual_delay_s", "proprioceptive_delay_s")
        }
        self.features = np.tile(alike.features, (n, 1))
        assert self.features.shape == (n, len(FEATURES))

    @property
    def now(self) -> tuple[Person, ...]:
        """(N,) the persons."""
        return tuple(self._now)

    def body(self, i: int) -> Body:
        """User i's own body."""
        return self._bodies[i]

    def become(self, ids: Sequence[int] | NDArray[np.integer], persons: Sequence[Person]) -> None:
        """Makes these users these persons; their simulations are to be reset or restored next."""
        own_bodies = False
        for i, person in zip(np.asarray(ids).tolist(), persons, strict=True):
            self._now[i] = person
            # A mirror image's network is one, too: to itself it plays with the body's hand.
            self.features[i] = replace(person, handedness=self._alike_hand).features
            self.strength[i] = person.strength / self._alike_strength
            self.motor_noise[i] = person.motor_noise
            self.effort_weight[i] = person.effort_weight
            self.head_movement[i] = person.head_movement
            for name, delays in self.delays_s.items():
                delays[i] = getattr(person, name)
            if self.people is not None and self._cut is not None:
                physique = self.people.physique(person)
                self._bodies[i] = self._cut(physique.model_dump_json())
                self._models[i] = self._bodies[i].physics_model
                own_bodies = True
        if own_bodies:
            self._batch.set_models(self._models)

    def state_dict(self, i: int) -> dict[str, Any]:
        """Who user i is, as plain values."""
        return self._now[i].as_dict()

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Makes user i the person of `state_dict`.

        Raises:
            ValueError: the state is of something else.
        """
        self.become([i], [Person.from_dict(state)])


def _by_key(cut: Callable[[Physique], Body]) -> Callable[[str], Body]:
    def body(physique_json: str) -> Body:
        return cut(Physique.model_validate_json(physique_json))

    return body
