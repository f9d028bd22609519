"""Delay lines, noise and history around any sense, with numbers made by hand."""

import numpy as np
import pytest
from perception_fakes import SUBSTEPS, TIMESTEP_S, World, clock

from sim2vr_harness.perception import Delayed, History, Noisy, OwnDelays, Sense, Stacked
from sim2vr_harness.perception.vision import vision


def delayed(sense: Sense, delay_ms: float) -> Delayed:
    return Delayed(sense, delay_ms, timestep_s=TIMESTEP_S, substeps=SUBSTEPS)


def picture(frames: int = 1) -> Sense:
    sizes = {"channels": ("red",), "eyes": 1, "height": 2, "width": 2}
    return vision("vision", 1, **sizes, frame_grid=SUBSTEPS // frames)


@pytest.mark.parametrize("delay_ms", [2, 48, 50, 130])
def test_what_is_perceived_is_as_old_as_the_delay(delay_ms: float) -> None:
    world = World(1, delayed(clock(), delay_ms))
    world.reset([0])
    ages = []
    for step in range(1, 8):
        seen_ms = world.step()["clock"][0, 0]
        # Until the delay is over, the start of the episode.
        assert seen_ms == pytest.approx(max(50.0 * step - delay_ms, 0.0), abs=1e-4)
        ages.append(50.0 * step - seen_ms)
    assert ages[-1] == pytest.approx(delay_ms, abs=1e-4)


def test_a_user_who_starts_anew_forgets_and_one_who_is_not_answered_stays() -> None:
    world = World(3, delayed(clock(3), 80))
    world.reset([0, 1, 2])
    for _ in range(3):
        world.step()
    np.testing.assert_allclose(world.perception.observe()["clock"][:, 0], 70.0, atol=1e-4)
    world.reset([1])
    np.testing.assert_allclose(world.perception.observe()["clock"][:, 0], [70, 0, 70], atol=1e-4)
    # Step 4 (1 for user 1): 200 - 80, 0, and nothing for user 2.
    np.testing.assert_allclose(world.step([0, 1])["clock"][:, 0], [120, 0, 70], atol=1e-4)


@pytest.mark.parametrize(
    ("frames", "delay_ms", "frame", "old_ms"),
    [
        # Per step one frame: the youngest that is not younger than the delay.
        (1, 30, -1, 50),
        (1, 50, -1, 50),
        # Five, 10 ms apart: exact. The frame of 30 ms ago ends 20 ms into the step: the second.
        (5, 30, 1, 30),
        (5, 80, 1, 80),
        (5, 34, 0, 40),
        # 25, every substep.
        (25, 34, 7, 34),
    ],
)
def test_which_frame_is_drawn_for_a_delayed_picture(
    frames: int, delay_ms: float, frame: int, old_ms: int
) -> None:
    line = delayed(picture(frames), delay_ms)
    assert (line.frame, line.pauses) == (frame, ())
    world = World(1, line, pictures=(1, 2, 2))
    assert world.perception.drawn_frame == frame
    world.reset([0], level=0)
    grid_ms = 50.0 / frames
    for step in range(1, 7):
        drawn_ms = 50.0 * (step - 1) + grid_ms * ((frame % frames) + 1)
        seen = world.step(level=round(drawn_ms / 2.0))["vision"][0, 0, 0, 0] * 2.0
        assert seen == max(50.0 * step - old_ms, 0.0)


def test_users_perceive_as_late_as_each_of_them_is() -> None:
    delays_s = np.array([0.0, 0.03, 0.05, 0.081, 0.12])
    line = Delayed(
        clock(5), OwnDelays(lambda: delays_s, 0.12), timestep_s=TIMESTEP_S, substeps=SUBSTEPS
    )
    world = World(5, line)
    world.reset([0, 1, 2, 3, 4])
    # 81 ms is not a whole number of physics steps: 82. 0 and 50 ms are seen at ends of steps.
    assert line.pauses == (9, 10, 15)
    late_ms = np.array([0.0, 30.0, 50.0, 82.0, 120.0])
    for step in range(1, 7):
        seen = world.step()["clock"][:, 0]
        np.testing.assert_allclose(seen, np.maximum(50.0 * step - late_ms, 0.0), atol=1e-4)
    # Another person in place of the second, and one who is restored to what another was.
    delays_s[1] = 0.1
    world.reset([1])
    np.testing.assert_allclose(world.step()["clock"][:, 0], [350, 0, 300, 268, 230], atol=1e-4)
    saved = world.perception.state_dict(3)
    delays_s[4] = delays_s[3]
    world.perception.load_state_dict(4, saved)
    np.testing.assert_allclose(world.step()["clock"][3:, 0], [318, 318], atol=1e-4)


def test_history_is_the_newest_and_then_the_oldest() -> None:
    # The reference's buffer of 5 pictures at 20 Hz.
    world = World(1, History(picture(), 0.2, step_seconds=0.05))
    assert world.perception.space["vision"].shape == (2, 2, 2)
    world.reset([0], level=10)
    pairs = [world.perception.observe()["vision"][0, :, 0, 0].tolist()]
    pairs += [world.step(level=k)["vision"][0, :, 0, 0].tolist() for k in range(11, 18)]
    assert pairs == [[10, 10], [11, 10], [12, 10], [13, 10], [14, 10], [15, 11], [16, 12], [17, 13]]


def test_history_of_several_times_is_behind_the_newest_in_their_order() -> None:
    world = World(1, History(clock(), [0.1, 0.25], step_seconds=0.05))
    assert world.perception.space["clock"].shape == (3,)
    world.reset([0])
    found = [world.step()["clock"][0].round().tolist() for _ in range(7)]
    ends = [50 * k for k in range(1, 8)]
    assert found == [[t, max(0, t - 100), max(0, t - 250)] for t in ends]


def test_noise_has_the_level_and_the_stream_of_the_round() -> None:
    worlds = [World(2, Noisy(clock(2), 3.0)) for _ in range(2)]
    worlds[0].reset([0, 1], seed=5)
    worlds[1].reset([1], seed=5)
    off = []
    for step in range(1, 801):
        one, other = worlds[0].step(), worlds[1].step([1])
        assert one["clock"][1] == other["clock"][1]
        off.append(one["clock"][:, 0] - 50.0 * step)
    off_by = np.array(off)
    # 800 draws: mean +- 0.11, deviation +- 0.075 (one standard error each).
    np.testing.assert_allclose(off_by.mean(axis=0), 0.0, atol=0.4)
    np.testing.assert_allclose(off_by.std(axis=0), 3.0, atol=0.3)
    assert abs(np.corrcoef(off_by.T)[0, 1]) < 0.15
    again = worlds[0].perception.observe()
    np.testing.assert_array_equal(again["clock"], worlds[0].perception.observe()["clock"])


def test_wrong_settings() -> None:
    with pytest.raises(ValueError, match=r"delay_ms: got 31, expected a multiple of .*2 ms"):
        delayed(clock(), 31)
    with pytest.raises(ValueError, match=r"history_s: got 0.12, expected a multiple .* 0.05 s"):
        History(clock(), 0.12, step_seconds=0.05)
    with pytest.raises(ValueError, match="noise: got -1"):
        Noisy(clock(), -1)


def test_a_stack_has_every_step_the_newest_first() -> None:
    world = World(2, Stacked(clock(2), 0.2, step_seconds=0.05))
    world.reset([0, 1])
    assert world.perception.observe()["clock"].shape == (2, 4)
    for _ in range(2):
        world.step()
    np.testing.assert_allclose(world.perception.observe()["clock"][0], [100, 50, 0, 0], atol=1e-4)
    for _ in range(3):
        world.step()
    world.reset([1])
    world.step()
    np.testing.assert_allclose(
        world.perception.observe()["clock"], [[300, 250, 200, 150], [50, 0, 0, 0]], atol=1e-4
    )


def test_noise_of_pictures_is_a_share_of_the_full_scale() -> None:
    sizes = {"channels": ("red",), "eyes": 1, "height": 64, "width": 64, "frame_grid": SUBSTEPS}
    world = World(1, Noisy(vision("vision", 1, **sizes), 0.02), pictures=(1, 64, 64))
    world.reset([0], level=100)
    seen = world.perception.observe()["vision"]
    assert seen.dtype == np.uint8
    assert seen.mean() == pytest.approx(100.0, abs=0.4)
    assert seen.std() == pytest.approx(5.1, abs=0.3)  # 0.02 * 255
    dark, light = world.step(level=0)["vision"], world.step(level=255)["vision"]
    assert (dark.max() < 40, light.min() > 215) == (True, True)  # clipped, not wrapped
