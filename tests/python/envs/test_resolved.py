"""A configuration is resolved once, and only when it is asked for."""

from typing import Any

import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs import resolved
from sim2vr_harness.envs.config import EnvConfig, UserConfig
from sim2vr_harness.envs.resolved import ResolvedEnv


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The models of the bodies that were built."""
    found: list[str] = []
    real = resolved.load_body

    def load_body(name: str, **options: Any) -> Any:
        found.append(name)
        return real(name, **options)

    monkeypatch.setattr(resolved, "load_body", load_body)
    return found


def test_what_a_change_leaves_is_not_made_again(loads: list[str]) -> None:
    env = ResolvedEnv(EnvConfig(app={"game": "sample"}))
    assert env.facts.name == "sample" and env.body.name == "mobl_arms_wrist"
    faster = env.changed(
        action_frequency_hz=10.0, user=UserConfig(model="mobl_arms_wrist", people={"seed": 4})
    )
    assert faster.body is env.body and faster.facts is env.facts
    assert faster.config.user.people.seed == 4 and env.people is None
    assert env.with_options({"level": 1}).facts is env.facts
    other = faster.with_game("whacamole")
    assert other.body is env.body and other.facts.name == "whacamole"
    assert loads == ["mobl_arms_wrist"]
    still = faster.changed(user=UserConfig(model="mobl_arms_bimanual"))
    assert still.body.name == "mobl_arms_bimanual" and still.facts is env.facts


@pytest.mark.parametrize(("game", "inputs"), [("panel", ("right.trigger",)), ("sample", ())])
def test_users_get_the_inputs_that_the_game_reads(game: str, inputs: tuple[str, ...]) -> None:
    env, beats = (ResolvedEnv(EnvConfig(app={"game": name})) for name in (game, "beats"))
    assert env.with_task().config.user.inputs == inputs
    assert beats.with_game(game).config.user.inputs == inputs
    named = ResolvedEnv(EnvConfig(app={"game": game}, user={"inputs": ("right.a",)}))
    assert named.with_task().config.user.inputs == ("right.a",)  # as the configuration says


def test_a_hand_without_a_controller_is_refused() -> None:
    env = ResolvedEnv(EnvConfig(app={"game": "sample"}))
    with pytest.raises(ValueError, match="expected controller_left, which sample"):
        env.require_worn("left")
    with pytest.raises((ValueError, InputError), match="whacamole"):
        ResolvedEnv(EnvConfig(app={"game": "whacamol"})).facts  # noqa: B018
