"""What comes from the app beside the picture: vibrations and sounds, with numbers by hand."""

import numpy as np
import pytest
from perception_fakes import SUBSTEPS, TIMESTEP_S, World, pulse, sound

from sim2vr_harness.perception import Delayed
from sim2vr_harness.perception.events import Haptics, Hearing, ear_gains


def felt(world: World, **replied: object) -> list[float]:
    return world.step(**replied)["haptics"][0].tolist()


def test_a_vibration_is_felt_while_it_lasts() -> None:
    world = World(1, Haptics("haptics", 1))
    world.reset([0])
    assert felt(world) == [0.0, 0.0]
    assert felt(world, haptics={0: [pulse("right", 0.5, 0.12)]}) == [0.0, 0.5]
    # Begun at the reply: it goes on for two whole steps and 20 ms of the third.
    assert [felt(world)[1] for _ in range(4)] == [0.5, 0.5, 0.5, 0.0]


def test_the_shortest_vibration_is_felt_once_and_a_new_one_ends_the_old() -> None:
    world = World(1, Haptics("haptics", 1))
    world.reset([0])
    assert felt(world, haptics={0: [pulse("left", 0.8, -1e-9)]}) == [pytest.approx(0.8), 0.0]
    assert felt(world) == [0.0, 0.0]
    felt(world, haptics={0: [pulse("right", 0.9, 1.0)]})
    both = [pulse("right", 0.3, 1.0), pulse("left", 0.2, 1.0)]
    # The strong one went on until it was replaced.
    assert felt(world, haptics={0: both}) == pytest.approx([0.2, 0.9])
    assert felt(world) == pytest.approx([0.2, 0.3])
    assert felt(world, haptics={0: [pulse("right", 0.0, 0.0)]}) == pytest.approx([0.2, 0.3])
    assert felt(world) == pytest.approx([0.2, 0.0])


def test_a_delayed_vibration_is_felt_to_the_substep() -> None:
    # 20 ms from 50 ms on, perceived 30 ms later: from 80 to 100 ms, that is in the step from 50 to
    # 100 alone; 40 ms of it reach into the next.
    for duration_s, expected in ((0.02, [0, 1, 0]), (0.04, [0, 1, 1])):
        line = Delayed(Haptics("haptics", 1), 30, timestep_s=TIMESTEP_S, substeps=SUBSTEPS)
        world = World(1, line)
        world.reset([0])
        seen = [felt(world, haptics={0: [pulse("left", 1.0, duration_s)]})]
        seen += [felt(world, haptics={}) for _ in range(2)]
        assert [left for left, _ in seen] == expected


def test_the_head_shadows_the_far_ear() -> None:
    # alpha = 1.05 + 0.95 cos(1.2 theta): 2 at 0, 0.756 at 90, 0.1 at 150, 0.281 at 180 degrees;
    # w = 2 pi 2000 0.0875 / (2 343) = 1.603; |H| = sqrt((1 + (alpha w)^2) / (1 + w^2)).
    left, right = ear_gains([1.0, 0.0, 0.0])
    assert (right, left) == pytest.approx((1.7777, 0.5805), abs=1e-3)
    assert ear_gains([0.0, 0.0, 2.0]) == pytest.approx([0.8318, 0.8318], abs=1e-3)
    angle = np.radians(150.0)  # from the right ear's axis
    assert ear_gains([np.cos(angle), 0.0, np.sin(angle)])[1] == pytest.approx(0.5362, abs=1e-3)
    np.testing.assert_allclose(ear_gains([-1.0, 0.0, 0.0]), [right, left])


def test_loudness_falls_with_the_distance_from_one_metre_on() -> None:
    world = World(1, Hearing("sound", 1))
    world.reset([0])
    front = 0.8318
    for metres, expected in ((0.3, 1.0), (1.0, 1.0), (2.0, 0.5), (8.0, 0.125)):
        heard = world.step(sounds={0: [sound((0.0, 0.0, metres), gain=0.6)]})["sound"][0]
        assert heard == pytest.approx([0.6 * front * expected] * 2, abs=1e-4)
    assert world.step()["sound"][0].tolist() == [0.0, 0.0]
    # Two at once: their powers add up.
    twice = [sound((0.0, 0.0, 1.0)), sound((0.0, 0.0, -1.0))]
    heard = world.step(sounds={0: twice})["sound"][0]
    assert heard == pytest.approx([front * np.sqrt(2.0)] * 2, abs=1e-3)


def test_where_a_sound_is_heard_depends_on_the_head() -> None:
    world = World(2, Hearing("sound", 2))
    world.reset([0, 1])
    # User 1 stands 1 m further back and has turned to the right by 90 degrees about y: what is in
    # front of user 0 is at the left of user 1, 2 m away.
    half = np.pi / 4.0
    world.heads[1] = [0.0, 0.0, -1.0, 0.0, np.sin(half), 0.0, np.cos(half)]
    event = [sound((0.0, 0.0, 1.0))]
    heard = world.step(sounds={0: event, 1: event})["sound"]
    assert heard[0] == pytest.approx([0.8318, 0.8318], abs=1e-3)
    assert heard[1] == pytest.approx([1.7777 / 2.0, 0.5805 / 2.0], abs=1e-3)
