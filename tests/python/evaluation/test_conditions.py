"""Options that a user names beside conditions that set them, too."""

from pathlib import Path
from typing import Any

import pytest
from fake_simulation import FakeSimulation

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import describe_game
from sim2vr_harness.evaluation.conditions import chosen_conditions
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.tools.users import environment_of

BEATS = describe_game("beats")


def test_a_named_option_wins_over_the_condition_s() -> None:
    (level,) = chosen_conditions(BEATS, ["level"], named={"level": "my.dat", "speed": 1.0})
    assert (level.name, dict(level.options)) == ("level", {"level": "my.dat", "end_on_miss": False})
    env = environment_of(
        "beats_level", condition="full", overrides=["env.app.options.level=my.dat"]
    )
    assert env.config.app.options["level"] == "my.dat"
    assert environment_of("beats_level", condition="full").config.app.options["level"] == "full"


@pytest.mark.parametrize(
    ("game", "usual", "named", "expected"),
    [
        ("beats", [], {}, ["first", "level", "full"]),
        ("beats", [], {"end_on_miss": False}, ["level", "full"]),
        ("beats", ["first"], {"level": "full"}, ["full"]),
        # Any condition has another level; the two without end_on_miss would be the same.
        ("beats", [], {"level": "my.dat"}, ["first", "level"]),
        ("pointing", [], {"depth_m": 0.45}, ["near"]),
        ("whacamole", ["easy", "medium"], {"condition": "hard"}, ["hard"]),
        ("whacamole", ["easy", "medium"], {"life_seconds": 0.5}, ["easy", "medium"]),
    ],
)
def test_without_a_condition_those_that_agree_are_played(
    game: str, usual: list[str], named: dict[str, Any], expected: list[str]
) -> None:
    found = chosen_conditions(describe_game(game), None, usual, named)
    assert [condition.name for condition in found] == expected
    for condition in found:
        assert named.items() & condition.options.items() == {
            (key, value) for key, value in named.items() if key in condition.options
        }


def test_an_evaluation_plays_and_records_the_named_option(trained: Path, tmp_path: Path) -> None:
    given: list[Any] = []

    class Recorded(FakeSimulation):
        def reset(self, ids=None, seeds=None, options=None):  # type: ignore[no-untyped-def]
            given.append(options)
            return super().reset(ids, seeds, options)

    hard = ["env.app.options.condition=hard"]
    request = Request(overrides=hard, episodes=1, out=tmp_path)
    found = evaluate(trained, request, simulation=Recorded)
    assert given == [{"condition": "hard"}] and list(found.summaries) == ["hard"]
    assert found.episodes["option_condition"].tolist() == ["hard"]
    with pytest.raises(InputError, match=r"'medium' together with .*condition=hard"):
        evaluate(trained, Request(conditions=["medium"], overrides=hard), simulation=Recorded)
