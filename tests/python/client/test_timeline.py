"""Timelines of levels, of every game that has them."""

from itertools import pairwise

import pytest

from sim2vr_harness.client import describe_game, describe_level, list_games

GAMES = [name for name in sorted(list_games()) if describe_game(name).level_option]


@pytest.mark.parametrize("game", GAMES)
def test_the_usual_level_has_things_within_its_length_and_lanes(game: str) -> None:
    level = describe_level(game, {}, 1)
    assert level.name
    assert level.items
    assert level.level
    assert all(0.0 <= item.time_s <= level.length_s for item in level.items)
    assert all(-0.5 <= item.lane <= len(level.lanes) - 0.5 for item in level.items)
    steps = [later - earlier for earlier, later in pairwise(level.beats_s)]
    assert min(steps) > 0.0


def test_a_level_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match="option 'level': got 'no such level'"):
        describe_level("beats", {"level": "no such level"}, 1)
    with pytest.raises(ValueError, match="game: got 'sample', expected a game with levels"):
        describe_level("sample", {}, 1)
