"""People: traits in which they differ, a distribution of them, and the present persons of users.

Every trait is normal, or its logarithm is, cut at two standard deviations, about the mean of women
and men; where the sexes differ, that mean moves by `sex_offset` up for men and down for women.
docs/concepts/people.md has the table with the sources' numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal, get_args

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray
from pydantic import Field, field_validator
from scipy.special import ndtr, ndtri

from sim2vr_harness.base.settings import Chance, Settings
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.exertion import Strength

FloatArray = NDArray[np.float64]

TraitName = Literal[
    "stature_m",
    "upper_arm_factor",
    "forearm_factor",
    "strength",
    "visual_delay_s",
    "proprioceptive_delay_s",
    "motor_noise",
    "effort_weight",
    "head_movement",
]
"""The fields of a `Person` that people differ in."""

CUT = 2.0
"""Standard deviations from the mean beyond which there is no one."""


@dataclass(frozen=True)
class Trait:
    """Distribution of one trait in the population.

    Attributes:
        name: name of the field of `Person`.
        mean: mean of the population; of a logarithmic trait the median.
        sd: standard deviation within one sex; of a logarithmic trait that of its natural logarithm.
        sex_offset: half the difference of men and women, in the unit of `sd`.
        logarithmic: True if the logarithm is normally distributed.
        half_range: size of one unit of the feature, in the unit of `sd`.
        grid: values are multiples of it, none below 0; 0: any number.
    """

    name: TraitName
    mean: float
    sd: float
    half_range: float
    sex_offset: float = 0.0
    logarithmic: bool = False
    grid: float = 0.0

    def value(self, deviation: float, sex: float, spread: float, mean: float) -> float:
        """Return a person's value of the trait.

        Args:
            deviation: deviation from the sex's mean, in standard deviations.
            sex: 1 men, -1 women.
            spread: factor on deviations from the mean.
            mean: mean of the population, usually `self.mean`.
        """
        away = spread * (sex * self.sex_offset + deviation * self.sd)
        value = mean * math.exp(away) if self.logarithmic else mean + away
        return round(max(0, round(value / self.grid)) * self.grid, 9) if self.grid else value

    def farthest(self, spread: float, mean: float) -> float:
        """Return the largest value that a person can have."""
        return self.value(CUT, 1.0, spread, mean)

    def feature(self, value: float) -> float:
        """Return the value relative to the mean in half ranges, -1 to 1 with a spread of 1."""
        away = math.log(value / self.mean) if self.logarithmic else value - self.mean
        return away / self.half_range

    def of_feature(self, feature: float) -> float:
        """The value that has this feature."""
        away = float(feature) * self.half_range
        return self.mean * math.exp(away) if self.logarithmic else self.mean + away


FRAME_S = 0.01
"""Delays are multiples of a frame at 100 Hz, which `frames_per_step: 5` at 20 Hz keeps exactly."""


TRAITS: tuple[Trait, ...] = (
    # ANSUR II (Gordon et al. 2014): men 1.756 +- .069 m, women 1.629 +- .064 m.
    Trait("stature_m", 1.692, sd=0.0665, sex_offset=0.0635, half_range=0.1965),
    # About the share of the stature (Drillis and Contini 1966): a correlation with the stature of
    # .8 and a coefficient of variation of 5 % within a sex (ANSUR: acromion-radiale and
    # radiale-stylion length) leave 3 %.
    Trait("upper_arm_factor", 1.0, sd=0.03, half_range=0.06),
    Trait("forearm_factor", 1.0, sd=0.03, half_range=0.06),
    # Grip strength in its best years (Dodds et al. 2014): men 51, women 31 kg, each +- 18 %. The
    # body's own muscles are a man's: median of both sqrt(31/51), offset half of ln(51/31).
    Trait("strength", 0.780, sd=0.18, sex_offset=0.249, half_range=0.609, logarithmic=True),
    # 0.1 s from the eye to the arm's command, 0.05 s from the arm (Crevecoeur, Munoz and Scott
    # 2016). Spread: latencies of nine people playing, .183 to .203 s (docs/concepts/people.md),
    # whose range is 2.97 standard deviations of a normal distribution; the arm's alike in
    # proportion.
    Trait("visual_delay_s", 0.1, sd=0.0067, half_range=0.03, grid=FRAME_S),
    Trait("proprioceptive_delay_s", 0.05, sd=0.0034, half_range=0.02, grid=FRAME_S),
    # Spread of end points in these nine people's easy rounds, .0127 to .0182 m, likewise.
    Trait("motor_noise", 1.0, sd=0.12, half_range=0.24, logarithmic=True),
    # Speeds of these nine in easy rounds, .956 to 1.64 m/s, differ by 18 %, which people keep from
    # task to task and which is willingness to make an effort (Reppert et al. 2018). A movement of
    # duration T at least effort and time has T^2 ~ weight where effort is linear in torque, T^4 ~
    # weight where it is squared: three times 17 %.
    Trait("effort_weight", 1.0, sd=0.5, half_range=1.0, logarithmic=True),
    # How far these nine turn their heads in easy rounds, 3.94 to 8.6 degrees, likewise.
    Trait("head_movement", 1.0, sd=0.26, half_range=0.52, logarithmic=True),
)

TOLD = tuple(trait for trait in TRAITS if trait.name != "head_movement")
"""Traits that a policy observes, in the order of the features. Head movement is not among them,
because a reflex moves the head."""


@dataclass(frozen=True)
class Person:
    """Traits of one simulated person.

    Attributes:
        index: number in the population; None: no particular person.
        stature_m: body height; segment lengths are proportional to it, masses to its square.
        upper_arm_factor: length of the upper arm relative to its proportion of the stature.
        forearm_factor: length of the forearm relative to its proportion of the stature.
        strength: factor on the peak forces of the muscles.
        visual_delay_s: delay of vision.
        proprioceptive_delay_s: delay of proprioception.
        motor_noise: factor on the standard deviations of the motor noise.
        effort_weight: factor on the cost of effort.
        head_movement: factor on the amplitude of the head reflex.
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
        """(F,) observed features of the person, in the order of `FEATURES`; about -1 to 1.

        Zero is the mean of people, 1 two standard deviations above it (delays: 0.03 s and 0.02 s).
        The scale does not depend on the distribution from which the person was sampled.
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

_COUNTLESS = 2**31
_HAND = 0x6861
"""Stream of the random numbers for handedness, separate so that it does not change the others."""
_SEGMENTS = {"upper_arm": "upper_arm_factor", "forearm": "forearm_factor"}

Delay = Annotated[float, Field(ge=0.0, le=1.0)]


class PeopleSettings(Settings):
    """Simulated population: every episode samples one participant (docs/concepts/people.md)."""

    vary: tuple[TraitName, ...] = get_args(TraitName)
    """Traits that differ between participants; the body and the settings determine all others."""
    spread: float = Field(default=1.0, ge=0.0, le=2.0)
    """Factor on deviations from the mean; with 0 all participants are alike."""
    seed: int = Field(default=0, ge=0, lt=2**31)
    """Seed of the population; participant k of a seed is always the same."""
    count: int | None = Field(default=None, ge=1, le=_COUNTLESS)
    """Size of the population, with numbers 0 to count - 1; None: unlimited."""
    left_handed: Chance = 0.0
    """Proportion of participants who play with the body's other hand (docs/concepts/people.md).
    They are its mirror image, applied between the body and a game that either hand can play. For
    evaluations."""
    strength: float = Field(default=0.78, gt=0.0, le=10.0)
    """Median factor on the peak forces of the body's muscles; the median of women is 0.78 times, of
    men 1.28 times this value."""
    visual_delay_s: Delay = 0.1
    """Mean delay of vision, s."""
    proprioceptive_delay_s: Delay = 0.05
    """Mean delay of proprioception, s."""

    @field_validator("vary")
    @classmethod
    def _once(cls, names: tuple[TraitName, ...]) -> tuple[TraitName, ...]:
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"got {name!r} twice, expected each at most once")
        return names


class Population:
    """Population from which persons are sampled.

    Args:
        settings: settings of the population.
        physique: traits that all persons share.
        cut: bound of the deviations from the mean, in standard deviations; infinite in audits,
            which count the shortest and tallest persons that a design excludes.

    Raises:
        ValueError: the physique sets a trait that varies.
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
        """Person with the values that all persons share."""

    def sample(self, seed: int, index: int) -> Person:
        """Return person ``index`` of a seed; the result depends on nothing else.

        Traits that do not vary have no influence on the random numbers of the others.
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
        """Return the person of the episode with this seed (of the app's round, 32 bits)."""
        count = self.settings.count or _COUNTLESS
        index = int(np.random.default_rng([seed, 0x7065]).integers(count))
        return self.sample(self.settings.seed, index)

    def number(self, index: int) -> Person:
        """Return person ``index`` of the settings' own seed.

        Raises:
            ValueError: the population is smaller.
        """
        count = self.settings.count or _COUNTLESS
        if not 0 <= index < count:
            raise ValueError(f"person: got {index}, expected 0 to {count - 1}")
        return self.sample(self.settings.seed, index)

    def is_man(self, index: int) -> bool:
        """Return True if the traits of person ``index`` are from men's distributions."""
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
        """Return the physique to which the body is scaled for a person."""
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


_KEPT_BODIES = 256


class Persons:
    """Persons of N users.

    Args:
        body: body of persons without a body of their own.
        batch: the users' simulations.
        people: the population from which they are sampled; None: all are average.
        cut: returns the body of a physique; None: all persons have the same body.

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
        """Return the person of user i as plain values."""
        return self._now[i].as_dict()

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Set user i to the person of `state_dict`.

        Raises:
            ValueError: the state is of another kind.
        """
        self.become([i], [Person.from_dict(state)])


def _by_key(cut: Callable[[Physique], Body]) -> Callable[[str], Body]:
    def body(physique_json: str) -> Body:
        return cut(Physique.model_validate_json(physique_json))

    return body
