"""The human motor policy: what it feels late, how it misjudges goals, and where it begins."""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import UserConfig, people_of
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.human_motor import (
    GoalPerception,
    HumanHands,
    HumanMotorPolicy,
    InverseModel,
    InverseSettings,
    _within_range,
    duration,
    moved,
    people_policy,
    quintic,
)
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals, MotorPolicy
from sim2vr_harness.policies.hierarchical.motor_store import (
    load_human_policy,
    load_motor_layer,
    save_motor_layer,
)
from sim2vr_harness.world_models.transitions import Motion

STEP_S, USERS = 0.05, 4


@pytest.fixture(scope="module")
def user() -> UserConfig:
    return as_population(UserConfig())


@pytest.fixture(scope="module")
def policy(user: UserConfig) -> HumanMotorPolicy:
    torch.manual_seed(3)
    return people_policy(user, STEP_S, body_width=8).requires_grad_(False)


def persons(policy: HumanMotorPolicy, user: UserConfig) -> torch.Tensor:
    people = people_of(user)
    assert people is not None
    rows = [policy.persons.told(people.sample(0, k).features) for k in range(USERS)]
    return torch.tensor(np.array(rows)).float()


def motion(policy: HumanMotorPolicy, user: UserConfig, seed: int) -> Motion:
    drawn = torch.Generator().manual_seed(seed)
    joints, drives = len(policy.body.independent_joints), policy.drives.count
    sizes = (joints, joints, drives)
    values = (0.3 * torch.rand(USERS, size, generator=drawn) for size in sizes)
    return Motion(*values, persons(policy, user))


def goals(policy: HumanMotorPolicy) -> MotorGoals:
    made = MotorGoals.none(USERS, 1)
    made.place[..., 0], made.place[..., 2] = 0.4, 1.2
    made.active += 1.0
    return made


def test_the_body_is_felt_a_step_late(policy: HumanMotorPolicy, user: UserConfig) -> None:
    """What happens to the body now changes the action of the next step, not of this one."""
    hands, target = HumanHands(policy, USERS), goals(policy)
    first, now, pushed = (motion(policy, user, seed) for seed in (1, 2, 3))
    hands.act(first, target)
    other = copy.deepcopy(hands)
    assert other.policy is hands.policy
    same, _ = hands.act(now, target)
    as_well, _ = other.act(pushed, target)
    np.testing.assert_array_equal(same, as_well)
    assert np.abs(hands.act(now, target)[0] - other.act(now, target)[0]).max() > 1e-6


def test_goals_are_misjudged_by_the_distance_seen_late() -> None:
    """5 % of the 0.4 m of two steps ago and 2 mm: 22 mm along each axis; of 0.1 m 7 mm."""
    torch.manual_seed(1)
    seen = GoalPerception(4000, 1, STEP_S, weber=0.05, least_m=0.002, late_steps=2)
    far, near = torch.full((4000, 1), 0.4), torch.full((4000, 1), 0.1)
    seen.forget(torch.arange(4000), far)
    for distance, expected in ((near, 0.022), (near, 0.022), (near, 0.022), (near, 0.007)):
        assert float(seen.error().std()) == pytest.approx(expected, rel=0.05)
        seen.look(distance)


def test_movements_are_of_minimum_jerk() -> None:
    """0.3 m in 0.6 s: half the way and 1.875 times the mean speed in the middle.

    Squared accelerations sum up to 120/7 D^2/T^3. A hand that passes arrives at its velocity.
    """
    way, rest, time_s = torch.tensor([0.3, 0.0, 0.0]), torch.zeros(3), torch.tensor(0.6)
    path = quintic(way, rest, rest, rest, time_s)
    assert float(moved(path, torch.tensor(0.3), 0)[0]) == pytest.approx(0.15, abs=1e-6)
    assert float(moved(path, torch.tensor(0.3), 1)[0]) == pytest.approx(1.875 * 0.5, abs=1e-5)
    fine = torch.linspace(0.0, 0.6, 2001)
    work = float(torch.trapezoid(moved(path.expand(2001, 3, 6), fine, 2)[:, 0].square(), fine))
    assert work == pytest.approx(120.0 / 7.0 * 0.3**2 / 0.6**3, rel=1e-3)
    passes = quintic(way, final := torch.tensor([0.0, 1.3, 0.0]), way, final, time_s)
    for order, expected in enumerate((way, final, torch.zeros(3))):
        torch.testing.assert_close(moved(passes, time_s, order), expected, atol=1e-5, rtol=0.0)


def test_durations_follow_from_costs() -> None:
    """Wide targets: (3 * 120/7 * 0.15/7 D^2)^(1/4), 0.45 and 0.64 s; small ones take longer.

    A fourth of the effort's weight shortens movements by the root of 2.
    """
    goals, rest = MotorGoals.none(4, 1), torch.zeros(4, 1, 3)
    goals.width[:] = torch.tensor([[0.5], [0.5], [0.02], [0.5]])
    way = torch.tensor([0.2, 0.4, 0.4, 0.4])[:, None, None] * torch.tensor([1.0, 0.0, 0.0])
    effort = torch.tensor([[1.0], [1.0], [1.0], [0.25]])
    wide, far, narrow, eager = duration(way, rest, rest, goals, torch.ones(4, 1), effort)[:, 0]
    assert [float(wide), float(far)] == pytest.approx([0.458, 0.648], abs=0.03)
    assert float(narrow) > float(far) + 0.2
    assert float(eager) == pytest.approx(0.648 / 2.0**0.5, abs=0.03)


def test_a_hand_with_a_time_is_there_then(policy: HumanMotorPolicy, user: UserConfig) -> None:
    """The plan's time left is what the goal says, whatever a movement would take by itself."""
    hands, target = HumanHands(policy, USERS), goals(policy)
    target.velocity[..., 1] = 1.3
    for left_s in (0.35, 0.3, 0.25):
        target.due_s[:2] = left_s
        hands.act(motion(policy, user, 1), target)
        torch.testing.assert_close(hands.left_s[:2], torch.full((2, 1), left_s - STEP_S))
    assert (hands.left_s[2:] > 0.25).all()


def test_commands_are_the_cheapest_between_nothing_and_all() -> None:
    """Of random problems, 5 % beside the best cost at most; SciPy solves them to the end."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        rows, wanted, start = rng.normal(size=(3, 8)), rng.normal(size=3), rng.uniform(size=8)
        square = torch.tensor(rows.T @ rows + 0.3 * np.eye(8))[None].float()
        pull = torch.tensor(rows.T @ wanted)[None].float()
        found = _within_range(square, pull, torch.tensor(start)[None].float())[0].double().numpy()
        best = lsq_linear(
            np.vstack([rows, 0.3**0.5 * np.eye(8)]),
            np.concatenate([wanted + rows @ start, 0.3**0.5 * start]),
            bounds=(0.0, 1.0),
        ).x
        cost = [
            float(np.square(wanted - rows @ (u - start)).sum() + 0.3 * np.square(u - start).sum())
            for u in (found, best)
        ]
        assert found.min() >= 0.0 and found.max() <= 1.0
        assert cost[0] <= 1.05 * cost[1] + 1e-6


def test_the_inverse_model_reaches_what_the_forward_model_predicts(
    policy: HumanMotorPolicy, user: UserConfig
) -> None:
    """Commands for a velocity that differs little from the one without: within a fifth."""
    now, tip = motion(policy, user, 6), torch.zeros(USERS, 1, 3)
    now = replace(now, drives=0.3 + 0.4 * now.drives)
    cheap = InverseSettings(velocity_mps=1e-3, effort=0.0, change=1e-3, speed_radps=1e3)
    inverse = InverseModel(
        policy.forward_model, -torch.ones(7), torch.ones(7), torch.ones(policy.drives.count), cheap
    )
    nothing, active = torch.zeros(USERS, 7), torch.ones(USERS, 1)

    def reached(controls: torch.Tensor) -> torch.Tensor:
        after = policy.forward_model(now, controls)
        return inverse.velocities(after, tip)[1]

    with torch.no_grad():
        before = reached(now.drives)
        wanted = before + 0.01 * torch.tensor([1.0, -1.0, 0.5])
        found = reached(inverse.controls(now, tip, wanted, active, nothing))
    assert float((found - wanted).norm(dim=-1).max()) < 0.2 * 0.015


def test_it_is_kept_in_a_file(policy: HumanMotorPolicy, user: UserConfig, tmp_path: Path) -> None:
    file = tmp_path / "people.pt"
    save_motor_layer(file, policy, body="mobl_arms_wrist")
    again = load_human_policy(file, user, STEP_S)
    now, target = motion(policy, user, 4), goals(policy)
    np.testing.assert_array_equal(
        HumanHands(again, USERS).act(now, target)[0], HumanHands(policy, USERS).act(now, target)[0]
    )
    with pytest.raises(InputError, match="human motor policy"):
        load_motor_layer(file, ResolvedEnv.of_user(user).body, STEP_S)
    plain = tmp_path / "plain.pt"
    save_motor_layer(plain, MotorPolicy(ResolvedEnv.of_user(user).body, STEP_S, width=16))
    with pytest.raises(InputError, match="plain motor layer"):
        load_human_policy(plain, user, STEP_S)
