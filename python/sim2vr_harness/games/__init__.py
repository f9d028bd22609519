"""What Python knows of a game: its differentiable model for imagined rollouts, and its curriculum.

A game needs nothing here to be trained, evaluated or filmed. One that the fast recipe shall learn
(``recipe: distill``) has a room of its own, found by its name; nothing else in the harness names a
game. Residents implement :class:`~sim2vr_harness.games.imagined.ImaginedGame`.
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
