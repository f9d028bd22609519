"""What a motor layer is told, by hand."""

import math

import pytest
import torch

from sim2vr_harness.policies.hierarchical.goal_sampler import GoalSampler, off_goal
from sim2vr_harness.policies.hierarchical.motor_policy import (
    GOAL_SIZE,
    MOMENT_S,
    MotorGoals,
    describe,
)


def turned_left(at: tuple[float, float, float]) -> torch.Tensor:
    """(1, 1, 4, 4) a device at a place whose x axis points to the world's y."""
    place = torch.eye(4)
    place[:3, :3] = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    place[:3, 3] = torch.tensor(at)
    return place[None, None]


def test_a_goal_is_told_as_way_velocities_and_time() -> None:
    now = turned_left((0.0, 0.0, 1.0))
    soon = turned_left((0.0, 0.01, 1.0))  # 2 m/s to the left
    goals = MotorGoals.none(1, 1)
    goals.place[:] = torch.tensor([0.3, 0.0, 1.0])
    goals.velocity[:] = torch.tensor([1.5, 0.0, 0.0])
    goals.left_s[:] = 0.5
    goals.axis[:] = torch.tensor([1.0, 0.0, 0.0])
    goals.active[:] = 1.0
    told = describe(goals, now, soon)[0, 0]
    assert told.shape == (GOAL_SIZE,)
    assert told[:3].tolist() == pytest.approx([1.0, 0.0, 0.0])  # 0.3 m in units of 0.3 m
    assert told[3].item() == pytest.approx(0.3 / 0.6 / 1.5)
    assert told[6:9].tolist() == pytest.approx([0.0, 0.01 / MOMENT_S / 1.5, 0.0], abs=1e-5)
    assert told[9].item() == pytest.approx(1.0)
    assert told[15].item() == pytest.approx(1.0)  # 0.5 s in units of 0.5 s
    assert told[17:20].tolist() == pytest.approx([1.0, -1.0, 0.0], abs=1e-6)
    goals.active[:] = 0.0
    assert not describe(goals, now, soon).any()


def poses() -> torch.Tensor:
    """(P, 1, 4, 4) a device anywhere in a box before the body."""
    generator = torch.Generator().manual_seed(3)
    places = torch.eye(4).repeat(500, 1, 1, 1)
    places[:, 0, :3, 3] = torch.rand(500, 3, generator=generator) + torch.tensor([0.2, -0.5, 0.5])
    return places


def test_a_hand_that_is_where_it_shall_be_earns_most() -> None:
    exercises = GoalSampler(poses(), 64, 0.05, seed=1)
    exercises.tools = False
    start = poses()[:64]
    exercises.start(torch.arange(64), start)
    at = start.clone()
    worth_there, worth_away = 0.0, 0.0
    for _ in range(40):
        goals = exercises.goals
        other = GoalSampler(poses(), 64, 0.05, seed=1)
        other.load_state_dict(exercises.state_dict())
        # Paths run ahead: where the hand shall be now is what was shown LEAD_STEPS ago.
        arrives = (goals.left_s <= 0.051) & (goals.left_s > 0.0)
        at[..., :3, 3] = torch.where(arrives[..., None], goals.place, at[..., :3, 3])
        soon = at.clone()
        soon[..., :3, 3] += MOMENT_S * goals.velocity
        away = at.clone()
        away[..., 2, 3] += 0.2
        away_soon = soon.clone()
        away_soon[..., 2, 3] += 0.2
        worth_there += float(exercises.step(at, soon)[arrives[:, 0]].sum())
        worth_away += float(other.step(away, away_soon)[arrives[:, 0]].sum())
    assert worth_there > 0.0 > worth_away
    measured = exercises.measured()
    assert measured["place_m"] < 1e-3
    assert measured["speed_mps"] < 1e-2


def test_who_goes_through_a_place_may_be_a_little_early_or_late() -> None:
    """At 2 m/s 0.04 s are 8 cm: of 10 cm ahead 2 are left, beside 3 to the left. At rest: none."""
    gap = torch.tensor([[0.1, 0.03, 0.0], [0.05, 0.03, 0.0], [0.1, 0.03, 0.0]])
    velocity = torch.tensor([[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    expected = torch.tensor([math.hypot(0.02, 0.03), 0.03, math.hypot(0.1, 0.03)])
    assert torch.allclose(off_goal(gap, velocity), expected, atol=1e-3)
