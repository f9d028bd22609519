"""Users who are people: who plays an episode, what it is told, and what it perceives when."""

from typing import Any

import numpy as np
import pytest

from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation
from sim2vr_harness.users import PeopleSettings, Population

SENSES = [
    {"sense": "vision", "delay_ms": "person"},
    {"sense": "proprioception", "delay_ms": "person"},
    {"sense": "person"},
]


def config(people: dict[str, Any] | None = None, **changes: Any) -> EnvConfig:
    return EnvConfig(
        **{
            "app": AppConfig(options={"condition": "medium"}),
            "user": {"people": {} if people is None else people},
            "vision": {"width": 24, "height": 16},
            "frames_per_step": 5,
            "senses": SENSES,
            **changes,
        }
    )


def actions(step: int, n: int = 1) -> np.ndarray:
    return np.tile(np.random.default_rng(step).uniform(-1, 1, 32), (n, 1))


def test_every_episode_is_somebody_s_whatever_the_batch() -> None:
    one, three = Simulation(config(), 1), Simulation(config(), 3)
    started = three.reset(seeds=[1, 2, 3])
    (alone,) = one.reset(seeds=[2])
    assert alone == started[1]
    assert len({info["person"]["index"] for info in started}) == 3
    people = Population(PeopleSettings())
    assert three.users.persons[1] == people.number(alone["person"]["index"])
    np.testing.assert_array_equal(
        three.person_features, [one.features for one in three.users.persons]
    )
    for step in range(4):
        one.step(actions(step))
        three.step(actions(step, 3))
        for key, value in one.observation().items():
            np.testing.assert_array_equal(value[0], three.observation()[key][1])
    first = one.users.persons[0]
    one.reset()
    assert one.users.persons[0] != first
    one.close()
    three.close()


def test_a_simulation_goes_on_with_the_same_people() -> None:
    one, other = Simulation(config(), 2), Simulation(config(), 2)
    one.reset(seeds=[1, 2], persons=[7, None])
    assert one.users.persons[0] == Population(PeopleSettings()).number(7)
    other.reset(seeds=[5, 6])
    for step in range(3):
        one.step(actions(step, 2))
    other.load_state_dict(one.state_dict())
    assert other.users.persons == one.users.persons
    one.step(actions(9, 2))
    other.step(actions(9, 2))
    for key, value in one.observation().items():
        np.testing.assert_array_equal(value, other.observation()[key])
    again, state = other.state_dict(), one.state_dict()
    assert again["simulation"].tobytes() == state["simulation"].tobytes()
    one.close()
    other.close()


def test_own_delays_are_those_of_a_configuration_that_says_them() -> None:
    own = Simulation(config({"vary": ["visual_delay_s", "proprioceptive_delay_s"]}), 3)
    people = own.people
    assert people is not None
    numbers = {
        people.number(k).visual_delay_s: k for k in range(60)
    }  # 0.09, 0.10 and 0.11 s are all there
    assert len(numbers) == 3
    own.reset(seeds=[4, 4, 4], persons=list(numbers.values()))
    for i, person in enumerate(own.users.persons):
        own.reset(seeds=[4, 4, 4], persons=list(numbers.values()))
        senses = [
            {"sense": "vision", "delay_ms": round(1000 * person.visual_delay_s)},
            {"sense": "proprioception", "delay_ms": round(1000 * person.proprioceptive_delay_s)},
        ]
        said = Simulation(config(user={}, senses=senses), 1)
        said.reset(seeds=[4])
        for step in range(5):
            own.step(actions(step, 3))
            said.step(actions(step))
            for key, value in said.observation().items():
                np.testing.assert_array_equal(own.observation()[key][i], value[0])
        said.close()
    own.close()


def test_what_cannot_be() -> None:
    with pytest.raises(ValueError, match=r"delay_ms: got 'person', expected user.people"):
        Simulation(config(user={}))
    with pytest.raises(ValueError, match=r"delay_ms: got 'person', which vision, .* have"):
        Simulation(config(senses=[{"sense": "time", "delay_ms": "person"}]))
    with pytest.raises(ValueError, match=r"senses: got 'head', expected user.head: reflex"):
        Simulation(config(senses=[{"sense": "head"}]))
