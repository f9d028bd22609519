"""Settings of the game model of Beats (``teacher.imagined.game``)."""

from dataclasses import dataclass
from typing import Literal

from sim2vr_harness.base.settings import Settings, Weight

LEVELS = 64
"""Number of levels of a condition that imagined rounds draw from: too many to learn by heart."""
_CONTACT_M, _SPEED_MPS = (0.05, 0.1), (0.2, 0.5)
"""Widths of the soft steps from apart to touching and from too slow to fast enough: after four
fifths of the imagined rollouts, and at the start."""
_ERROR_COST = 20.0
"""Cost in points of a wrong cut, a mine or a wall after four fifths of the imagined rollouts; the
true score has none, so nothing else teaches to avoid errors."""


@dataclass(frozen=True)
class Relaxation:
    """How soft a cut is, and what else is rewarded.

    Attributes:
        contact_m: width of the step from apart to touching.
        speed_mps: width of the step from too slow to fast enough.
        angle_deg: width of the step from a wrong direction to a right one.
        near: points per user step for a blade that is near its next box when it arrives.
        error: cost of a wrong cut, in points.
        hazard: cost of a mine or a wall's touch, in points.
        stroke: points per user step for a blade that is on the stroke that would cut its next box.
    """

    contact_m: float
    speed_mps: float
    angle_deg: float
    near: float
    error: float
    hazard: float
    stroke: float = 0.0


@dataclass(frozen=True)
class Shaping:
    """Where rounds begin, how soft cuts are at the start, and what is paid beside the score."""

    busy_starts: float = 0.9
    """Share of rounds that begin shortly before a box arrives, instead of at any moment."""
    angle_deg: float = 25.0
    """Width of the soft step from a wrong direction to a right one, at the start."""
    near_reward: float = 20.0
    """Points per user step for a blade near its next box when that arrives, at the start. After
    four fifths of the imagined rollouts this and ``angle_deg`` are 5 and 15."""
    hazard_cost: float = 0.0
    """Cost of a mine, and of a wall's touch, from the first rollouts on, in points; 0: as of
    other errors, and as cheap at first. Who learns to avoid them last has little time for it."""
    gaze_cost: float = 0.0
    """Points per user step for a head that is turned by 45 degrees away from where boxes come from,
    less by the square for less. The
    teacher observes where they are; its student must look."""
    wall_cost: float = 0.0
    """Points per user step for a head that is 10 cm deep in a wall, in proportion to the depth; who
    is not 6 cm clear of it pays, too. The cost of a touch is paid once, and has no gradient deep
    inside."""
    early_error_cost: float = 20.0
    """Cost of a wrong cut, a mine or a wall at the start, in points. In levels with every direction
    a user who pays for wrong cuts before it makes right ones learns to keep its blades away."""


_SHAPINGS = {
    "none": Shaping(),
    "whole_levels": Shaping(
        busy_starts=0.6,
        angle_deg=50.0,
        near_reward=40.0,
        hazard_cost=200.0,
        gaze_cost=20.0,
        wall_cost=40.0,
        early_error_cost=1.0,
    ),
}
"""Values of ``shaping``."""


class GameModelSettings(Settings):
    """How soft cuts are, and which levels are played."""

    shaping: Literal["none", "whole_levels"] = "none"
    """``whole_levels``: for levels with boxes of every direction, mines and walls. Directions are
    soft and errors cheap at first, hazards dear, and users look where boxes come from."""
    stroke_reward: Weight = 0.0
    """Points per user step, at first, for a blade that is where a stroke through its next box would
    have it: drawn back half a second before, in the box's middle when it arrives. Less with the
    distance, by half a metre below 0; nothing after four fifths of the imagined rollouts."""

    @property
    def values(self) -> Shaping:
        """What ``shaping`` stands for."""
        return _SHAPINGS[self.shaping]

    def relaxation(self, done: float) -> Relaxation:
        """What is rewarded when this share of the rollouts is over."""
        early, shaping = max(0.0, 1.0 - done / 0.8), self.values

        def towards(end: float, start: float) -> float:
            return end + (start - end) * early

        error = towards(_ERROR_COST, shaping.early_error_cost)
        return Relaxation(
            contact_m=towards(*_CONTACT_M),
            speed_mps=towards(*_SPEED_MPS),
            angle_deg=towards(15.0, shaping.angle_deg),
            near=towards(min(5.0, shaping.near_reward), shaping.near_reward),
            error=error,
            hazard=shaping.hazard_cost or error,
            stroke=towards(0.0, self.stroke_reward),
        )
