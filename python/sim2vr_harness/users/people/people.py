"""People as a distribution, of which every member can be requested by its number."""

from dataclasses import replace
from typing import Annotated, Any, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator
from scipy.special import ndtr, ndtri

from sim2vr_harness.base.settings import Chance, Settings
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.exertion.models import Strength
from sim2vr_harness.users.people.person import Person
from sim2vr_harness.users.people.traits import CUT, TRAITS, TraitName

_COUNTLESS = 2**31
_HAND = 0x6861
"""Of the random numbers that decide about hands, so that all others stay what they were."""
_SEGMENTS = {"upper_arm": "upper_arm_factor", "forearm": "forearm_factor"}

Delay = Annotated[float, Field(ge=0.0, le=1.0)]


class PeopleSettings(Settings):
    """Users are people who differ: every episode has one of them (docs/concepts/people.md)."""

    vary: tuple[TraitName, ...] = get_args(TraitName)
    """In what they differ; in the rest they are as the body and the settings say."""
    spread: float = Field(default=1.0, ge=0.0, le=2.0)
    """Factor on how far they are from the mean; 0 makes all of them alike."""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """Other people for another seed; number k of a seed is always the same person."""
    count: int | None = Field(default=None, ge=1, le=_COUNTLESS)
    """How many there are, numbers 0 to count - 1; None: no end of them."""
    left_handed: Chance = 0.0
    """Share of people who play with the other hand than the body: its mirror image, at the border
    to a game that can be played with either (docs/concepts/people.md). For evaluations."""
    strength: float = Field(default=0.78, gt=0.0, le=10.0)
    """Median factor on the peak forces of the body's muscles; women have .78 of it, men 1.28 times
    as much."""
    visual_delay_s: Delay = 0.1
    """Mean delay of their sight, s."""
    proprioceptive_delay_s: Delay = 0.05
    """Mean delay with which they feel their bodies, s."""

    @field_validator("vary")
    @classmethod
    def _once(cls, names: tuple[TraitName, ...]) -> tuple[TraitName, ...]:
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"got {name!r} twice, expected each at most once")
        return names


class Population:
    """Draws persons.

    Args:
        settings: who they are.
        physique: of all of them in what they do not differ.
        cut: standard deviations from the mean beyond which nothing is drawn; infinite in audits,
            which count the shortest and tallest persons that a design excludes.

    Raises:
        ValueError: the physique sets something that they differ in.
    """

    def __init__(
        self, settings: PeopleSettings, physique: Physique | None = None, *, cut: float = CUT
    ) -> None:
        physique = physique or Physique()
        check_physique(settings, physique)
        self.settings, self._physique, self._cut = settings, physique, cut
        self.varied = tuple(trait for trait in TRAITS if trait.name in settings.vary)
        alike: dict[str, Any] = {
            "strength": physique.strength,
            "visual_delay_s": settings.visual_delay_s,
            "proprioceptive_delay_s": settings.proprioceptive_delay_s,
            "handedness": physique.handedness or "right",
        }
        if physique.stature_m is not None:
            alike["stature_m"] = physique.stature_m
        self.alike = Person(**alike)
        """What all of them have, but for what they differ in."""

    def sample(self, seed: int, index: int) -> Person:
        """Number ``index`` of the people of a seed; depends on nothing else.

        What people do not differ in takes no part: the other numbers are the same without it.
        """
        if seed < 0 or index < 0:
            raise ValueError(f"person: got seed {seed} and index {index}, expected 0 or above")
        draws = np.random.default_rng([seed, index]).random(1 + len(TRAITS))
        sex = _sex(draws)
        low, high = ndtr(-self._cut), ndtr(self._cut)
        deviations = ndtri(low + (high - low) * draws[1:])
        values: dict[str, Any] = {
            trait.name: trait.value(float(deviation), sex, self.settings.spread, self._mean(trait))
            for trait, deviation in zip(TRAITS, deviations, strict=True)
            if trait in self.varied
        }
        if np.random.default_rng([seed, index, _HAND]).random() < self.settings.left_handed:
            values["handedness"] = "right" if self.alike.handedness == "left" else "left"
        return replace(self.alike, index=index, **values)

    def of_episode(self, seed: int) -> Person:
        """The person of the episode with this seed (of the app's round, 32 bits)."""
        count = self.settings.count or _COUNTLESS
        index = int(np.random.default_rng([seed, 0x7065]).integers(count))
        return self.sample(self.settings.seed, index)

    def number(self, index: int) -> Person:
        """Number ``index`` of the people of the settings' own seed.

        Raises:
            ValueError: there are fewer.
        """
        count = self.settings.count or _COUNTLESS
        if not 0 <= index < count:
            raise ValueError(f"person: got {index}, expected 0 to {count - 1}")
        return self.sample(self.settings.seed, index)

    def is_man(self, index: int) -> bool:
        """Whether the traits of :meth:`number` ``index`` are drawn from men's distributions."""
        return _sex(np.random.default_rng([self.settings.seed, index]).random(1)) > 0.0

    def shoulder(self, person: Person) -> Strength:
        """Strength of a person's shoulder, for published torques.

        Published torques are those of a sex, and people of this population have them times their
        strength relative to the median of that sex. The factor on the forces of the body's muscles
        which that median is says how strong the body's model is, not how strong they are. People
        who do not differ in strength are men with the factor of the body, as users without people.
        """
        strength = next(trait for trait in TRAITS if trait.name == "strength")
        if strength not in self.varied or person.index is None:
            return Strength(factor=person.strength)
        spread, mean = self.settings.spread, self.settings.strength
        if spread == 0.0:
            return Strength(factor=person.strength / mean)
        man = self.is_man(person.index)
        median = strength.value(0.0, 1.0 if man else -1.0, spread, mean)
        return Strength(man, person.strength / median)

    def longest(self, delay: str) -> float:
        """The longest that someone's ``visual_delay_s`` or ``proprioceptive_delay_s`` can be."""
        trait = next(trait for trait in TRAITS if trait.name == delay)
        if trait not in self.varied:
            return float(getattr(self.alike, delay))
        return trait.farthest(self.settings.spread, self._mean(trait))

    def physique(self, person: Person) -> Physique:
        """What a body has to be cut to for a person."""
        varied = {trait.name for trait in self.varied}
        changed: dict[str, Any] = {
            name: getattr(person, name) for name in ("stature_m", "strength") if name in varied
        }
        factors = {
            segment: getattr(person, name) for segment, name in _SEGMENTS.items() if name in varied
        }
        if factors:
            changed["segment_factors"] = {**self._physique.segment_factors, **factors}
        return self._physique.model_copy(update=changed)

    def _mean(self, trait: Any) -> float:
        return float(getattr(self.settings, trait.name, trait.mean))


def _sex(draws: NDArray[np.float64]) -> float:
    """1 for men, -1 for women, from a person's first random number."""
    return 1.0 if draws[0] < 0.5 else -1.0


def check_physique(settings: PeopleSettings, physique: Physique) -> None:
    """Raises ValueError if every user's physique sets what people differ in."""
    taken = {
        "stature_m": physique.stature_m is not None,
        "strength": physique.strength != 1.0,
        **{
            name: segment in physique.segment_lengths_m or segment in physique.segment_factors
            for segment, name in _SEGMENTS.items()
        },
    }
    for name in settings.vary:
        if taken.get(name):
            raise ValueError(
                f"people.vary: got {name!r}, which user.person sets for all of them; expected one "
                "of the two"
            )
