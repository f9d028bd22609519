"""Users and apps in lockstep: observation, reward, ends of episodes, saved states."""

from contextlib import closing

import numpy as np
import pytest

from sim2vr_harness.client.frames import pose_to_app
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


def test_observations_are_fresh_arrays() -> None:
    simulation = Simulation(CONFIG, 1)
    simulation.reset(seeds=[1])
    kept = simulation.observation()
    copies = {key: value.copy() for key, value in kept.items()}
    simulation.step(actions(1, 0))
    for key, value in kept.items():
        np.testing.assert_array_equal(value, copies[key])
    simulation.close()


def test_an_episode_depends_on_its_seed_only() -> None:
    alone = Simulation(CONFIG, 1)
    alone.reset(seeds=[5])
    expected = trace(alone, 12)
    for n, threads in ((3, 1), (2, 2)):
        together = Simulation(CONFIG.model_copy(update={"cores": threads}), n)
        together.reset(seeds=[5, *range(100, 99 + n)])
        assert trace(together, 12) == expected
        together.close()
    alone.reset(seeds=[6])
    assert trace(alone, 12) != expected
    alone.close()


def test_save_and_load_mid_episode() -> None:
    one, two = Simulation(CONFIG, 2), Simulation(CONFIG, 2)
    one.reset(seeds=[1, 2])
    trace(one, 10)
    saved, logs = one.state_dict(), [one.logs[i] for i in range(2)]
    rest = trace(one, 15, start=10)
    two.load_state_dict(saved)
    assert logs[0] != logs[1]
    assert [two.logs[i] for i in range(2)] == logs
    assert trace(two, 15, start=10) == rest
    one.reset()
    with pytest.raises(ValueError, match="2 users, expected 1"):
        Simulation(CONFIG, 1).load_state_dict(saved)
    with pytest.raises(ValueError, match=r"plain data|other bytes"):
        import pickle

        two.load_state_dict({"simulation": np.frombuffer(pickle.dumps(print), np.uint8)})
    one.close()
    two.close()


def test_the_app_gets_the_poses_of_the_end_of_the_step(tmp_path) -> None:
    simulation = Simulation(CONFIG, 1, log_dir=tmp_path)
    simulation.reset(seeds=[3])
    for step in range(5):
        simulation.step(actions(1, step))
    position, rotation = simulation.users.device_poses("controller_right")
    expected = pose_to_app(position, rotation)[0]
    simulation.close()
    states = next(tmp_path.rglob("states.csv")).read_text().splitlines()
    header = [name.strip() for name in states[1].split(",")]
    last = states[-1].split(",")
    column = header.index("right_pos_x") if "right_pos_x" in header else 8
    np.testing.assert_allclose(
        [float(x) for x in last[column : column + 3]], expected[:3], atol=2e-6
    )


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


def test_a_round_of_two_seconds_ends_after_it() -> None:
    config = EnvConfig(
        app=AppConfig(options={"condition": "easy", "round_seconds": 2.0}, renderer="null")
    )
    simulation = Simulation(config, 1)
    simulation.reset(seeds=[1])
    steps = 0
    while True:
        batch = simulation.step(np.zeros((1, 32)))
        steps += 1
        if batch.terminated[0]:
            break
    # The first frame with t > 2 s at 20 Hz.
    assert steps == 41
    assert batch.infos[0]["termination"] == "finished"
    assert batch.infos[0]["max_fatigued"] > 0.0
    with pytest.raises(RuntimeError, match="reset them first"):
        simulation.step(np.zeros((1, 32)))
    simulation.close()


def test_time_limit_truncates() -> None:
    config = EnvConfig(max_episode_seconds=0.5, app=AppConfig(renderer="null"))
    simulation = Simulation(config, 1)
    simulation.reset(seeds=[1])
    ends = [simulation.step(np.zeros((1, 32))) for _ in range(10)]
    assert [bool(batch.truncated[0]) for batch in ends] == [False] * 9 + [True]
    assert not ends[-1].terminated[0]
    assert ends[-1].infos[0]["termination"] == "max_steps_reached"
    simulation.close()


def test_a_diverged_user_ends_on_its_last_finite_observation(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own log there
    simulation = Simulation(EnvConfig(app=AppConfig(renderer="null")), 2)
    simulation.reset(seeds=[1, 2])
    simulation.step(actions(2, 0))
    before = simulation.observation()
    simulation.users._physics.qvel[0, :] = 1e12
    batch = simulation.step(actions(2, 1))
    assert batch.terminated.tolist() == [True, False]
    assert batch.infos[0]["termination"] == "diverged"
    assert np.isfinite(batch.reward).all()
    after = simulation.observation()
    for key in after:
        np.testing.assert_array_equal(after[key][0], before[key][0])
    simulation.reset(ids=[0])
    assert np.isfinite(simulation.step(actions(2, 2)).reward).all()
    simulation.close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"app": {"options": {"condition": "meduim"}}}, "did you mean 'medium'"),
        ({"app": {"game": "wackamole"}}, "did you mean 'whacamole'"),
        ({"user": {"model": "mobl_arms"}}, "mobl_arms_wrist"),
        ({"action_frequency_hz": 30}, "action_frequency_hz: got 30, expected a divisor of 500"),
    ],
)
def test_wrong_settings_are_named(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Simulation(EnvConfig(**change))


def test_nan_action_and_closed_simulation() -> None:
    simulation = Simulation(EnvConfig(app=AppConfig(renderer="null")), 1)
    simulation.reset(seeds=[1])
    bad = np.zeros((1, 32))
    bad[0, 3] = np.nan
    with pytest.raises(ValueError, match=r"action\[0, 3\] \(SUPSP\): got nan"):
        simulation.step(bad)
    simulation.step(np.zeros((1, 32)))
    simulation.close()
    with pytest.raises(RuntimeError, match="closed"):
        simulation.step(np.zeros((1, 32)))


def test_a_diverged_user_keeps_its_last_log_and_picture() -> None:
    simulation = Simulation(CONFIG, 2)
    simulation.reset(seeds=[1, 2])
    trace(simulation, 10)
    before, log = simulation.observation(), simulation.step(actions(2, 10)).logs[0]
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
    for key in ("vision", "stateful_information"):
        np.testing.assert_array_equal(after[key][0], before[key][0])
        assert key == "stateful_information" or not np.array_equal(after[key][1], before[key][1])
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


def test_what_an_app_refuses_while_bodies_move_is_raised(monkeypatch) -> None:
    with closing(Simulation(CONFIG, 4)) as simulation:
        simulation._apps.shares = (0.5, 0.5)
        simulation.reset()
        simulation._group._batch.close()
        with pytest.raises(RuntimeError, match="closed"):
            simulation.step(np.zeros((4, 32)))
