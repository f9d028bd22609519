"""The human motor policy: what it feels late, how it misjudges goals, and where it begins."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import UserConfig, body_of, people_of
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.policies.hierarchical.human_goals import (
    GoalPerception,
    HumanGoals,
    describe_human,
)
from sim2vr_harness.policies.hierarchical.human_motor import (
    HumanHands,
    HumanMotorPolicy,
    people_policy,
)
from sim2vr_harness.policies.hierarchical.motor_goals import describe, tips
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
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
    return people_policy(user, STEP_S, width=16, body_width=8).requires_grad_(False)


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


def goals(policy: HumanMotorPolicy) -> HumanGoals:
    made = HumanGoals.none(USERS, 1)
    made.place[..., 0], made.place[..., 2] = 0.4, 1.2
    made.active += 1.0
    return made


def test_a_person_is_known_by_its_features(policy: HumanMotorPolicy, user: UserConfig) -> None:
    people = people_of(user)
    assert people is not None
    person = people.sample(0, 5)
    told = policy.persons.told(person.features)
    expected = (person.stature_m, person.stature_m * person.upper_arm_factor)
    assert told[9:11] == pytest.approx(expected, rel=1e-5)
    assert told[-2:] == pytest.approx((person.motor_noise, person.effort_weight), rel=1e-5)
    assert policy.persons.visual_delay_s(told) == pytest.approx(person.visual_delay_s, abs=1e-6)


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


def test_a_new_episode_starts_from_a_posture_that_is_known(
    policy: HumanMotorPolicy, user: UserConfig
) -> None:
    hands, target, now = HumanHands(policy, USERS), goals(policy), motion(policy, user, 2)
    hands.act(motion(policy, user, 1), target)
    hands.forget(np.arange(USERS))
    np.testing.assert_array_equal(
        hands.act(now, target)[0], HumanHands(policy, USERS).act(now, target)[0]
    )


def test_goals_are_misjudged_by_the_distance_seen_late() -> None:
    """5 % of the 0.4 m of two steps ago and 2 mm: 22 mm along each axis; of 0.1 m 7 mm."""
    drawn = torch.Generator().manual_seed(1)
    seen = GoalPerception(4000, 1, STEP_S, weber=0.05, least_m=0.002, late_steps=2, generator=drawn)
    far, near = torch.full((4000, 1), 0.4), torch.full((4000, 1), 0.1)
    seen.forget(torch.arange(4000), far)
    for distance, expected in ((near, 0.022), (near, 0.022), (near, 0.022), (near, 0.007)):
        assert float(seen.error().std()) == pytest.approx(expected, rel=0.05)
        seen.look(distance)


def test_it_begins_with_what_a_plain_policy_does(
    policy: HumanMotorPolicy, user: UserConfig
) -> None:
    """At 0.9 m/s, the least speed of approach: as a plain policy with so much time left."""
    plain = MotorPolicy(body_of(user), STEP_S, width=16)
    begun = copy.deepcopy(policy)
    begun.begin_with(plain)
    now, target = motion(policy, user, 4), goals(policy)
    now = replace(now, speeds=torch.zeros_like(now.speeds))
    placed = begun.places(now)
    far = (target.place - tips(placed[0], target.tip)).norm(dim=-1)
    timed = replace(target, left_s=(far / 0.9).clamp(0.05, 1.2))
    told = describe(timed, *placed).flatten(1)
    expected = plain(plain.observe(now.angles, now.speeds, now.drives, told))
    found = begun(begun.observe(now, describe_human(target, *placed)))[:, :-1]
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)


def test_it_is_kept_in_a_file(policy: HumanMotorPolicy, user: UserConfig, tmp_path: Path) -> None:
    file = tmp_path / "people.pt"
    save_motor_layer(file, policy, body="mobl_arms_wrist")
    again = load_human_policy(file, user, STEP_S)
    now, target = motion(policy, user, 4), goals(policy)
    np.testing.assert_array_equal(
        HumanHands(again, USERS).act(now, target)[0], HumanHands(policy, USERS).act(now, target)[0]
    )
    with pytest.raises(InputError, match="human motor policy"):
        load_motor_layer(file, body_of(user), STEP_S)
    plain = tmp_path / "plain.pt"
    save_motor_layer(plain, MotorPolicy(body_of(user), STEP_S, width=16))
    with pytest.raises(InputError, match="plain motor layer"):
        load_human_policy(plain, user, STEP_S)
