"""The Gymnasium face: registration, checkers, pictures, copies."""

import copy
import pickle
import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as stable_baselines3_check

import sim2vr_harness.envs as envs
from sim2vr_harness.client import list_games

WHACAMOLE_ID = "sim2vr/WhacAMole-v0"

ALL_OPTIONS = envs.EnvConfig(
    vision={"fovea": {"gaze": "moves"}},
    frames_per_step=5,
    senses=[
        {"sense": "vision", "delay_ms": 30, "noise": 0.02, "history_s": 0.1},
        {"sense": "proprioception", "delay_ms": 30, "noise": 0.01},
        {"sense": "time"},
        {"sense": "gaze"},
        {"sense": "fovea"},
    ],
)


@pytest.fixture
def env():
    env = gymnasium.make("sim2vr/WhacAMole-v0", condition="medium")
    yield env
    env.close()


@pytest.fixture(params=["default", "all options"])
def any_env(request: pytest.FixtureRequest):
    made = envs.Sim2VREnv(config=None if request.param == "default" else ALL_OPTIONS)
    yield made
    made.close()


def test_passes_the_checkers_without_warnings(any_env: envs.Sim2VREnv) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gymnasium_check(any_env, skip_render_check=True)
        stable_baselines3_check(any_env, warn=True, skip_render_check=True)


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


@pytest.mark.parametrize("mode", ["headset", "body"])
def test_renders_pictures(mode: str) -> None:
    env = envs.Sim2VREnv(condition="medium", render_mode=mode)
    env.reset(seed=1)
    env.step(np.zeros(32, dtype=np.float32))
    picture = env.render()
    assert picture.shape == (480, 640, 3)
    assert picture.dtype == np.uint8
    assert picture.std() > 5.0
    env.close()
    with pytest.raises(ValueError, match="render_mode: got 'humna', expected one of"):
        envs.Sim2VREnv(render_mode="humna")


def test_people_can_look_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with gymnasium.make(WHACAMOLE_ID, render_mode="human") as env:
        env.reset(seed=1)
        env.step(np.zeros(32, dtype=np.float32))
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    with envs.Sim2VREnv(render_mode="rgb_array") as other:
        other.reset(seed=1)
        other.step(np.zeros(32, dtype=np.float32))
        np.testing.assert_array_equal(shown, other.render())


def test_importing_the_package_registers_every_game_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, gymnasium, sim2vr_harness\n"
        "print(*sorted(id for id in gymnasium.registry if id.startswith('sim2vr/')))\n"
        "heavy = ('mujoco', 'torch', 'zmq', 'pydantic', 'stable_baselines3', 'matplotlib')\n"
        "print([name for name in sys.modules if name.split('.')[0] in heavy])\n"
    )
    ids, heavy = subprocess.check_output([sys.executable, "-c", code], text=True).splitlines()
    assert {"sim2vr/WhacAMole-v0", "sim2vr/Sample-v0"} <= set(ids.split())
    assert len(ids.split()) == len(list_games())
    assert heavy == "[]"


def play(env: Any, steps: int, start: int) -> list[bytes]:
    rows = []
    for step in range(start, start + steps):
        action = np.random.default_rng(step).uniform(-1, 1, env.action_space.shape)
        observation, reward, *_ = env.step(action.astype(np.float32))
        rows.append(
            np.float64(reward).tobytes() + b"".join(v.tobytes() for v in observation.values())
        )
    return rows


def test_copies_go_on_in_the_middle_of_a_round(any_env: envs.Sim2VREnv) -> None:
    any_env.reset(seed=3)
    any_env.action_space.seed(3)
    play(any_env, 6, 0)
    copies = [copy.deepcopy(any_env), pickle.loads(pickle.dumps(any_env))]
    expected = play(any_env, 6, 6)
    following = any_env.reset()[0]["proprioception"]
    sampled = any_env.action_space.sample()
    for other in copies:
        assert other.simulation is not any_env.simulation
        assert play(other, 6, 6) == expected
        np.testing.assert_array_equal(other.reset()[0]["proprioception"], following)
        np.testing.assert_array_equal(other.action_space.sample(), sampled)
        other.close()
    assert len(play(any_env, 1, 0)) == 1  # closing the copies has not closed it


def test_every_game_has_an_id_of_its_own() -> None:
    with gymnasium.make("sim2vr/Sample-v0", condition="small", render_mode="rgb_array") as env:
        app = env.unwrapped.simulation.config.app
        assert (app.game, app.options) == ("sample", {"ball_radius_m": 0.025})
        env.reset(seed=1)
        picture = env.render()
        assert picture.shape == (480, 640, 3)
        assert picture.std() > 5.0, "head, hand and ball from outside"
    with pytest.raises(ValueError, match=r"'smal', expected a condition of sample \(did you mean"):
        gymnasium.make("sim2vr/Sample-v0", condition="smal")


def test_a_game_for_two_hands_is_played_by_a_body_with_two_controllers() -> None:
    with gymnasium.make("sim2vr/Beats-v0") as env:
        simulation = env.unwrapped.simulation
        assert {"controller_left", "controller_right"} <= set(simulation.body.devices)
        assert simulation.body.muscles
        env.reset(seed=1)
        _, _, _, _, info = env.step(env.action_space.sample())
        assert info["log"]["Boxes"] == 4.0
    # A body that the configuration names stays, and says what it lacks.
    one_arm = envs.EnvConfig(user="mobl_arms_wrist")
    with pytest.raises(ValueError, match=r"wearing headset, controller_right, expected control"):
        gymnasium.make("sim2vr/Beats-v0", config=one_arm)
