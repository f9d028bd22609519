"""Settings of the game model of Whac-A-Mole (``teacher.imagined.game``)."""

from dataclasses import dataclass
from typing import Literal

from sim2vr_harness.base.settings import Chance, Settings, Weight
from sim2vr_harness.games.whacamole.rules import LIFE_S

SINGLE_TARGETS = 0.4
"""Proportion of users who have one target at a time. With several, the policy chooses the near
ones only, and never learns to reach the far corner."""
FAILING_CELLS = 0.5
"""Proportion of spawns that follow the cells' fail rates; the others are uniform, so that no cell
is forgotten."""
FAILING_VALUE = 1.0
"""A hit in a cell that fails k times as often as the mean, at most 3 times, is worth this times
k - 1 hits more: with several targets at once the far cells are given up otherwise."""
RUN_UP_M = 0.1
"""Distance in front of the cell at which a stroke begins, m: muscles need it to reach a speed."""
_OVERLAP_M, _SPEED_MPS = (0.004, 0.015), (0.08, 0.3)
_NEAR_REWARD, _DISTANCE_REWARD = (0.2, 3.0), (1.0, 7.0)
"""Widths of the soft steps and rewards: from the middle of the imagined rollouts on, and at the
start. Motor noise blurs hits by itself: the gradient of a sharper step is zero most of the time."""
_STROKE_UNTIL = 0.5
"""Proportion of the imagined rollouts after which ``stroke_reward`` is zero: the rest has the
game's own rewards."""


@dataclass(frozen=True)
class Relaxation:
    """Softness of hits, and weights of the additional rewards.

    Attributes:
        overlap_m: width of the step from apart to overlapping.
        speed_mps: width of the step from too slow to fast enough.
        near: reward for being near a living target at speed.
        distance: factor on the game's own reward for the distance to living targets.
        dwell: cost of staying in a target, which must be left before it can be hit: a hit has no
            gradient for this.
        stroke: reward for a hammer on a stroke that hits the oldest target.
        plane: cost of being in the targets' plane, or behind it, away from targets.
        blind: cost of moving towards the targets' plane where no target can have been seen.
        centre: proportion of a hit's reward that depends on the distance from the target's middle.
        face: proportion of a hit's reward that depends on the orientation of the hammer's face.
        foregone: proportion of a hit's opportunity cost that is subtracted from its reward.
    """

    overlap_m: float
    speed_mps: float
    near: float
    distance: float
    dwell: float = 0.0
    stroke: float = 0.0
    plane: float = 0.0
    blind: float = 0.0
    centre: float = 0.0
    face: float = 0.0
    foregone: float = 0.0


@dataclass(frozen=True)
class Shaping:
    """Rewards and costs beside the game's own."""

    plane: float = 0.0
    """Cost per user step of a hammer that is in the targets' plane and not at a target; twice as
    much 0.1 m behind the plane, nothing 0.1 m before it. Otherwise policies that may hit at any
    speed roam the plane and meet targets by chance before they can have been seen. Zero at first,
    in full from the middle of the imagined rollouts on, because policies that cannot aim yet would
    stay away for good."""
    blind: float = 0.0
    """Cost per user step for each m/s of the hammer towards the targets' plane while there is no
    target in front of it that has been visible for 0.15 s, the visual latency of people. Otherwise
    policies that may hit at any speed set out before a target appears, and strike as soon as one
    does. Zero at first, in full from the middle of the imagined rollouts on."""
    centre: float = 0.0
    """Proportion of a hit's reward that depends on the distance from the target's middle: in full
    there, 0.6 of it 2 cm beside. A policy with exact positions hits targets at their rims, and its
    student misses them. Zero at first, in full from the middle of the imagined rollouts on."""
    face: float = 0.0
    """Proportion of a hit's reward that depends on the hammer's face: in full if the face leads,
    half of it if the hammer is sideways. The game tests a box around the head, whose sides hit as
    well; people turn the face to the targets (the cosine between them is 0.95). Zero at first, in
    full from the middle of the imagined rollouts on."""
    delay_gain_per_s: float = 0.0
    """Growth rate of a hit's reward with the age of its target, 1/s; the factor is 1 after a third
    of its life. The discount factor (``gamma``) reduces later rewards, at 0.96 per step by
    0.82 1/s; with 0.82 here a hit is worth the same at any time. With more, old targets, which soon
    expire, are worth more than new ones."""
    delay_until_s: float = LIFE_S
    """Age of a target up to which the policy waits for it (``foregone``), s. Among older targets
    the oldest are still worth most, but none is left for later."""
    foregone: float = 0.0
    """Proportion of a hit's opportunity cost that is subtracted from its reward. The opportunity
    cost is the highest expected reward of a later hit on the same target (``delay_gain_per_s``, up
    to ``delay_until_s``), with the success rate and the quality of hits in the last cycle; it is 0
    if a later hit would be worth less. A hit has a gradient only where it happens, so policies do
    not learn to wait otherwise. Zero at first, in full from the middle of the imagined rollouts
    on. ``keep_best`` selects policies that do not wait yet, and has to be off."""
    hit_reward: float = 10.0
    """Reward for a hit; 10 in the game. A larger value reduces the relative weight of costs;
    otherwise policies stop playing when ``foregone`` leaves little of the reward."""


_SHAPINGS = {
    "none": Shaping(),
    "unhurried": Shaping(
        plane=1.0,
        blind=1.0,
        centre=0.3,
        face=0.5,
        delay_gain_per_s=2.5,
        delay_until_s=0.5,
        foregone=1.0,
        hit_reward=30.0,
    ),
}
"""Values of ``shaping``. Where hits count at any speed, users who play ``unhurried`` wait, aim and
swing as people do."""


class GameModelSettings(Settings):
    """Settings of the game model of Whac-A-Mole: softness of hits and additional rewards."""

    stroke_reward: Weight = 0.0
    """Reward per user step, at first, for a hammer on a stroke at the oldest target: in front of
    the cell, and in it 0.6 s after the target appeared. The reward decreases with the distance from
    the stroke and is negative beyond 0.3 m."""
    dwell_cost: Weight = 0.0
    """Cost per user step of a hammer that dwells in a target without having hit it. Without this
    cost, users that may hit at any speed wait where targets grow into the hammer."""
    shaping: Literal["none", "unhurried"] = "none"
    """``unhurried``: users that may hit at any speed wait for targets, aim at their middle and
    strike with the hammer's face, as people do. Set ``keep_best: false`` with it, because policies
    that do not wait score best."""
    impact_speed_weight: Chance = 0.0
    """Proportion of a hit's reward that depends on the speed of the hammer's head towards the
    targets; all of it is paid from 3 m/s on. The game tests a point near the hand, which players
    cannot see; people strike with the head."""
    whole_steps: bool = False
    """True: hits are tested once per user step, at its mean speed; the app tests each of its
    frames. The body model does not predict speeds over 10 ms, and contacts in the last frame of a
    step have the best gradient."""

    @property
    def values(self) -> Shaping:
        """Values that ``shaping`` selects."""
        return _SHAPINGS[self.shaping]

    def relaxation(self, done: float) -> Relaxation:
        """Return softness and weights after this proportion of the imagined rollouts."""

        def left(until: float) -> float:
            return max(0.0, 1.0 - done / until) if until else 0.0

        early, shaping = left(0.5), self.values

        def towards(values: tuple[float, float]) -> float:
            end, start = values
            return end + (start - end) * early

        return Relaxation(
            overlap_m=towards(_OVERLAP_M),
            speed_mps=towards(_SPEED_MPS),
            near=towards(_NEAR_REWARD),
            distance=towards(_DISTANCE_REWARD),
            dwell=self.dwell_cost,
            stroke=left(_STROKE_UNTIL) * self.stroke_reward,
            plane=(1.0 - early) * shaping.plane,
            blind=(1.0 - early) * shaping.blind,
            centre=(1.0 - early) * shaping.centre,
            face=(1.0 - early) * shaping.face,
            foregone=(1.0 - early) * shaping.foregone,
        )
