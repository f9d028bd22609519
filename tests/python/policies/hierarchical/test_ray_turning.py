"""Rays that persons turn: angles as lengths, what counts, and postures that aim."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from sim2vr_harness.client.frames import AIM_DIRECTION
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.human_motor import people_policy
from sim2vr_harness.policies.hierarchical.motor_goals import tips
from sim2vr_harness.policies.hierarchical.pointing import turn_rays
from sim2vr_harness.policies.hierarchical.ray_turning import REFERENCE_M, Turning, far_off


def test_a_ray_s_way_is_its_angle_and_what_is_along_it_does_not_count() -> None:
    """A ray to x, its place 2 m to y: a quarter turn; a target of 4 cm is 1.1 degrees wide there.

    The second hand reaches, and nothing changes for it.
    """
    goals = HumanGoals.none(1, 2)
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


def test_the_tip_of_a_ray_is_as_far_away_as_its_place() -> None:
    """A hand at x = 1 whose aim ray goes down and ahead, to a place 0.5 m on the ray, and one above.

    A device with its x axis up has a ray 30 degrees above the horizon, of which the place above is
    60 degrees off.
    """
    place = torch.eye(4).repeat(1, 1, 1, 1)
    place[..., 0, 3] = 1.0
    goals = HumanGoals.none(1, 1)
    goals.place[0, 0] = place[0, 0, :3, 3] + 1.5 * torch.from_numpy(AIM_DIRECTION).float()
    turn_rays(goals, torch.ones(1, 1, dtype=torch.bool), place)
    np.testing.assert_allclose(tips(place, goals.tip), goals.place, atol=1e-6)
    assert float(far_off(goals, place)) == pytest.approx(0.0, abs=1e-5)
    place[0, 0, :3, :3] = torch.tensor([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    goals.place[0, 0] = torch.tensor([1.0, 0.0, 2.0])
    turn_rays(goals, torch.ones(1, 1, dtype=torch.bool), place)
    assert float(far_off(goals, place)) == pytest.approx(REFERENCE_M * math.pi / 3.0, abs=1e-4)


@pytest.mark.parametrize("place", [(1.5, 0.0, 1.3), (1.5, 0.6, 1.1), (2.0, -1.0, 1.8)])
def test_comfortable_postures_point_nearly_at_places(place: tuple[float, float, float]) -> None:
    """Their mean is within 12 degrees: feedback does the rest. Hands that reach have no say."""
    torch.manual_seed(3)
    policy = people_policy(as_population(UserConfig()), 0.05, width=16, body_width=8)
    goals = HumanGoals.none(1, 1)
    goals.place[0, 0] = torch.tensor(place)
    goals.rays += 1.0
    posture = policy.postures.towards(goals.place, goals.rays)
    average = torch.from_numpy(policy.persons.told(np.zeros(9, np.float32))).float()[None]
    placed = policy.forward_model.places(posture, average)
    turn_rays(goals, goals.rays > 0.0, placed)
    assert math.degrees(float(far_off(goals, placed)) / REFERENCE_M) < 12.0
    low, high = torch.tensor(policy.body.joint_ranges.T.copy()).float()
    off = (2.0 * posture - low - high) / (high - low)
    assert float(off.abs().max()) < 0.8
    idle = policy.postures.towards(goals.place, 0.0 * goals.rays)
    assert float(((2.0 * idle - low - high) / (high - low)).abs().max()) < 0.05
