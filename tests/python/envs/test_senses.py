"""What users perceive in an app: every sense and wrapper end to end, saved, and in any batch."""

from contextlib import closing
from typing import Any

import numpy as np
import pytest
from fake_device_app import FakeDeviceApp

from sim2vr_harness.client import AppUnsupported, HapticPulse, SoundEvent
from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.envs import AppConfig, EnvConfig, SenseConfig, Simulation, VisionConfig
from sim2vr_harness.envs.resolved import ResolvedEnv

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


def test_a_delay_of_a_step_is_the_observation_before() -> None:
    senses = [{"sense": name, "delay_ms": 50} for name in ("vision", "proprioception", "time")]
    late, now = Simulation(config(vision=SMALL, senses=senses)), Simulation(config(vision=SMALL))
    late.reset(seeds=[1])
    now.reset(seeds=[1])
    for step in range(6):
        before = now.observation()
        now.step(actions(1, step))
        late.step(actions(1, step))
        for key, value in late.observation().items():
            np.testing.assert_array_equal(value, before[key])
    assert (now.observation()["vision"] != before["vision"]).any()
    late.close()
    now.close()


@pytest.mark.parametrize(
    ("frames", "delay_ms", "frame_of_step"),
    [(1, 30, lambda k: k - 1), (5, 30, lambda k: 5 * k - 3), (5, 80, lambda k: 5 * k - 8)],
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


def test_two_eyes_see_the_left_ones_channels_first() -> None:
    simulation, apps = with_fake_apps({"vision": {"eyes": 2}}, eyes=2)
    simulation.reset(seeds=[1])
    apps[0].image[0], apps[0].image[1] = 10, 20
    simulation._group._take(0, apps[0]._reply())
    simulation._senses.take(np.array([0]))
    seen = simulation.observation()["vision"]
    assert simulation.observation_space["vision"].shape == (4, 8, 8)
    assert seen[0, :, 0, 0].tolist() == [10, 10, 20, 20]
    simulation.close()


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


def test_delayed_events_are_saved_with_the_state() -> None:
    settings = {
        "senses": [{"sense": "haptics", "delay_ms": 30}, {"sense": "sound", "delay_ms": 30}]
    }
    haptics = {3: (HapticPulse("right", 1.0, 0.0, 0.01),)}
    sounds = {3: (SoundEvent("knock", (0.0, 1.0, 1.0), 1.0),)}
    one, two = (
        with_fake_apps(dict(settings), 1, haptics=haptics, sounds=sounds)[0] for _ in range(2)
    )
    one.reset(seeds=[1])
    for step in range(3):
        one.step(actions(1, step))
    assert not one.observation()["haptics"].any()  # begun, but not felt yet
    two.load_state_dict(one.state_dict())
    for simulation in (one, two):
        simulation.step(actions(1, 3))
        assert simulation.observation()["haptics"][0].tolist() == [0.0, 1.0]
        assert simulation.observation()["sound"].all()
        simulation.close()


def test_the_noise_of_senses_changes_nothing_else() -> None:
    noisy = [{"sense": "vision", "noise": 0.1}, {"sense": "proprioception"}, {"sense": "time"}]
    one, two = Simulation(config(vision=SMALL, senses=noisy)), Simulation(config(vision=SMALL))
    for simulation in (one, two):
        simulation.reset(seeds=[1])
        simulation.reset()  # the second episode of the stream
        simulation.step(actions(1, 0))
    seen, clear = one.observation(), two.observation()
    np.testing.assert_array_equal(seen["proprioception"], clear["proprioception"])
    off = seen["vision"].astype(int) - clear["vision"]
    assert 15.0 < off[(clear["vision"] > 80) & (clear["vision"] < 175)].std() < 35.0  # 25.5
    one.close()
    two.close()


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


# --- configuration ----------------------------------------------------------------------------


def test_the_default_list_is_the_references() -> None:
    assert [one.sense for one in EnvConfig().senses] == ["vision", "proprioception", "time"]
    terms = ResolvedEnv(EnvConfig()).contract
    assert "senses" not in terms
    assert (
        ResolvedEnv(
            EnvConfig(senses=[{"sense": "vision", "delay_ms": 50}, *EnvConfig().senses[1:]])
        ).contract
        == terms
    )
    two = EnvConfig(
        vision=VisionConfig(eyes=2, fovea={"gaze": "moves"}),
        user={"inputs": ["right.trigger"]},
        senses=[SenseConfig(sense="vision", name="sight", history_s=0.2)],
    )
    changed = ResolvedEnv(two).contract
    assert changed["senses"] == {"sight": "vision"}
    assert (changed["eyes"], changed["gaze"], changed["inputs"]) == (2, "moves", ["right.trigger"])
    assert changed["buffer_s"] == 0.2
    assert changed["observation"] == {"sight": [[8, 80, 120], "uint8"]}
    longer = ResolvedEnv(EnvConfig(senses=[{"sense": "vision", "history_s": [0.1, 0.3]}])).contract
    assert longer["buffer_s"] == [0.1, 0.3]
    assert longer["observation"] == {"vision": [[6, 80, 120], "uint8"]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"senses": [{"sense": "visoin"}]}, "sense: got 'visoin', .*did you mean 'vision'"),
        ({"senses": []}, "senses"),
        ({"senses": [{"sense": "time"}, {"sense": "time"}]}, "two with the name 'stateful_inf"),
        (
            {"senses": [{"sense": "vision"}, {"sense": "vision", "name": "x"}]},
            "'vision' twice, expected it once: an app draws one picture per step",
        ),
        (
            {"senses": [{"sense": "proprioception", "delay_ms": 31}]},
            "senses, proprioception: delay_ms: got 31.0, expected a multiple of the physics step",
        ),
        ({"senses": [{"sense": "time", "history_s": 0.12}]}, "history_s: got 0.12"),
        ({"senses": [{"sense": "time", "history_s": [0.1, -1]}]}, r"got \[0.1, -1\], expected sec"),
        ({"senses": [{"sense": "time", "delay_ms": -1}]}, r"0.delay_ms: got -1, expected gr"),
        ({"senses": [{"sense": "gaze"}]}, "got 'gaze', expected vision.fovea with"),
        ({"senses": [{"sense": "fovea"}]}, "got 'fovea', expected vision.fovea"),
        ({"senses": [{"sense": "fingers"}]}, "got 'fingers', expected user.inputs"),
        ({"senses": [{"sense": "time", "dely_ms": 3}]}, "dely_ms"),
    ],
)
def test_wrong_lists_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Simulation(EnvConfig(app=AppConfig(renderer="null"), **change))


@pytest.mark.parametrize("transport", ["in_process", "protocol2"])
def test_the_sample_is_felt_and_heard_where_it_is_touched(
    transport: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hand that goes to and fro where the ball may be; docs of the sample: 20 ms at 0.5."""
    small = {"width": 8, "height": 8}
    app = AppConfig(game="sample", renderer="null", transport=transport)
    senses = [{"sense": "haptics"}, {"sense": "sound"}]
    simulation = Simulation(EnvConfig(app=app, vision=small, senses=senses))
    head = np.array([0.0, 1.17, 0.0])
    way = [(x, y) for y in np.arange(0.9, 1.31, 0.08) for x in np.linspace(-0.3, 0.4, 8)]

    def device_poses(name: str, sample: int = -1) -> tuple[np.ndarray, np.ndarray]:
        hand = np.array([*way[int(simulation._steps[0])], 0.45])
        position = position_to_mujoco(head if name == "headset" else hand)
        return position[None], np.array([[1.0, 0.0, 0.0, 0.0]])

    monkeypatch.setattr(simulation.users, "device_poses", device_poses)
    simulation.reset(seeds=[1])
    points, touches = 0.0, 0
    for step in range(1, 25):
        log = simulation.step(np.zeros((1, 32))).logs[0]
        seen = simulation.observation()
        touched, points = log["Points"] > points, log["Points"]
        if touched:
            touches += 1
            assert seen["haptics"][0].tolist() == [0.0, 0.5]
            left, right = seen["sound"][0]
            assert min(left, right) > 0.4  # within 1 m, shadowed by 1.7 at most
            # The ball is within the reach of the two spheres, 8 cm, of the hand of then.
            if abs(way[step][0]) > 0.1:
                assert (right > left) == (way[step][0] > 0)
        else:
            assert not seen["sound"].any()
    assert touches >= 2
    simulation.close()


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
