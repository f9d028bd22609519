"""The Gymnasium face: registration, checkers, pictures."""

from __future__ import annotations

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check

import sim2vr_harness.envs as envs

WHACAMOLE_ID = "sim2vr/WhacAMole-v0"


@pytest.fixture
def env():
    env = gymnasium.make(WHACAMOLE_ID, condition="medium")
    yield env
    env.close()


def test_passes_gymnasiums_checker_without_warnings(env) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gymnasium_check(env.unwrapped, skip_render_check=True)


def test_passes_stable_baselines3s_checker_without_warnings(env) -> None:
    check_env = pytest.importorskip("stable_baselines3.common.env_checker").check_env
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, warn=True, skip_render_check=True)


def test_spaces(env) -> None:
    assert env.action_space.shape == (32,)
    assert env.observation_space["vision"].shape == (2, 80, 120)
    assert env.observation_space["vision"].dtype == np.uint8
    assert env.observation_space["proprioception"].shape == (56,)
    assert env.observation_space["stateful_information"].shape == (1,)


def test_a_seed_fixes_the_episodes_that_follow(env) -> None:
    def two_episodes() -> list[bytes]:
        first = env.reset(seed=11)[0]["proprioception"].tobytes()
        return [first, env.reset()[0]["proprioception"].tobytes()]

    first, second = two_episodes()
    assert first != second
    assert two_episodes() == [first, second]


def test_reset_options_change_the_condition(env) -> None:
    env.reset(seed=1, options={"condition": "low"})
    low = env.reset(seed=1)[0]["vision"]
    high = env.reset(seed=1, options={"condition": "high"})[0]["vision"]
    assert (low != high).mean() > 0.1
    with pytest.raises(ValueError, match="did you mean 'high'"):
        env.reset(options={"condition": "hihg"})


@pytest.mark.parametrize("mode", ["rgb_array", "headset", "body"])
def test_renders_pictures(mode: str) -> None:
    env = envs.Sim2VREnv(condition="medium", render_mode=mode)
    env.reset(seed=1)
    env.step(np.zeros(32, dtype=np.float32))
    picture = env.render()
    assert picture.shape == (480, 640, 3)
    assert picture.dtype == np.uint8
    assert picture.std() > 5.0
    env.close()
    with pytest.raises(ValueError, match="render_mode: got 'human'"):
        envs.Sim2VREnv(render_mode="human")


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium, sim2vr_harness.envs; e = gymnasium.make('sim2vr/WhacAMole-v0')",
        "import gymnasium; e = gymnasium.make('sim2vr_harness.envs:sim2vr/WhacAMole-v0')",
    ],
)
def test_make_finds_the_id_in_a_fresh_interpreter(code: str) -> None:
    code += "; print(e.reset(seed=0)[0]['vision'].shape); e.close()"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "(2, 80, 120)"
