"""Options that a user names beside conditions that set them, too."""

from pathlib import Path
from typing import Any

import pytest
from fake_simulation import FakeSimulation

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import describe_game, facts_of_outside
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation.conditions import chosen_conditions, named_options
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.training_distribution import unpractised
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.tools.users import environment_of

BEATS = describe_game("beats")
WHACAMOLE = describe_game("whacamole")


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


@pytest.mark.parametrize(
    ("game", "names", "named", "message"),
    [
        (
            *("whacamole", ["medium"], {"condition": "hard"}),
            "--condition: got 'medium' together with env.app.options.condition=hard, "
            "which is 'hard', expected one of the two",
        ),
        (
            *("beats", ["first", "level", "full"], {"level": "my.dat"}),
            "--condition: got 'full' together with env.app.options.level=my.dat, "
            "which is 'level', expected one of the two",
        ),
    ],
)
def test_what_an_option_makes_another_condition_is_refused(
    game: str, names: list[str], named: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as refused:
        chosen_conditions(describe_game(game), names, named=named)
    assert str(refused.value) == message


def test_apps_that_publish_nothing() -> None:
    unknown = facts_of_outside("golf")
    (found,) = chosen_conditions(unknown, ["hole1"], named={"wind": 1.0})
    assert dict(found.options) == {"condition": "hole1"}
    (found,) = chosen_conditions(unknown, None, ["hole1"], {"condition": "hole2"})
    assert (found.name, dict(found.options)) == ("hole2", {"condition": "hole2"})
    with pytest.raises(InputError, match=r"got 'hole1' together with .*, which is 'hole2'"):
        chosen_conditions(unknown, ["hole1"], named={"condition": "hole2"})


def test_options_are_named_by_keys_mappings_and_settings() -> None:
    env = EnvConfig(app=AppConfig(game="beats", options={"level": "a", "end_on_miss": True}))
    assert named_options(env, []) == {}
    assert named_options(env, ["env.app.options.level=a"]) == {"level": "a"}
    assert named_options(env, ['env.app.options={"level": "a"}']) == {"level": "a"}
    assert named_options(env, [], {"options": {"end_on_miss": True}}) == {"end_on_miss": True}


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


def test_a_level_that_no_condition_has_was_never_practised() -> None:
    config = TrainingConfig.model_validate(
        {"env": {"app": {"game": "beats", "options": {"level": "full", "end_on_miss": False}}}}
    )
    for level, expected in (("generated", []), ("my.dat", ["level = my.dat (trained: full)"])):
        options = {"level": level, "end_on_miss": False}
        env = EnvConfig(app=AppConfig(game="beats", options=options))
        assert unpractised(config, ResolvedEnv(config.env), ResolvedEnv(env), ["full"]) == expected
