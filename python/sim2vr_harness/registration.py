"""Gymnasium ids of the environments, one per game; importing ``sim2vr_harness`` registers them.

Only names are registered: bodies, apps and learners are loaded when an environment is made.
"""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium

from sim2vr_harness.base.errors import InputError, closest
from sim2vr_harness.base.files import read_json

__all__ = ["GAMES_FILE", "env_id", "register_envs", "require_known"]

GAMES_FILE = Path(__file__).with_name("games.json")
"""Written beside the extension module when that is built: name in ids -> name of the game."""


def env_id(name: str) -> str:
    """The id of a game's environment, ``sim2vr/WhacAMole-v0`` for ``WhacAMole``."""
    return f"sim2vr/{name}-v0"


def register_envs() -> None:
    """Registers an id for every game of the extension module; idempotent."""
    register_games(_games())


def register_games(games: Mapping[str, str]) -> None:
    """Registers the ids of games: name in ids -> name of the game; idempotent."""
    for name, game in games.items():
        if env_id(name) not in gymnasium.registry:
            gymnasium.register(
                env_id(name),
                entry_point="sim2vr_harness.envs.gym_env:Sim2VREnv",
                vector_entry_point="sim2vr_harness.envs.vector_env:Sim2VRVectorEnv",
                kwargs={"game": game},
            )


def require_known(unknown: Mapping[str, Any], make: Callable[..., Any]) -> None:
    """Check that an environment got no keyword that it does not take.

    Args:
        unknown: keywords that no parameter has taken.
        make: the constructor, whose other parameters are known.

    Raises:
        InputError: There is one; names those that are known.
    """
    if unknown:
        parameters = inspect.signature(make).parameters.values()
        known = [each.name for each in parameters if each.kind is each.POSITIONAL_OR_KEYWORD]
        wrong = next(iter(unknown))
        best = closest(wrong, known)
        hint = f" (did you mean {best!r}?)" if best else ""
        names = ", ".join(name for name in known if name != "self")
        raise InputError(wrong, "an unknown keyword", f"one of {names}{hint}")


def _games() -> dict[str, str]:
    """Name in ids -> name of the game, of every game that was built."""
    if GAMES_FILE.is_file():
        return read_json(GAMES_FILE, "the games of this build; build again")
    return {}  # nothing is built, so nothing can be played
