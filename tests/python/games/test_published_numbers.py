"""Published numbers of the games: found by condition, user and length of the round."""

import numpy as np
import pytest

from sim2vr_harness.games.published import published_of


def test_people_are_found_by_all_names_of_their_conditions() -> None:
    known = published_of("whacamole")
    easy = known.people_in("easy", "hits")
    assert len(easy) == 12 and np.mean(easy) == pytest.approx(68.25)  # of the released data
    assert len(known.people_in("hard-unconstrained", "hits")) == 6
    assert known.people_in("low-medium", "hit_rate") == known.people_in("low", "hit_rate") != []
    assert known.people_in("easy", "effort") == []
    grid = known.grid_of("high-medium", "cell_hit_rates")
    assert grid is not None and len(grid) == 9


def test_rounds_of_another_length_are_not_put_beside_counts() -> None:
    known = published_of("whacamole")
    assert known.beside_rounds_of(60.05) is known
    short = known.beside_rounds_of(20.0)
    assert short.people_in("easy", "hits") == [] and short.people_in("easy", "hit_rate") != []
    row = {"condition": "easy", "user": "whacamole_constrained"}
    assert (
        known.beside("hits", row) == {"published users": 105.0} and short.beside("hits", row) == {}
    )
    assert "20 s" in short.differences[0]


def test_published_users_are_found_by_their_settings() -> None:
    low = {"condition": "low-medium", "user": "whacamole_constrained"}
    assert published_of("whacamole").beside("max_fatigued", low) == {"paper, SIM_u": 0.232}
    other = low | {"user": "whacamole_adaptive_constrained"}
    assert published_of("whacamole").beside("max_fatigued", other) == {"paper, SIM_a": 0.266}
    beats = published_of("beats")
    first = {"condition": "first", "effort_weight": 0.05}
    assert list(beats.beside("correct_slices", first).values()) == [3.03]
    assert beats.beside("correct_slices", first | {"condition": "full"}) == {}
