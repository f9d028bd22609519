"""What may be set of imagined pointing: the keys of ``teacher.imagined.game``."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from sim2vr_harness.base.settings import Chance, Settings, Weight

__all__ = ["GameModelSettings", "Relaxation"]


@dataclass(frozen=True)
class Relaxation:
    """How soft a tap is, and what else is rewarded.

    Attributes:
        depth_m: width of the step from in front of the plane to behind it.
        aim_m: width of the step from beside the target to on it.
        near: paid ahead for being about to tap the target.
        distance: reward for the game's own term of distance, times this.
        error: share of the game's cost of an error.
        behind: cost per user step of a tip that has not come out of the plane again.
    """

    depth_m: float
    aim_m: float
    near: float
    distance: float
    error: float
    behind: float


class GameModelSettings(Settings):
    """How soft taps are, and which blocks come up."""

    failing_blocks: Chance = 0.5
    """Share of blocks that are drawn by their fail rates; the others are uniform."""
    depth_m: float = Field(default=0.02, ge=1e-6, le=10.0)
    """Width of the soft step from in front of the plane to behind it, at the start."""
    aim_m: float = Field(default=0.02, ge=1e-6, le=10.0)
    """Width of the soft step from beside the target to on it, at the start."""
    near_reward: Weight = 2.0
    """Reward for being about to tap the target, at the start."""
    distance_reward: Weight = 7.0
    """Factor on the game's reward for distance, at the start."""
    error_share: Chance = 0.1
    """Factor on the game's cost of an error, at the start. From the middle of the imagined rollouts
    on this and the four settings above are 1, 0.004, 0.003, 0.1 and 1."""
    behind_cost: Weight = 0.3
    """Cost per user step of a tip that stays behind the plane, or nearly, after a selection. The
    game's reward has no gradient that says so."""

    def relaxation(self, done: float) -> Relaxation:
        """What is rewarded when this share of the rollouts is over."""
        early = max(0.0, 1.0 - 2.0 * done)

        def towards(end: float, start: float) -> float:
            return end + (start - end) * early

        return Relaxation(
            depth_m=towards(0.004, self.depth_m),
            aim_m=towards(0.003, self.aim_m),
            near=towards(0.1, self.near_reward),
            distance=towards(1.0, self.distance_reward),
            error=towards(1.0, self.error_share),
            behind=self.behind_cost,
        )
