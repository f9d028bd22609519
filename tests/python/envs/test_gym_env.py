"""The Gymnasium face: registration, checkers, pictures, copies."""

import copy
import pickle
import subprocess
import sys
import types
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from gymnasium.utils.env_checker import check_env as gymnasium_check

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


def test_passes_gymnasiums_checker_without_warnings(any_env: envs.Sim2VREnv) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gymnasium_check(any_env, skip_render_check=True)


def test_passes_stable_baselines3s_checker_without_warnings(any_env: envs.Sim2VREnv) -> None:
    from stable_baselines3.common.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(any_env, warn=True, skip_render_check=True)


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


# --- pictures ---------------------------------------------------------------------------------


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
    with pytest.raises(ValueError, match="render_mode: got 'humna', expected one of"):
        envs.Sim2VREnv(render_mode="humna")


class FakePygame(types.ModuleType):
    """Writes down what is shown, and how quickly."""

    def __init__(self) -> None:
        super().__init__("pygame")
        self.shown: list[np.ndarray] = []
        self.ticks: list[int] = []
        self.closed = 0
        surface = types.SimpleNamespace(blit=lambda drawn, _at: self.shown.append(drawn))
        self.display = types.SimpleNamespace(
            init=lambda: None,
            set_caption=lambda _title: None,
            set_mode=lambda size: self.sizes.append(size) or surface,
            flip=lambda: None,
            quit=self._quit,
        )
        self.sizes: list[tuple[int, int]] = []
        self.time = types.SimpleNamespace(
            Clock=lambda: types.SimpleNamespace(tick=self.ticks.append)
        )
        self.surfarray = types.SimpleNamespace(make_surface=lambda columns: columns.swapaxes(0, 1))
        self.event = types.SimpleNamespace(pump=lambda: None)

    def _quit(self) -> None:
        self.closed += 1


def test_people_can_look_on(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = FakePygame()
    monkeypatch.setitem(sys.modules, "pygame", pygame)
    env = gymnasium.make(WHACAMOLE_ID, render_mode="human")
    env.reset(seed=1)
    env.step(np.zeros(32, dtype=np.float32))
    assert env.render() is None
    assert pygame.sizes == [(640, 480)]
    assert pygame.ticks == [20, 20]
    other = envs.Sim2VREnv(render_mode="rgb_array")
    other.reset(seed=1)
    np.testing.assert_array_equal(pygame.shown[0], other.render())
    assert (pygame.shown[1] != pygame.shown[0]).any()
    env.close()
    assert pygame.closed == 1
    other.close()


def test_a_window_without_pygame_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match=r"pip install sim2vr-harness\[video\]"):
        envs.Sim2VREnv(render_mode="human")


def test_gymnasium_records_videos(tmp_path) -> None:
    pytest.importorskip("moviepy", reason="extras: no moviepy")
    env = gymnasium.wrappers.RecordVideo(
        gymnasium.make(WHACAMOLE_ID, render_mode="rgb_array"), str(tmp_path), disable_logger=True
    )
    env.reset(seed=1)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    assert next(tmp_path.glob("*.mp4")).stat().st_size > 1000


# --- registration -----------------------------------------------------------------------------


def run(code: str) -> str:
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


def test_importing_the_package_registers_every_game_and_loads_nothing_heavy() -> None:
    out = run(
        "import sys, gymnasium, sim2vr_harness\n"
        "print(*sorted(id for id in gymnasium.registry if id.startswith('sim2vr/')))\n"
        "heavy = ('mujoco', 'torch', 'zmq', 'pydantic', 'stable_baselines3', 'matplotlib')\n"
        "print([name for name in sys.modules if name.split('.')[0] in heavy])\n"
        "print(*sorted(name for name in sys.modules if name.startswith('sim2vr_harness.')))"
    )
    ids, heavy, ours = out.splitlines()
    assert {"sim2vr/WhacAMole-v0", "sim2vr/Sample-v0"} <= set(ids.split())
    assert len(ids.split()) == len(list_games())
    assert heavy == "[]"
    assert ours.split() == [
        f"sim2vr_harness.{name}"
        for name in ("base", "base.errors", "base.file_lock", "base.files", "registration")
    ]


@pytest.mark.parametrize("name", ["WhacAMole", "Sample"])
def test_make_finds_the_ids_in_a_fresh_interpreter(name: str) -> None:
    code = (
        f"import gymnasium, sim2vr_harness; e = gymnasium.make('sim2vr/{name}-v0'); "
        "o, _ = e.reset(seed=0); print(o['vision'].shape, e.unwrapped.simulation.config.app.game)"
    )
    assert run(code) == f"(2, 80, 120) {name.lower()}"


# --- copies -----------------------------------------------------------------------------------


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


def test_what_was_never_reset_and_what_is_wrapped_can_be_copied_too() -> None:
    env = gymnasium.make(WHACAMOLE_ID, condition="hard", render_mode="rgb_array")
    fresh = copy.deepcopy(env)
    assert fresh.unwrapped.simulation.config.app.options["condition"] == "hard"
    seen = [one.reset(seed=4)[0]["vision"] for one in (env, fresh)]
    np.testing.assert_array_equal(*seen)
    env.close()
    later = pickle.loads(pickle.dumps(fresh))
    np.testing.assert_array_equal(later.render(), fresh.render())
    fresh.close()
    later.close()


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
