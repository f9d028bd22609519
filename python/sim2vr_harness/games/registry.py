"""Registry of the games that have a package here."""

from importlib import import_module

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.base.settings import Settings
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.games.imagined import ImaginedGame

_ROOMS = {
    "beats": "sim2vr_harness.games.beats",
    "pointing": "sim2vr_harness.games.pointing",
    "whacamole": "sim2vr_harness.games.whacamole",
}
"""Name of the game -> its package: ``game.GAME`` is the game, ``settings.GameModelSettings`` the
settings of its differentiable model. A new game is one line."""

_MEASURED = {
    "whacamole": "sim2vr_harness.games.whacamole",
    "pointing": "sim2vr_harness.games.pointing",
}
"""Name of the game -> its package, whose ``behaviour.BEHAVIOUR`` describes how players' behaviour
is measured; it needs no differentiable model."""


def room_of(name: str) -> str | None:
    """Return the package of a game's room; None of a game without one."""
    return _ROOMS.get(name) or _MEASURED.get(name)


def imagined_games() -> tuple[str, ...]:
    """Return the names of the games that have a differentiable model."""
    return tuple(_ROOMS)


def imagined_game(name: str) -> ImaginedGame | None:
    """Return what the fast recipe knows of a game; None if it has no room here."""
    if name not in _ROOMS:
        return None
    game: ImaginedGame = import_module(f"{_ROOMS[name]}.game").GAME
    return game


def imagined_settings(name: str) -> type[Settings] | None:
    """Return the settings of a game's model, without loading torch; None if it has none."""
    if name not in _ROOMS:
        return None
    settings: type[Settings] = import_module(f"{_ROOMS[name]}.settings").GameModelSettings
    return settings


def behaviours() -> tuple[str, ...]:
    """Return the names of the games whose players' behaviour is measured."""
    return tuple(_MEASURED)


def behaviour_of(name: str) -> Behaviour:
    """Return what is to be known of a game to measure what its players do.

    Raises:
        InputError: It is not described.
    """
    if name not in _MEASURED:
        raise unknown_name("game", name, _MEASURED)
    found: Behaviour = import_module(f"{_MEASURED[name]}.behaviour").BEHAVIOUR
    return found
