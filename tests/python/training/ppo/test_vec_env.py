import numpy as np
import pytest
from fake_simulation import FakeSimulation
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv


def make(n: int = 4, seed: int = 1) -> SimulationVecEnv:
    env = SimulationVecEnv(FakeSimulation(n=n))
    env.seed(seed)
    return env


def play(env: SimulationVecEnv, steps: int, seed: int = 0) -> list[tuple]:
    rng = np.random.default_rng(seed)
    return [env.step(rng.uniform(-1, 1, (env.num_envs, 3))) for _ in range(steps)]


def test_episodes_end_with_their_sums_and_start_anew() -> None:
    env = make()
    assert isinstance(env, VecEnv)
    env.reset()
    rewards = np.zeros(4)
    lengths = np.zeros(4, int)
    seen = set()
    for observation, reward, dones, infos in play(env, 40):
        rewards += reward
        lengths += 1
        for i in np.flatnonzero(dones):
            episode = infos[i]["episode"]
            assert episode["l"] == lengths[i]
            assert episode["r"] == pytest.approx(rewards[i], abs=1e-5)
            assert episode["r"] == pytest.approx(episode["game_reward"] - episode["effort_cost"])
            assert episode["log"]["Points"] + episode["log"]["Misses"] == lengths[i]
            assert episode["max_fatigued"] == 0.25
            # The fake shows its step number: the old episode's last, the new one's first.
            assert infos[i]["terminal_observation"]["proprioception"][3] == lengths[i]
            assert observation["proprioception"][i, 3] == 0
            assert infos[i]["TimeLimit.truncated"] == (lengths[i] == 8)
            seen.add((int(lengths[i]), infos[i]["TimeLimit.truncated"]))
            rewards[i] = lengths[i] = 0
        for i in np.flatnonzero(~dones):
            assert "episode" not in infos[i]
    assert (8, True) in seen
    assert (6, False) in seen


def test_seeds_fix_everything_and_are_not_counted_up() -> None:
    first, second, other = make(seed=5), make(seed=5), make(seed=6)
    a, b, c = first.reset(), second.reset(), other.reset()
    assert np.array_equal(a["vision"], b["vision"])
    assert not np.array_equal(a["vision"], c["vision"])
    seeds = first.seed(5)
    assert seeds == second.seed(5)
    assert len(set(seeds)) == 4
    assert min(seeds) > 1000


def test_saved_state_continues_mid_episode() -> None:
    env = make()
    env.reset()
    play(env, 5)
    state = env.state_dict()
    expected = play(env, 20, seed=3)
    other = make(seed=99)
    other.reset()
    other.load_state_dict(state)
    for (o1, r1, d1, i1), (o2, r2, d2, i2) in zip(expected, play(other, 20, seed=3), strict=True):
        assert np.array_equal(r1, r2)
        assert np.array_equal(d1, d2)
        assert all(np.array_equal(o1[key], o2[key]) for key in o1)
        for one, two in zip(i1, i2, strict=True):
            assert one.get("episode", {}).get("r") == two.get("episode", {}).get("r")
            assert one.get("episode", {}).get("l") == two.get("episode", {}).get("l")
    with pytest.raises(RuntimeError, match="of 4 users, not of 2"):
        make(n=2).load_state_dict(state)


def test_questions_to_single_environments() -> None:
    env = make()
    assert env.get_attr("render_mode") == [None] * 4
    assert env.get_attr("renderer_description", indices=[0, 2]) == ["fake", "fake"]
    assert env.env_is_wrapped(Monitor) == [False] * 4
    pictures = env.env_method("render_headset", 6, 4, indices=[1, 3])
    assert [picture.shape for picture in pictures] == [(4, 6, 4), (4, 6, 4)]
    assert [picture[0, 0, 0] for picture in pictures] == [41, 43]
    with pytest.raises(NotImplementedError, match="cannot set 'weight'"):
        env.set_attr("weight", 1)
    with pytest.raises(AttributeError):
        env.get_attr("nothing")
    env.close()
    assert env.simulation.closed


def test_actions_are_taken_when_they_are_given() -> None:
    env, other = make(), make()
    env.reset(), other.reset()
    actions = np.full((4, 3), 0.5)
    env.step_async(actions)
    actions[:] = -0.5
    observation, *_ = env.step_wait()
    expected, *_ = other.step(np.full((4, 3), 0.5))
    assert np.array_equal(observation["proprioception"], expected["proprioception"])
    with pytest.raises(RuntimeError, match="step_wait was called without step_async"):
        env.step_wait()


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros((3, 3)), r"actions: got float64 \(3, 3\), expected real numbers \(4, 3\)"),
        (np.zeros((4, 3), complex), r"actions: got complex128 \(4, 3\), expected real numbers"),
        (np.zeros((4, 3), object), "actions: got object"),
        (None, r"actions: got object \(\)"),
    ],
)
def test_wrong_actions_are_refused_at_once(actions: object, message: str) -> None:
    env = make()
    env.reset()
    with pytest.raises(ValueError, match=message):
        env.step_async(actions)
    with pytest.raises(RuntimeError, match="without step_async"):
        env.step_wait()


def test_options_hold_from_the_next_round_on() -> None:
    env, plain = make(), make()
    env.set_options({"condition": "hard"})
    assert np.array_equal(env.reset()["vision"], plain.reset()["vision"])
    assert env.simulation.conditions == ["hard"] * 4
    env.reset()
    assert env.simulation.conditions == ["hard"] * 4
    env.seed(1), plain.seed(1)
    env.set_options([{"condition": "easy"}, {}, {"condition": "easy"}, {"condition": "medium"}])
    assert np.array_equal(env.reset()["vision"], plain.reset()["vision"])
    assert env.simulation.conditions == ["easy", "hard", "easy", "medium"]
    env.set_options({"condition": "none"})
    with pytest.raises(ValueError, match="condition: got 'none', expected easy, medium or hard"):
        env.reset()
    env.reset()
    with pytest.raises(ValueError, match="options: got 2, expected 4, one per user"):
        env.set_options([{}, {}])
    with pytest.raises(ValueError, match=r"options: got 5, expected names of options and values"):
        env.set_options(5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("indices", "message"),
    [
        ([7], "indices: got 7, expected whole numbers 0 to 3"),
        (4, "indices: got 4, expected whole numbers 0 to 3"),
        ([-1], "indices: got -1, expected whole numbers 0 to 3"),
        ([True], "indices: got True, expected whole numbers 0 to 3"),
        ([1, 1], r"indices: got \[1, 1\], expected each user at most once"),
        ("0", "indices: got '0', expected whole numbers 0 to 3"),
        (1.0, r"indices: got 1\.0, expected whole numbers 0 to 3"),
    ],
)
def test_users_that_there_are_not(indices: object, message: str) -> None:
    env = make()
    for ask in (
        lambda: env.get_attr("renderer_description", indices),
        lambda: env.get_attr("render_mode", indices),
        lambda: env.set_attr("weight", 1, indices),
        lambda: env.env_method("render_headset", 6, 4, indices=indices),
        lambda: env.env_is_wrapped(Monitor, indices),
    ):
        with pytest.raises(ValueError, match=message):
            ask()
    assert env.get_attr("renderer_description", np.array([3, 1])) == ["fake", "fake"]


def test_seeds_that_are_none() -> None:
    env = make()
    for seed in (-1, 1.5, "1", True):
        with pytest.raises(ValueError, match=r"seed: got .*, expected an integer of 0 or above"):
            env.seed(seed)  # type: ignore[arg-type]
