"""Game-specific Python code: differentiable game models for imagined rollouts, and curricula.

A game needs nothing here to be trained, evaluated or rendered. A game for ``recipe: distill`` has a
package here, found by its name; no other module of the harness names a game. Each package
implements :class:`~sim2vr_harness.games.imagined.ImaginedGame`.
"""

from sim2vr_harness.games.imagined import ImaginedCondition, ImaginedGame, ImaginedRounds
from sim2vr_harness.games.registry import imagined_game, imagined_games, imagined_settings

__all__ = [
    "ImaginedCondition",
    "ImaginedGame",
    "ImaginedRounds",
    "imagined_game",
    "imagined_games",
    "imagined_settings",
]
