"""Many users as Gymnasium's vector environment."""

import copy

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from sim2vr_harness.envs import AppConfig, EnvConfig, Sim2VREnv, Sim2VRVectorEnv
from sim2vr_harness.envs.config import SenseConfig

# Enough for every user to end a round, and for some to end two.
CONFIG = EnvConfig(app=AppConfig(options={"condition": "medium", "round_seconds": 0.4}))
STEPS = 16
QUICK = (SenseConfig(sense="proprioception"), SenseConfig(sense="time"))


def actions(step: int) -> np.ndarray:
    return np.random.default_rng(step).uniform(-1, 1, (3, 32)).astype(np.float32)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_it_plays_as_gymnasiums_own_vector_of_single_environments(mode: AutoresetMode) -> None:
    together = Sim2VRVectorEnv(3, config=CONFIG, autoreset_mode=mode.value)
    apart = SyncVectorEnv([lambda: Sim2VREnv(config=CONFIG)] * 3, autoreset_mode=mode)
    assert together.metadata["autoreset_mode"] == apart.metadata["autoreset_mode"]
    assert together.single_observation_space == apart.single_observation_space
    assert together.action_space == apart.action_space
    one, other = together.reset(seed=5)[0], apart.reset(seed=5)[0]
    # Ends at different times, so that some play while others start anew.
    late = {"reset_mask": np.array([False, True, False])}
    for step in range(3):
        together.step(actions(step))
        apart.step(actions(step))
    one, other = together.reset(seed=9, options=dict(late))[0], apart.reset(seed=9, options=late)[0]
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
        ended = np.flatnonzero(ours[1] | ours[2])
        ends += len(ended)
        if mode == AutoresetMode.SAME_STEP:
            for i in ended:
                for key, value in expected["final_obs"][i].items():
                    np.testing.assert_array_equal(infos["final_obs"][i][key], value)
        last, wanted = infos.get("final_info", infos), expected.get("final_info", expected)
        for i in ended:
            assert last["termination"][i] == wanted["termination"][i] == "finished"
            assert last["log"]["Misses"][i] == wanted["log"]["Misses"][i]
        if mode == AutoresetMode.DISABLED and len(ended):
            mask = ours[1] | ours[2]
            one = together.reset(options={"reset_mask": mask})[0]
            other = apart.reset(options={"reset_mask": mask})[0]
    assert ends >= 4
    together.close()
    apart.close()


def test_it_draws_everybody_and_can_be_copied() -> None:
    env = gymnasium.make_vec(
        "sim2vr/WhacAMole-v0", num_envs=2, render_mode="headset", autoreset_mode="NextStep"
    )
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    assert env.metadata["render_fps"] == 20
    env.reset(seed=1)
    other = copy.deepcopy(env)
    for step in range(2):
        seen, *_ = env.step(actions(step)[:2])
        again, *_ = other.step(actions(step)[:2])
        for key, value in seen.items():
            np.testing.assert_array_equal(again[key], value)
    pictures = env.render()
    assert [picture.shape for picture in pictures] == [(480, 640, 3)] * 2
    assert (pictures[0] != pictures[1]).any()
    np.testing.assert_array_equal(other.render(), pictures)
    env.close()
    other.close()
    with pytest.raises(ValueError, match="render_mode: got 'human', expected one of"):
        Sim2VRVectorEnv(1, render_mode="human")
    with pytest.raises(ValueError, match="autoreset_mode: got 'later', expected one of"):
        Sim2VRVectorEnv(1, autoreset_mode="later")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": [1]}, "seeds: got 1 seeds, expected 3, one per user"),
        ({"seed": [1, 2, -3]}, "seed: got -3, expected an integer of 0 or above"),
        ({"options": [1]}, r"options: got \[1\], expected names of options and values"),
        ({"options": {"round_seconds": "x"}}, "option 'round_seconds': got \"x\", expected a num"),
        ({"options": {"reset_mask": [1, 0, 1]}}, r"reset_mask: got int64 \(3,\), expected bool"),
    ],
)
def test_a_refused_reset_leaves_the_rounds_as_they_were(
    arguments: dict[str, object], message: str
) -> None:
    config = CONFIG.model_copy(update={"senses": QUICK})
    env, other = Sim2VRVectorEnv(3, config=config), Sim2VRVectorEnv(3, config=config)
    for each in (env, other):
        each.reset(seed=np.int64(5))
        each.step(actions(0))
    with pytest.raises(ValueError, match=message):
        env.reset(**arguments)  # type: ignore[arg-type]
    for step in range(1, 3):
        one, reward, *_ = env.step(actions(step))
        two, expected, *_ = other.step(actions(step))
        np.testing.assert_array_equal(one["proprioception"], two["proprioception"])
        np.testing.assert_array_equal(reward, expected)
    # Streams of seeds are where they were, too.
    np.testing.assert_array_equal(
        env.reset()[0]["proprioception"], other.reset()[0]["proprioception"]
    )
    env.close()
    other.close()
