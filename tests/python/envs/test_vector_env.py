"""Many users as Gymnasium's vector environment."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sim2vr_harness.envs
from sim2vr_harness.envs import AppConfig, EnvConfig, Sim2VREnv, Sim2VRVectorEnv

# Three steps more than a round, so that every user ends one.
CONFIG = EnvConfig(app=AppConfig(options={"condition": "medium", "round_seconds": 0.4}))
STEPS = 12


def actions(step: int) -> np.ndarray:
    return np.random.default_rng(step).uniform(-1, 1, (3, 32)).astype(np.float32)


def test_it_plays_as_gymnasiums_own_vector_of_single_environments() -> None:
    together = Sim2VRVectorEnv(3, config=CONFIG)
    apart = SyncVectorEnv(
        [lambda: Sim2VREnv(config=CONFIG)] * 3, autoreset_mode=AutoresetMode.SAME_STEP
    )
    assert together.metadata["autoreset_mode"] == apart.metadata["autoreset_mode"]
    assert together.single_observation_space == apart.single_observation_space
    assert together.action_space == apart.action_space
    one, other = together.reset(seed=5)[0], apart.reset(seed=5)[0]
    ends = 0
    for step in range(STEPS):
        assert one in together.observation_space
        for key in one:
            np.testing.assert_array_equal(one[key], other[key])
        one, *ours, infos = together.step(actions(step))
        other, *theirs, expected = apart.step(actions(step))
        for mine, its in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(mine, its)
        assert ("final_obs" in infos) == ("final_obs" in expected)
        for i in np.flatnonzero(infos.get("_final_obs", np.zeros(3, bool))):
            ends += 1
            for key, value in expected["final_obs"][i].items():
                np.testing.assert_array_equal(infos["final_obs"][i][key], value)
            last, wanted = infos["final_info"], expected["final_info"]
            assert last["termination"][i] == wanted["termination"][i] == "finished"
            assert last["log"]["Misses"][i] == wanted["log"]["Misses"][i]
    assert ends == 3
    together.close()
    apart.close()


def test_make_vec_makes_it() -> None:
    assert sim2vr_harness.envs.Sim2VRVectorEnv is Sim2VRVectorEnv
    env = gymnasium.make_vec("sim2vr/WhacAMole-v0", num_envs=2, condition="hard")
    assert isinstance(env.unwrapped, Sim2VRVectorEnv)
    assert env.unwrapped.simulation.config.app.options["condition"] == "hard"
    first, infos = env.reset(seed=[3, 4])
    assert infos["seed"].shape == (2,)
    again, _ = env.reset(options={"reset_mask": np.array([False, True])})
    np.testing.assert_array_equal(again["vision"][0], first["vision"][0])
    assert not np.array_equal(again["proprioception"][1], first["proprioception"][1])
    with pytest.raises(ValueError, match=r"reset_mask: got int64 \(1,\), expected bool \(2,\)"):
        env.reset(options={"reset_mask": np.array([1])})
    env.close()
