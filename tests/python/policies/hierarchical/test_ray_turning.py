"""Rays that persons turn: angles as lengths, and what counts of velocities."""

import math

import pytest
import torch

from sim2vr_harness.policies.hierarchical.human_motor import (
    REFERENCE_M,
    Turning,
)
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals


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
