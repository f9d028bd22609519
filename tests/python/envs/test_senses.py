"""What users perceive in an app: every sense and wrapper end to end, saved, and in any batch."""

from contextlib import closing
from typing import Any

import numpy as np
import pytest
from fake_device_app import FakeDeviceApp

from sim2vr_harness.client import AppUnsupported, HapticPulse, SoundEvent
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig

SMALL = {"width": 24, "height": 16}
EVERYTHING: dict[str, Any] = {
    "vision": {**SMALL, "fovea": {"gaze": "moves", "width": 8, "height": 8}},
    "user": {"inputs": ["right.trigger", "right.a"]},
    "frames_per_step": 5,
    "senses": [
        {"sense": "vision", "delay_ms": 80, "noise": 0.02, "history_s": 0.1},
        {"sense": "proprioception", "delay_ms": 30, "noise": 0.01},
        {"sense": "time", "name": "clock", "delay_ms": 60},
        {"sense": "fingers"},
        {"sense": "gaze", "delay_ms": 20},
        {"sense": "fovea", "delay_ms": 50},
        {"sense": "fovea_depth"},
    ],
}


def actions(n: int, step: int, size: int = 32) -> np.ndarray:
    return np.random.default_rng(step).uniform(-1, 1, (n, size))


def config(**changes: Any) -> EnvConfig:
    app = {"options": {"condition": "medium"}, **changes.pop("app", {})}
    return EnvConfig(app=AppConfig(**app), **changes)


def with_fake_apps(settings: dict[str, Any], n: int = 1, **app: Any) -> tuple[Simulation, list]:
    apps: list[FakeDeviceApp] = []

    def make(_config: EnvConfig, _index: int, _log_dir: Any) -> Any:
        apps.append(FakeDeviceApp(**app))
        return apps[-1]

    vision = {"width": 8, "height": 8, **settings.pop("vision", {})}
    return Simulation(config(vision=vision, **settings), n, make_app=make), apps


def test_the_body_is_felt_as_it_was_30_ms_ago() -> None:
    late = Simulation(
        config(app={"renderer": "null"}, senses=[{"sense": "proprioception", "delay_ms": 30}]), 1
    )
    late.reset(seeds=[3])
    now = Simulation(config(app={"renderer": "null"}), 1)
    now.reset(seeds=[3])
    at_start = now.observation()["proprioception"]
    np.testing.assert_array_equal(late.observation()["proprioception"], at_start)
    for step in range(5):
        samples: list[np.ndarray] = []
        pause = {10: lambda seen=samples: seen.append(now.proprioception.observe(now.users))}
        now.users.step(actions(1, step), pauses=pause)  # 20 ms into the step
        late.step(actions(1, step))
        felt = late.observation()["proprioception"]
        np.testing.assert_array_equal(felt, samples[0])
        present = now.proprioception.observe(now.users)
        assert (felt != present).any()
        # What is felt lies between the two ends, not at one of them.
        np.testing.assert_allclose(felt[0, :7], present[0, :7], atol=0.5)
    late.close()
    now.close()


@pytest.mark.parametrize(
    ("frames", "delay_ms", "frame_of_step"),
    [(1, 30, lambda k: k - 1), (5, 80, lambda k: 5 * k - 8)],
)
def test_the_drawn_frame_is_the_one_of_then(
    frames: int, delay_ms: float, frame_of_step: Any
) -> None:
    simulation, _ = with_fake_apps(
        {"frames_per_step": frames, "senses": [{"sense": "vision", "delay_ms": delay_ms}]}
    )
    simulation.reset(seeds=[1])
    for step in range(1, 6):
        simulation.step(actions(1, step))
        assert simulation.observation()["vision"].max() == max(frame_of_step(step), 0)
    simulation.close()


def test_vibrations_and_sounds_reach_the_users_they_are_for() -> None:
    pulse, knock = HapticPulse("left", 0.5, 160.0, 0.06), SoundEvent("knock", (5.0, 1.2, 0.0), 1.0)
    simulation, apps = with_fake_apps(
        {"senses": [{"sense": "haptics"}, {"sense": "sound"}]},
        2,
        haptics={2: (pulse,)},
        sounds={2: (knock,)},
    )
    apps[1].haptics.clear()
    simulation.reset(seeds=[1, 2])
    felt, heard = [], []
    for step in range(4):
        simulation.step(actions(2, step))
        observation = simulation.observation()
        assert sorted(observation) == ["haptics", "sound"]
        felt.append(observation["haptics"][:, 0].tolist())
        heard.append(observation["sound"])
    assert felt == [[0, 0], [0.5, 0], [0.5, 0], [0.5, 0]]  # from 0.1 to 0.16 s
    assert [bool(loud.any()) for loud in heard] == [False, True, False, False]
    assert (heard[1][:, 1] > 2.5 * heard[1][:, 0]).all()  # 5 m to the right
    assert heard[1][0, 1] == pytest.approx(1.78 / 5.0, rel=0.05)
    simulation.close()


def test_what_an_app_cannot_do_is_said_by_name() -> None:
    cannot = frozenset({"save"})
    with pytest.raises(AppUnsupported, match="haptics"):
        with_fake_apps({"senses": [{"sense": "haptics"}]}, capabilities=cannot)
    with pytest.raises(AppUnsupported, match="two_eyes"):
        with_fake_apps({"vision": {"eyes": 2}}, capabilities=cannot, eyes=2)
    with pytest.raises(AppUnsupported, match="inputs"):
        with_fake_apps({"user": {"inputs": ["right.a"]}}, capabilities=cannot)
    with_fake_apps({}, capabilities=cannot)[0].close()


def trace(simulation: Simulation, steps: int, start: int = 0) -> list[bytes]:
    """Reward and observation of the last user, whose actions do not depend on N."""
    size, rows = simulation.action_space.shape[0], []
    for step in range(start, start + steps):
        batch = simulation.step(np.repeat(actions(1, step, size), simulation.n, axis=0))
        seen = simulation.observation()
        rows.append(batch.reward[-1].tobytes() + b"".join(v[-1].tobytes() for v in seen.values()))
    return rows


def test_all_senses_at_once_depend_on_the_seed_only_and_are_saved() -> None:
    alone = Simulation(config(**EVERYTHING), 1)
    assert alone.action_space.shape == (36,)  # 32 muscles, 2 inputs, 2 of the gaze
    assert {key: space.shape for key, space in alone.observation_space.items()} == {
        "vision": (4, 16, 24),
        "proprioception": (56,),
        "clock": (1,),
        "fingers": (2,),
        "gaze": (2,),
        "fovea": (2, 8, 8),
        "fovea_depth": (1, 8, 8),
    }
    alone.reset(seeds=[5])
    expected = trace(alone, 12)
    assert alone.observation_space.contains({k: v[0] for k, v in alone.observation().items()})
    together = Simulation(config(**EVERYTHING, cores=2), 3)
    together.reset(seeds=[1, 2, 5])
    assert trace(together, 12) == expected
    alone.reset(seeds=[6])
    assert trace(alone, 12) != expected
    together.reset(seeds=[1, 2, 5])
    trace(together, 5)
    state = together.state_dict()
    rest = trace(together, 7, start=5)
    assert rest == expected[5:]
    other = Simulation(config(**EVERYTHING), 3)
    other.load_state_dict(state)
    assert trace(other, 7, start=5) == rest
    for simulation in (alone, together, other):
        simulation.close()


def test_the_fovea_shows_what_the_picture_shows_in_detail_and_nothing_during_a_saccade() -> None:
    """Rays of both pictures are compared; depths of the headset's have steps of 10 m / 255."""
    names = ("vision", "fovea", "fovea_depth", "gaze")
    channels = ("red", "green", "blue", "depth")
    vision = VisionConfig(channels=channels, fovea={"gaze": "moves", "magnification": 6})
    assert 0.7 * vision.fovea_pixel_m <= 0.003
    with closing(Simulation(config(vision=vision, senses=[{"sense": n} for n in names]))) as one:
        one.reset(seeds=[1])
        look = np.zeros((1, 34))
        # Right and up: 19.7 degrees by a saccade of 64.3 ms, then 4 degrees by pursuit.
        for gaze_deg, arrived_deg in (((18, 8), 18 * 50 / 64.34), ((18, 8), 18), ((18, 12), 18)):
            look[0, 32:] = np.array(gaze_deg) / 45.0
            one.step(look)
            seen = {name: value[0] for name, value in one.observation().items()}
            assert 45.0 * seen["gaze"][0] == pytest.approx(arrived_deg, abs=1e-2)
            blind = arrived_deg != 18
            assert (not seen["fovea"].any()) == (not seen["fovea_depth"].any()) == blind
        right, up = np.tan(np.radians(18)), np.tan(np.radians(12)) / np.cos(np.radians(18))
        row, column = np.mgrid[:80, :120]
        fine = 36 + (40 - row - 0.5) * -6 + up * 240, 36 + (column + 0.5 - 60) * 6 - right * 240
        i, j = (np.floor(each).astype(int) for each in fine)
        both = (i >= 0) & (i < 72) & (j >= 0) & (j < 72)
        assert both.sum() in range(121, 170)
        assert (seen["fovea_depth"] < 1.0).sum() > 100
        colour = np.abs(seen["vision"][:3, both].astype(int) - seen["fovea"][:3, i[both], j[both]])
        assert np.quantile(colour.max(0), 0.9) <= 12
        deep = seen["vision"][3, both] * (10 / 255) - seen["fovea_depth"][0, i[both], j[both]]
        assert np.quantile(np.abs(deep), 0.9) <= 10 / 255 / 2 + 0.01


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"senses": [{"sense": "visoin"}]}, "sense: got 'visoin', .*did you mean 'vision'"),
        ({"senses": [{"sense": "time"}, {"sense": "time"}]}, "two with the name 'stateful_inf"),
        (
            {"senses": [{"sense": "vision"}, {"sense": "vision", "name": "x"}]},
            "'vision' twice, expected it once: an app draws one picture per step",
        ),
        (
            {"senses": [{"sense": "proprioception", "delay_ms": 31}]},
            "senses, proprioception: delay_ms: got 31.0, expected a multiple of the physics step",
        ),
        ({"senses": [{"sense": "gaze"}]}, "got 'gaze', expected vision.fovea with"),
        ({"senses": [{"sense": "fovea"}]}, "got 'fovea', expected vision.fovea"),
        ({"senses": [{"sense": "fingers"}]}, "got 'fingers', expected user.inputs"),
    ],
)
def test_wrong_lists_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Simulation(EnvConfig(app=AppConfig(renderer="null"), **change))


def test_an_efference_copy_has_the_actions_of_the_last_steps() -> None:
    senses = ({"sense": "actions", "stack_s": 0.1},)
    with closing(Simulation(config(vision=SMALL, senses=senses), 2)) as simulation:
        simulation.reset(seeds=[1, 2])
        count = simulation.action_space.shape[0]
        assert not simulation.observation()["actions"].any()
        first = np.linspace(-2.0, 1.0, 2 * count).reshape(2, count)
        simulation.step(first)
        simulation.step(np.full((2, count), 0.25))
        expected = np.concatenate([np.full((2, count), 0.25), np.clip(first, -1.0, 1.0)], axis=1)
        np.testing.assert_array_equal(
            simulation.observation()["actions"], expected.astype(np.float32)
        )
        state = simulation.state_dict()
        simulation.reset([1])
        assert not simulation.observation()["actions"][1].any()
        simulation.load_state_dict(state)
        np.testing.assert_array_equal(
            simulation.observation()["actions"], expected.astype(np.float32)
        )
