"""Look up what a game's option takes."""

from functools import lru_cache
from typing import Literal

from sim2vr_harness.client.in_process import InProcessBatch
from sim2vr_harness.client.runtime import list_games

_EXPECTED: tuple[tuple[str, Literal["truth", "text"]], ...] = (
    ("expected true or false", "truth"),
    ("expected a string", "text"),
)
"""How the runtime words what it expects of an option (``core/options.cpp``)."""


@lru_cache
def option_kind(game: str, option: str) -> Literal["truth", "text", "other"] | None:
    """Return what an option of a game of the runtime takes; None of another game or option.

    The runtime says so when the option has a value of another kind, an empty list.
    """
    if game not in list_games():
        return None
    try:
        InProcessBatch(1, game, {option: []}, renderer="null", width=8, height=8)
    except ValueError as error:
        found = [kind for words, kind in _EXPECTED if str(error).endswith(words)]
        unknown = f"unknown option '{option}'" in str(error)
        return found[0] if found else None if unknown else "other"
    return "other"
