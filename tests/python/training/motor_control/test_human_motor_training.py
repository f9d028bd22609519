"""The training of human motor policies, and its measures, against numbers worked out by hand."""

import numpy as np
import pytest
import torch

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.policies.hierarchical.human_motor import HumanGoals, HumanHands
from sim2vr_harness.policies.hierarchical.motor_store import human_policy_for
from sim2vr_harness.runs.option_config import PeopleTraining
from sim2vr_harness.training.motor_control.people_training import (
    Bodies,
    PeopleTrainer,
    ending,
)

TINY = PeopleTraining(
    cycles=2,
    bodies=4,
    random_steps=24,
    goal_steps=12,
    fit_minibatches=3,
    updates=2,
    width=16,
    body_width=16,
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
    hands, goals = HumanHands(policy, 6), HumanGoals.none(6, len(policy.hands))
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


def test_a_movement_ends_well_in_its_target_and_at_its_speed() -> None:
    """On the edge of a target half; at rest there and not, and at the speed that was asked for."""
    goals, way, velocity = HumanGoals.none(5, 1), torch.zeros(5, 1, 3), torch.zeros(5, 1, 3)
    goals.width[:] = 0.04
    way[:, 0, 0] = torch.tensor([0.0, 0.02, 0.05, 0.0, 0.0])
    goals.velocity[4, 0, 0], goals.stops[4] = 1.0, 0.0
    velocity[3:, 0, 0] = 1.0
    succeeds, off, wrong = ending(way, velocity, goals)
    assert succeeds[:3, 0].tolist() == pytest.approx([0.985, 0.5, 0.002], abs=0.01)
    assert float(succeeds[3]) < 1e-6 < 0.95 < float(succeeds[4])
    assert off[:3, 0].tolist() == pytest.approx([0.0, 0.02, 0.05], abs=2e-4)
    assert wrong[3:, 0].tolist() == pytest.approx([1.0, 0.0], abs=0.01)
