"""Settings of the game model of pointing (``teacher.imagined.game``)."""

from dataclasses import dataclass

from sim2vr_harness.base.settings import Settings

FAILING_BLOCKS = 0.5
"""Proportion of blocks that are drawn by their fail rates; the others are uniform, so that none is
forgotten."""
_DEPTH_M, _AIM_M = (0.004, 0.02), (0.003, 0.02)
_NEAR_REWARD, _DISTANCE_REWARD, _ERROR_SHARE = (0.1, 2.0), (1.0, 7.0), (1.0, 0.1)
"""Widths of the soft steps, rewards and the factor on the cost of an error: from the middle of the
imagined rollouts on, and at the start. Otherwise policies that cannot aim yet would avoid
selections."""
_BEHIND_COST = 0.3
"""Cost per user step of a tip that stays behind the plane, or nearly, after a selection. The game's
reward has no gradient for this."""


@dataclass(frozen=True)
class Relaxation:
    """Softness of taps, and weights of the additional rewards.

    Attributes:
        depth_m: width of the step from in front of the plane to behind it.
        aim_m: width of the step from beside the target to on it.
        near: reward in advance for being about to tap the target.
        distance: factor on the game's own distance reward.
        error: proportion of the game's cost of an error.
        behind: cost per user step of a tip that has not come out of the plane again.
    """

    depth_m: float
    aim_m: float
    near: float
    distance: float
    error: float
    behind: float


class GameModelSettings(Settings):
    """Settings of the game model of Pointing: none, because one set of values serves all users."""

    def relaxation(self, done: float) -> Relaxation:
        """Return softness and weights after this proportion of the imagined rollouts."""
        early = max(0.0, 1.0 - 2.0 * done)

        def towards(end: float, start: float) -> float:
            return end + (start - end) * early

        return Relaxation(
            depth_m=towards(*_DEPTH_M),
            aim_m=towards(*_AIM_M),
            near=towards(*_NEAR_REWARD),
            distance=towards(*_DISTANCE_REWARD),
            error=towards(*_ERROR_SHARE),
            behind=_BEHIND_COST,
        )
