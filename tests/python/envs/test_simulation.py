"""Users and apps in lockstep: observation, reward, ends of episodes, saved states."""

from contextlib import closing

import numpy as np
import pytest

from sim2vr_harness.envs import AppConfig, EffortConfig, EnvConfig, Simulation, UserConfig

CONFIG = EnvConfig(app=AppConfig(options={"condition": "medium"}))


def actions(n: int, step: int) -> np.ndarray:
    return np.random.default_rng(step).uniform(-1, 1, (n, 32))


def trace(simulation: Simulation, steps: int, start: int = 0) -> list[tuple[float, bytes]]:
    """(reward, observation bytes) of user 0, whose actions do not depend on N."""
    rows = []
    for step in range(start, start + steps):
        batch = simulation.step(np.repeat(actions(1, step), simulation.n, axis=0))
        observation = simulation.observation()
        rows.append(
            (float(batch.reward[0]), b"".join(observation[k][0].tobytes() for k in observation))
        )
    return rows


def test_first_observation_shows_the_game() -> None:
    simulation = Simulation(CONFIG, 2)
    simulation.reset(seeds=[1, 2])
    observation = simulation.observation()
    assert {k: v.shape for k, v in observation.items()} == {
        "vision": (2, 2, 80, 120),
        "proprioception": (2, 56),
        "stateful_information": (2, 1),
    }
    assert np.ptp(observation["vision"][0, 0]) > 50
    image = simulation.apps[1].image
    np.testing.assert_array_equal(observation["vision"][1], image[..., [1, 3]].transpose(2, 0, 1))
    simulation.close()


def test_effort_is_subtracted() -> None:
    free = EnvConfig(user=UserConfig(effort=EffortConfig(model="zero")))
    costly, without = Simulation(EnvConfig(), 1), Simulation(free, 1)
    for simulation in (costly, without):
        simulation.reset(seeds=[4])
    for step in range(5):
        a, b = costly.step(actions(1, step)), without.step(actions(1, step))
        assert a.infos[0]["game_reward"] == b.infos[0]["game_reward"]
        assert a.infos[0]["effort_cost"] > 0.0
        assert b.infos[0]["effort_cost"] == 0.0
        np.testing.assert_allclose(b.reward - a.reward, a.infos[0]["effort_cost"])
    costly.close()
    without.close()


def test_time_limit_truncates() -> None:
    config = EnvConfig(max_episode_seconds=0.5, app=AppConfig(renderer="null"))
    simulation = Simulation(config, 1)
    simulation.reset(seeds=[1])
    ends = [simulation.step(np.zeros((1, 32))) for _ in range(10)]
    assert [bool(batch.truncated[0]) for batch in ends] == [False] * 9 + [True]
    assert not ends[-1].terminated[0]
    assert ends[-1].infos[0]["termination"] == "max_steps_reached"
    simulation.close()


def test_nan_action_and_closed_simulation() -> None:
    simulation = Simulation(EnvConfig(app=AppConfig(renderer="null")), 1)
    simulation.reset(seeds=[1])
    bad = np.zeros((1, 32))
    bad[0, 3] = np.nan
    with pytest.raises(ValueError, match=r"action\[0, 3\] \(SUPSP\): got nan"):
        simulation.step(bad)
    simulation.step(np.zeros((1, 32)))
    two = Simulation(CONFIG, 2)
    two.reset(seeds=[1, 2])
    with pytest.raises(ValueError, match="2 users, expected 1"):
        simulation.load_state_dict(two.state_dict())
    simulation.close()
    with pytest.raises(RuntimeError, match="closed"):
        simulation.step(np.zeros((1, 32)))


def test_a_diverged_user_keeps_its_last_log_and_picture() -> None:
    simulation = Simulation(CONFIG, 2)
    simulation.reset(seeds=[1, 2])
    trace(simulation, 10)
    log = simulation.step(actions(2, 10)).logs[0]
    before = simulation.observation()
    simulation.users._physics.qvel[0] = 1e9
    batch = simulation.step(actions(2, 11))
    assert batch.terminated.tolist() == [True, False]
    assert batch.answered.tolist() == [False, True]
    assert batch.infos[0]["termination"] == "diverged"
    assert "log" not in batch.infos[0]
    assert batch.reward[0] == 0.0
    assert batch.logs[0] == log
    after = simulation.observation()
    for key, rows in after.items():
        np.testing.assert_array_equal(rows[0], before[key][0])
    assert not np.array_equal(after["vision"][1], before["vision"][1])
    simulation.reset(ids=[0])
    assert np.isfinite(simulation.step(actions(2, 2)).reward).all()
    simulation.close()


def _lived(shares: tuple[float, ...], broken: int | None) -> list[np.ndarray]:
    """What five users go through in twelve steps; one of them breaks in the seventh."""
    config = CONFIG.model_copy(update={"cores": 2, "frames_per_step": 5})
    seen: list[np.ndarray] = []
    with closing(Simulation(config, 5)) as simulation:
        simulation._apps.shares = shares
        simulation.reset(seeds=list(range(5)))
        for step in range(12):
            if step == 6 and broken is not None:
                simulation.users._physics.qvel[broken] = 1e30
            resting = np.flatnonzero(simulation.over).tolist()
            outcome = simulation.step(actions(5, step), resting)
            seen += [outcome.reward, outcome.answered, outcome.terminated]
            seen += simulation.observation().values()
        seen.append(np.array([app.state_hash() for app in simulation.apps]))
        ended = [] if broken is None else [broken]
        assert np.flatnonzero(simulation.over).tolist() == ended
    return seen


@pytest.mark.parametrize("broken", [None, 3])
def test_apps_that_play_while_other_bodies_move_play_the_same(broken: int | None) -> None:
    whole = _lived((1.0,), broken)
    for shares in ((0.5, 0.25, 0.25), (0.1, 0.9)):
        for one, other in zip(_lived(shares, broken), whole, strict=True):
            np.testing.assert_array_equal(one, other)
