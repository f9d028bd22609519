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
    with pytest.raises(ValueError, match=r"indices: got \[1, 1\], expected each user at most once"):
        env.get_attr("render_mode", [1, 1])
    with pytest.raises(ValueError, match=r"actions: got float64 \(3, 3\), expected real numbers"):
        env.step_async(np.zeros((3, 3)))
    env.close()
    assert env.simulation.closed


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
