"""The training of human motor policies, and its measures, against numbers worked out by hand."""

import numpy as np
import pytest
import torch

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.policies.hierarchical.human_motor import HumanHands
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals
from sim2vr_harness.policies.hierarchical.motor_store import human_policy_for
from sim2vr_harness.runs.option_config import PeopleTraining
from sim2vr_harness.training.motor_control.people_training import Bodies, PeopleTrainer

TINY = PeopleTraining(
    cycles=2, bodies=4, random_steps=24, goal_steps=12, fit_minibatches=3, body_width=16
)
SHIPPED = ("mobl_arms_wrist", "mobl_arms_bimanual")
"""Bodies with a human motor policy of their own."""


def trainer(body: str = "mobl_arms_wrist") -> PeopleTrainer:
    return PeopleTrainer(TINY, as_population(UserConfig(model=body)), 0.05, threads=1, seed=4)


@pytest.mark.parametrize("body", SHIPPED)
def test_shipped_persons_bring_hands_to_places_and_stay(body: str) -> None:
    """Six persons, places before the shoulders, m; two hands go at the same time."""
    user = as_population(UserConfig(model=body))
    policy, bodies = human_policy_for(user, 0.05), Bodies(user, 6, 0.05, 1)
    hands, goals = HumanHands(policy, 6), MotorGoals.none(6, len(policy.hands))
    middle = bodies.body.joint_ranges.mean(1)
    rngs = [np.random.default_rng(i) for i in range(6)]
    persons = [bodies.people.sample(7924, k) for k in range(6)]  # of no training
    bodies.users.reset(np.arange(6), rngs, [middle] * 6, persons)
    goals.active += 1.0
    right = torch.tensor([[0.44, -0.2, 1.1], [0.44, -0.4, 1.0], [0.3, -0.2, 0.9]]).repeat(2, 1)
    both = torch.stack([right, right * torch.tensor([1.0, -1.0, 1.0])], 1)
    goals.place = both[:, : len(policy.hands)]
    for _ in range(40):
        now = hands.motion(bodies.users, policy.persons.of(bodies))  # type: ignore[arg-type]
        bodies.users.step(hands.act(now, goals)[0])
    there = np.stack([bodies.users.device_poses(name)[0] for name in policy.hands], 1)
    off = np.linalg.norm(there - goals.place.numpy(), axis=-1)
    assert np.median(off) < 0.02 and off.max() < 0.06, off


def test_persons_strike_through_places_at_speed() -> None:
    """Of 12 persons at rest, half pass within 4 cm of a place before them at 0.8 m/s."""
    user = as_population(UserConfig())
    policy, bodies = human_policy_for(user, 0.05), Bodies(user, 12, 0.05, 1)
    hands, goals = HumanHands(policy, 12), MotorGoals.none(12, 1)
    rngs = [np.random.default_rng(i) for i in range(12)]
    persons = [bodies.people.sample(7924, k) for k in range(12)]
    bodies.users.reset(np.arange(12), rngs, [bodies.body.joint_ranges.mean(1)] * 12, persons)
    place = np.array([0.44, -0.2, 1.1])
    way = torch.from_numpy(place - bodies.users.device_poses(policy.hands[0])[0]).float()
    goals.velocity[:, 0] = 1.3 * torch.nn.functional.normalize(way, dim=1)
    goals.place[:, 0], goals.active[:] = torch.from_numpy(place).float(), 1.0
    passed = np.zeros(12, bool)
    for _ in range(24):
        now = hands.motion(bodies.users, policy.persons.of(bodies))  # type: ignore[arg-type]
        bodies.users.step(hands.act(now, goals)[0], pose_samples=5)
        path = np.stack([bodies.users.device_poses(policy.hands[0], k)[0] for k in range(5)])
        speed = np.linalg.norm(np.diff(path, axis=0), axis=-1) / 0.01
        passed |= ((np.linalg.norm(path[1:] - place, axis=-1) < 0.04) & (speed > 0.8)).any(0)
    assert passed.mean() >= 0.5, passed
