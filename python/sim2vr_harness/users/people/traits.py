"""Traits that differ between people: distributions and their sources.

Every trait is normal, or its logarithm is, cut at two standard deviations, about the mean of women
and men; where the sexes differ, that mean moves by `sex_offset` up for men and down for women.
docs/concepts/people.md has the table with the sources' numbers.
"""

import math
from dataclasses import dataclass
from typing import Literal

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
    """How one number is distributed over people.

    Attributes:
        name: of the field of `Person`.
        mean: of people; of a logarithmic trait the median.
        sd: of people of one sex; of a logarithmic trait that of its natural logarithm.
        sex_offset: half the difference of men and women, in the unit of `sd`.
        logarithmic: whether the logarithm is normal.
        half_range: what is one unit of the feature, in the unit of `sd`.
        grid: people have multiples of it, none below 0; 0: any number.
    """

    name: TraitName
    mean: float
    sd: float
    half_range: float
    sex_offset: float = 0.0
    logarithmic: bool = False
    grid: float = 0.0

    def value(self, deviation: float, sex: float, spread: float, mean: float) -> float:
        """What someone has.

        Args:
            deviation: from the sex's mean, in standard deviations.
            sex: 1 men, -1 women.
            spread: factor on how far people are from the mean.
            mean: of people, usually `self.mean`.
        """
        away = spread * (sex * self.sex_offset + deviation * self.sd)
        value = mean * math.exp(away) if self.logarithmic else mean + away
        return round(max(0, round(value / self.grid)) * self.grid, 9) if self.grid else value

    def farthest(self, spread: float, mean: float) -> float:
        """The largest that someone can have."""
        return self.value(CUT, 1.0, spread, mean)

    def feature(self, value: float) -> float:
        """The value relative to the mean, in half ranges: -1 to 1 of people with a spread of 1."""
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
"""What a policy observes, in the order of the features: a reflex moves the head, not the policy."""
