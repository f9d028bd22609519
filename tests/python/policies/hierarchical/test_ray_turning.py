"""Rays that persons turn: angles as lengths, and what counts of velocities."""

import math

import numpy as np
import pytest
import torch

from sim2vr_harness.client.frames import AIM_DIRECTION
from sim2vr_harness.policies.hierarchical.human_motor import (
    REFERENCE_M,
    Turning,
    far_off,
)
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals, tips
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS, apart, off_ray, turn_rays


def test_a_ray_s_way_is_its_angle_and_what_is_along_it_does_not_count() -> None:
    """A ray to x, its place 2 m to y: a quarter turn; a target of 4 cm is 1.1 degrees wide there.

    The second hand reaches, and nothing changes for it.
    """
    goals = MotorGoals.none(1, 2)
    goals.rays[0, 0] = 1.0
    goals.place[0] = torch.tensor([[0.0, 2.0, 0.0], [0.3, 0.4, 0.0]])
    hand, tip = torch.zeros(1, 2, 3), torch.tensor([[[2.0, 0.0, 0.0], [0.1, 0.0, 0.0]]])
    turning = Turning(goals, hand, tip)
    velocity = torch.tensor([[[5.0, 1.0, 0.0], [5.0, 1.0, 0.0]]])
    way, seen, wanted = turning.seen(goals.place - tip, velocity, goals)
    quarter = REFERENCE_M * math.pi / 2.0
    assert way[0, 0].tolist() == pytest.approx([0.0, quarter, 0.0], abs=1e-6)
    assert seen[0, 0].tolist() == pytest.approx([0.0, REFERENCE_M * 0.5, 0.0], abs=1e-6)
    assert float(wanted.width[0, 0]) == pytest.approx(REFERENCE_M * 0.02)
    error = torch.ones(1, 2, 3)
    assert turning.across(error)[0, 0].tolist() == pytest.approx([0.0, 1.0, 1.0])
    assert way[0, 1].tolist() == pytest.approx([0.2, 0.4, 0.0])
    assert seen[0, 1].tolist() == [5.0, 1.0, 0.0]
    assert float(wanted.width[0, 1]) == pytest.approx(0.04)
    assert turning.across(error)[0, 1].tolist() == [1.0, 1.0, 1.0]
    taken = turning.taken(seen + torch.tensor([0.0, 1.0, 0.0]), seen)
    assert 0.3 < float(taken[0, 0, 1] - seen[0, 0, 1]) < 0.9
    assert taken[0, 1].tolist() == pytest.approx([5.0, 2.0, 0.0])


def test_the_tip_of_a_ray_is_as_far_away_as_its_place() -> None:
    """A hand at x = 1 with its ray down and ahead, a place 1.5 m along the ray, and one above.

    A device with its x axis up has a ray 30 degrees above the horizon, of which the place above is
    60 degrees off.
    """
    place = torch.eye(4).repeat(1, 1, 1, 1)
    place[..., 0, 3] = 1.0
    goals = MotorGoals.none(1, 1)
    goals.place[0, 0] = place[0, 0, :3, 3] + 1.5 * torch.from_numpy(AIM_DIRECTION).float()
    turn_rays(goals, torch.ones(1, 1, dtype=torch.bool), place)
    np.testing.assert_allclose(tips(place, goals.tip), goals.place, atol=1e-6)
    assert float(far_off(goals, place)) == pytest.approx(0.0, abs=1e-5)
    place[0, 0, :3, :3] = torch.tensor([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    goals.place[0, 0] = torch.tensor([1.0, 0.0, 2.0])
    turn_rays(goals, torch.ones(1, 1, dtype=torch.bool), place)
    assert float(far_off(goals, place)) == pytest.approx(REFERENCE_M * math.pi / 3.0, abs=1e-4)


def test_a_ray_of_a_page_has_its_own_origin_and_direction() -> None:
    """The ray goes on along the grip's axis, from 10 cm before the hand.

    A device with its x axis up at x = 1 begins it at (1, 0, 0.1): a place 2 m above that is on it,
    one 2 m ahead of that a quarter turn off the ray, and off the hand's own way to it a little
    less: its direction from the hand is atan(0.1 / 2) above the horizon.
    """
    rays = torch.tensor([[[0.1, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    place = torch.eye(4).repeat(1, 1, 1, 1)
    place[0, 0, :3, :3] = torch.tensor([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    place[..., 0, 3] = 1.0
    goals = MotorGoals.none(1, 1)
    goals.place[0, 0] = torch.tensor([1.0, 0.0, 2.1])
    which = torch.ones(1, 1, dtype=torch.bool)
    turn_rays(goals, which, place, rays)
    assert goals.tip[0, 0].tolist() == pytest.approx([2.1, 0.0, 0.0])
    assert float(far_off(goals, place)) == pytest.approx(0.0, abs=1e-5)
    assert [float(part) for part in off_ray(place, goals.place, rays)] == pytest.approx([0.0, 2.0])
    goals.place[0, 0] = torch.tensor([3.0, 0.0, 0.1])
    turn_rays(goals, which, place, rays)
    angle = math.pi / 2.0 - math.atan(0.1 / 2.0)
    assert float(far_off(goals, place)) == pytest.approx(REFERENCE_M * angle, abs=1e-4)
    beside, along = off_ray(place, goals.place, rays)
    assert float(beside) == pytest.approx(2.0)
    assert float(along) == pytest.approx(0.0, abs=1e-6)


def test_rays_that_differ_say_by_how_much() -> None:
    """WebXR's ray is 60 degrees below the grip's axis."""
    axis = torch.tensor([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    assert apart(AIM_RAYS.repeat(2, 1, 1)) == ""
    assert apart(axis) == "60 degrees"
    assert (
        apart(axis + torch.tensor([[0.0, 0.05, 0.0], [0.0, 0.0, 0.0]]), axis)
        == "0 degrees and 5 cm"
    )
