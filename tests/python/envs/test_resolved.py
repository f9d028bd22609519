"""A configuration is resolved once, and only when it is asked for."""

import pickle
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs import resolved
from sim2vr_harness.envs.config import EnvConfig, UserConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.users import Physique


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


def test_a_configuration_is_checked_without_a_body(loads: list[str]) -> None:
    config = TrainingConfig(env={"user": {"model": "mobl_arms_bimanual", "people": {"seed": 1}}})
    ResolvedEnv(config.env)
    assert loads == []


def test_all_that_follows_shares_one_body(loads: list[str]) -> None:
    env = ResolvedEnv(EnvConfig())
    # The arm of Saul et al. (2015): 32 muscles; the sample needs a right controller.
    assert env.action_space.shape == (32,)
    assert len(env.contract["muscles"]) == 32
    assert {*env.contract["observation"]} == {*env.observation_space.spaces}
    assert env.with_hand() is env
    assert env.people is None
    assert loads == ["mobl_arms_wrist"]


def test_a_shipped_user_needs_one_body(loads: list[str]) -> None:
    user = find_user("pretrained:whacamole_constrained")
    assert user.env.action_space.shape == (user.env.body.action_size,)
    assert len(loads) == 1


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


@pytest.mark.parametrize("inputs", [(), ("right.a",)])
def test_inputs_that_a_configuration_names_stay(inputs: tuple[str, ...]) -> None:
    env = ResolvedEnv(EnvConfig(app={"game": "panel"}, user={"inputs": inputs}))
    assert env.with_task().config.user.inputs == inputs


def test_a_simulation_has_the_spaces_that_were_foretold(loads: list[str]) -> None:
    env = ResolvedEnv(EnvConfig())
    simulation = Simulation(env, 1)
    assert simulation.observation_space == env.observation_space
    assert simulation.action_space == env.action_space
    assert loads == [env.body.name]
    simulation.close()


def test_it_travels_as_its_configuration() -> None:
    env = ResolvedEnv(EnvConfig())
    env.body  # noqa: B018
    again = pickle.loads(pickle.dumps(env))
    assert again == env
    assert "body" not in vars(again)


def test_a_person_cut_from_it_is_that_tall() -> None:
    env = ResolvedEnv.of_user(UserConfig())
    tall, short = (env.body_for(Physique(stature_m=metres)) for metres in (1.9, 1.6))
    upper_arms = [np.linalg.norm(one.physics_model.body("ulna").pos) for one in (tall, short)]
    assert upper_arms[0] / upper_arms[1] == pytest.approx(1.9 / 1.6)


def test_a_hand_without_a_controller_is_refused() -> None:
    env = ResolvedEnv(EnvConfig(app={"game": "sample"}))
    with pytest.raises(ValueError, match="expected controller_left, which sample"):
        env.require_worn("left")
    with pytest.raises((ValueError, InputError), match="whacamole"):
        ResolvedEnv(EnvConfig(app={"game": "whacamol"})).facts  # noqa: B018
