"""What a configuration takes over of the game that it names."""

import pytest

from sim2vr_harness.envs.config import AppConfig, EnvConfig, UserConfig
from sim2vr_harness.envs.games import with_game, with_task


def of_game(game: str, **user: object) -> EnvConfig:
    return EnvConfig(app=AppConfig(game=game), user=UserConfig(**user))


@pytest.mark.parametrize(("game", "inputs"), [("panel", ("right.trigger",)), ("sample", ())])
def test_users_get_the_inputs_that_the_game_reads(game: str, inputs: tuple[str, ...]) -> None:
    assert with_task(of_game(game)).user.inputs == inputs
    assert with_game(EnvConfig(app=AppConfig(game="beats")), game).user.inputs == inputs


def test_inputs_that_a_configuration_names_stay() -> None:
    assert with_task(of_game("panel", inputs=())).user.inputs == ()
    assert with_task(of_game("panel", inputs=("right.a",))).user.inputs == ("right.a",)
