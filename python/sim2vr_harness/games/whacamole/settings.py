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
    """How soft a hit is, and what else is rewarded.

    Attributes:
        overlap_m: width of the step from apart to overlapping.
        speed_mps: width of the step from too slow to fast enough.
        near: reward for being near a living target at speed.
        distance: reward for the game's own term of distance to living targets, times this.
        dwell: cost of staying in a target, which must be left before it can be hit: a hit has no
            gradient that says so.
        stroke: reward for being on the stroke that would hit the oldest target.
        plane: cost of being in the targets' plane, or behind it, away from targets.
        blind: cost of going towards the targets where none is that can have been seen.
        centre: share of a hit's worth that is for the middle of the target.
        face: share of a hit's worth that is for striking with the hammer's face.
        foregone: share of what a hit takes away that counts against it.
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
    much 0.1 m behind the plane, nothing 0.1 m before it. Who may hit at any speed roams the plane
    otherwise, and meets targets by chance before they can have been seen. Nothing at first, all of
    it from the middle of the imagined rollouts on: who cannot aim yet would stay away for good."""
    blind: float = 0.0
    """Cost per user step for each m/s that the hammer goes towards the targets while none that has
    been there for 0.15 s, as long as people's eyes take, is before it. Who may hit at any speed
    sets out before there is anything to see otherwise, and strikes as soon as there is. Nothing at
    first, all of it from the middle of the imagined rollouts on."""
    centre: float = 0.0
    """Share of a hit's worth that is for the middle of the target: all of it there, .6 of it 2 cm
    beside. A policy with exact positions hits targets at their rims, and its student misses them.
    Nothing at first, all of it from the middle of the imagined rollouts on."""
    face: float = 0.0
    """Share of a hit's worth that is for striking with the hammer's face: all of it where that goes
    first, half of it where the hammer is sideways. The game looks at a box around its head, whose
    sides hit as well; people turn its face to the targets (the cosine between them is .95). Nothing
    at first, all of it from the middle of the imagined rollouts on."""
    delay_gain_per_s: float = 0.0
    """How much more a hit is worth the older its target: times e for each 1/this, in seconds; 1
    after a third of its life. What comes later counts less to a learner (``gamma``), by 0.82 a
    second with .96 a step; with 0.82 here a hit is worth the same whenever it comes. With more, old
    targets, which will go, are worth more than new ones, as to who wants none to get away."""
    delay_until_s: float = LIFE_S
    """Age of a target up to which it is waited for (``foregone``), s. Of those that are older
    the oldest are worth most, too, but none is left for later."""
    foregone: float = 0.0
    """Share of what a hit takes away that counts against it: the same target cannot be hit any more
    later, when that would be worth most (``delay_gain_per_s``, up to ``delay_until_s``), as surely
    and as well as targets were hit in the last cycle; nothing where it would be worth less then. A
    hit has a gradient where it happens only, so users do not learn to wait otherwise. Nothing at
    first, all of it from the middle of the imagined rollouts on. ``keep_best`` chooses policies
    that do not wait yet, and has to be off."""
    hit_reward: float = 10.0
    """What a hit is worth; 10 in the game. Costs count the less the more this is: where
    ``foregone`` leaves little of it, users give up otherwise."""


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
    """How soft hits are, and which cells come up."""

    stroke_reward: Weight = 0.0
    """Reward per user step, at first, for a hammer that is where a stroke at the oldest target
    would have it: in front of the cell, and in it 0.6 s after the target appeared. Less with the
    distance, by 0.3 m below 0."""
    dwell_cost: Weight = 0.0
    """Cost per user step of a hammer that dwells in a target without having hit it. Without this
    cost, users that may hit at any speed wait where targets grow into the hammer."""
    shaping: Literal["none", "unhurried"] = "none"
    """``unhurried``: users who may hit at any speed wait for targets, aim at their middle and
    strike with the hammer's face, as people do. Set ``keep_best: false`` with it: policies that do
    not wait score best."""
    impact_speed_weight: Chance = 0.0
    """Proportion of a hit's reward that depends on the speed of the hammer's head towards the
    targets; all of it is paid from 3 m/s on. The game judges a point near the hand, which players
    cannot see: people strike with the head."""
    whole_steps: bool = False
    """Whether hits are looked for once a user step, at its mean speed, where the app does in each
    of several frames. Speeds of 10 ms are beyond what the body model knows, and what happens in
    the last frame of a step has the best gradient."""

    @property
    def values(self) -> Shaping:
        """What ``shaping`` stands for."""
        return _SHAPINGS[self.shaping]

    def relaxation(self, done: float) -> Relaxation:
        """What is rewarded when this share of the rollouts is over."""

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
