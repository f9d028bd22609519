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
    """Softness of cuts, and weights of the additional rewards.

    Attributes:
        contact_m: width of the step from apart to touching.
        speed_mps: width of the step from too slow to fast enough.
        angle_deg: width of the step from a wrong direction to a right one.
        near: points per user step for a blade that is near its next box when it arrives.
        error: cost of a wrong cut, in points.
        hazard: cost of a contact with a mine or a wall, in points.
        stroke: points per user step for a blade that follows a stroke through its next box.
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
    """Start times of rounds, softness of cuts at the start, and rewards beside the score."""

    busy_starts: float = 0.9
    """Proportion of rounds that begin shortly before a box arrives, instead of at any time."""
    angle_deg: float = 25.0
    """Width of the soft step from a wrong direction to a right one, at the start."""
    near_reward: float = 20.0
    """Points per user step for a blade near its next box when that arrives, at the start. After
    four fifths of the imagined rollouts this and ``angle_deg`` are 5 and 15."""
    hazard_cost: float = 0.0
    """Cost of a contact with a mine or a wall from the first rollouts on, in points. 0: the cost of
    other errors, which is low at first. A policy that learns to avoid them last has little time
    for it."""
    gaze_cost: float = 0.0
    """Cost in points per user step of a head that is turned by 45 degrees away from the origin of
    the boxes, quadratic in the angle. The teacher observes the boxes' positions; its student must
    see them."""
    wall_cost: float = 0.0
    """Cost in points per user step of a head that is 10 cm deep in a wall, in proportion to the
    depth, which counts from 6 cm in front of the wall. The cost of a contact is paid once, and has
    no gradient deep inside."""
    early_error_cost: float = 20.0
    """Cost of a wrong cut, a mine or a wall at the start, in points. In levels with all directions
    a policy that pays for wrong cuts before it makes right ones learns to keep its blades away."""


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
    """Settings of the game model of Beats: softness of cuts and additional rewards."""

    shaping: Literal["none", "whole_levels"] = "none"
    """``whole_levels``: for levels with boxes of all directions, mines and walls. At first
    directions are soft, errors cost little and hazards much; a gaze cost keeps the head turned to
    the origin of the boxes."""
    stroke_reward: Weight = 0.0
    """Points per user step, at first, for a blade on a stroke through its next box: drawn back half
    a second before, and in the box's middle when it arrives. The reward decreases with the distance
    from the stroke, is negative beyond half a metre, and is zero after four fifths of the imagined
    rollouts."""

    @property
    def values(self) -> Shaping:
        """Values that ``shaping`` selects."""
        return _SHAPINGS[self.shaping]

    def relaxation(self, done: float) -> Relaxation:
        """Return softness and weights after this proportion of the imagined rollouts."""
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
