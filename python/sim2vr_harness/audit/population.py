"""The simulated population of an audit: participants, groups and limitations, with sources."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.special import ndtr

from sim2vr_harness.audit.postures import PostureHolder
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import STRENGTH
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.users import Body, PeopleSettings, Person, Population
from sim2vr_harness.users.exertion import Strength, arms_of
from sim2vr_harness.users.people import TRAITS

MODEL = "mobl_arms_wrist"
FEWEST = 30
"""Fewest participants of a group that is judged."""
_BANDS = (("below P25", 0.0, 25.0), ("P25 to P75", 25.0, 75.0), ("above P75", 75.0, 101.0))
GROUPS = (
    *(
        name
        for sex in ("women", "men")
        for name in (sex, *(f"{sex}, stature {band}" for band, _, _ in _BANDS))
    ),
    "left-handed",
)
"""Of the sampled participants; stature by percentile of the same sex."""
LEFT_HANDED = 0.106
Stance = Literal["seated", "standing"]

EYE_HEIGHT_STANDING = 0.936
"""Of the stature (Drillis and Contini 1966, second-hand)."""

_HALF_WRIST = {"flexion": (-22.5, 22.5), "deviation": (-5.0, 12.5), "pro_sup": (-45.0, 45.0)}


@dataclass(frozen=True)
class Limitation:
    """Something in which the same participants differ from themselves in the headline.

    Attributes:
        name: Of the group.
        source: Where its numbers are from.
        strength: Factor on the strength of all muscles and of the grip.
        limits_deg: Narrower limits of joints.
        one_hand: Whether only the preferred hand can be used.
        lift_m: How much higher they sit.
        stance: Another one than the audit's.
        recline_deg: Another angle by which the trunk leans back than the audit's; 90: lying.
        tremor_m, tremor_hz: Amplitude from the middle, of the hand, and frequency.
        verified: Whether its numbers' source was read, or they define the group.
    """

    name: str
    source: str = "defined by the audit"
    strength: float = 1.0
    limits_deg: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    one_hand: bool = False
    lift_m: float = 0.0
    stance: Stance | None = None
    recline_deg: float | None = None
    tremor_m: float = 0.0
    tremor_hz: float = 0.0
    verified: bool = True


NONE = Limitation("everyone")

LIMITATIONS: tuple[Limitation, ...] = (
    Limitation("one hand only", one_hand=True),
    Limitation("shoulder: raised at most 90 degrees", limits_deg={"shoulder_elv": (0.0, 90.0)}),
    Limitation("wrist: half of each range", limits_deg=_HALF_WRIST),
    Limitation("strength: 50 %", "all muscles and grip: defined by the audit", strength=0.5),
    Limitation("strength: 30 %", "all muscles and grip: defined by the audit", strength=0.3),
    Limitation(
        "standing",
        "eye height 0.936 of the stature: Drillis and Contini 1966, second-hand (not verified)",
        stance="standing",
        recline_deg=0.0,
        verified=False,
    ),
    Limitation(
        "wheelchair",
        "seat 5 cm above a chair's: assumed (not verified)",
        lift_m=0.05,
        stance="seated",
        recline_deg=0.0,
        verified=False,
    ),
    Limitation(
        "seated",
        "height of the arm model (docs/reference/bodies.md)",
        stance="seated",
        recline_deg=0.0,
    ),
    Limitation("lying on the back", stance="seated", recline_deg=90.0),
    Limitation("tremor: 1 cm at 5 Hz", tremor_m=0.01, tremor_hz=5.0),
)


@dataclass(frozen=True)
class Subject:
    """A participant of an audit.

    Attributes:
        person: Traits.
        man: Whether the traits are drawn from men's distributions.
        percentile: Of the stature among participants of the same sex.
        user: Right-handed, with a trunk that leans.
        strength: For published strength of shoulders, relative to the median of the sex.
        recline_deg: By how much the trunk leans back about the hips.
    """

    person: Person
    man: bool
    percentile: float
    user: UserConfig
    strength: Strength
    recline_deg: float = 0.0

    @cached_property
    def body(self) -> Body:
        """The participant's own body, upright; gravity is as the reclined trunk has it."""
        body, leans = ResolvedEnv.of_user(self.user).body, np.radians(self.recline_deg)
        if leans:
            down = body.physics_model.opt.gravity[2]
            body.physics_model.opt.gravity[:] = down * np.sin(leans), 0.0, down * np.cos(leans)
        return body

    @cached_property
    def holder(self) -> PostureHolder:
        """Posture holder of the right arm."""
        return PostureHolder(self.body, arms_of(self.body)[0])

    def shoulder(self, limitation: Limitation) -> Strength:
        """Return the published strength of the shoulder under a limitation."""
        return Strength(self.strength.man, np.asarray(self.strength.factor) * limitation.strength)

    @property
    def mirrored(self) -> bool:
        """Return whether the left hand is preferred."""
        return self.person.handedness == "left"


def draw(people: int, seed: int, recline_deg: float = 0.0) -> list[Subject]:
    """Draw the first participants of a seed, who lean back by an angle."""
    settings = PeopleSettings(
        seed=seed,
        count=people,
        left_handed=LEFT_HANDED,
        strength=STRENGTH,
        vary=("stature_m", "upper_arm_factor", "forearm_factor", "strength"),
    )
    population = Population(settings, cut=np.inf)
    stature = next(trait for trait in TRAITS if trait.name == "stature_m")
    subjects = []
    for index in range(people):
        person, man = population.number(index), population.is_man(index)
        user = UserConfig(model=MODEL, torso=True, person=population.physique(person))
        sign = 1.0 if man else -1.0
        z = (person.stature_m - stature.mean - sign * stature.sex_offset) / stature.sd
        percentile = float(100.0 * ndtr(z))
        strength = population.shoulder(person)
        subjects.append(Subject(person, man, percentile, user, strength, recline_deg))
    return subjects


@dataclass(frozen=True)
class Group:
    """Persons of the main population with a common property.

    Attributes:
        members: (M,) numbers of the participants.
    """

    name: str
    members: np.ndarray[tuple[int], np.dtype[np.int64]]


def groups_of(subjects: list[Subject]) -> list[Group]:
    """Return the groups that sex, stature and handedness make, as :data:`GROUPS` names them."""
    members: list[list[int]] = []
    for man in (False, True):
        own = [i for i, each in enumerate(subjects) if each.man == man]
        members.append(own)
        members += [
            [i for i in own if low <= subjects[i].percentile < high] for _, low, high in _BANDS
        ]
    members.append([i for i, each in enumerate(subjects) if each.mirrored])
    pairs = zip(GROUPS, members, strict=True)
    return [Group(name, np.array(who, dtype=np.int64)) for name, who in pairs]
