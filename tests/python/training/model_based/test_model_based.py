"""Imagined rollouts: do the imagined body and game do what the true ones do?"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch
from short_cycles import short_cycles
from tiny_game_training import new_rollouts
from true_users import motion_of

from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.games.whacamole.game import FIELDS
from sim2vr_harness.games.whacamole.settings import Relaxation
from sim2vr_harness.training.model_based.stage import GameTrainer
from sim2vr_harness.training.teacher import env as teacher_env
from sim2vr_harness.users.noise import MotorNoise, MotorNoiseSettings
from sim2vr_harness.world_models.rollout_env import ImaginedNoise
from sim2vr_harness.world_models.transitions import Motion, TransitionStore

SOFT = Relaxation(overlap_m=0.01, speed_mps=0.2, near=1.0, distance=1.0)


@pytest.fixture(autouse=True, scope="module")
def short_teacher() -> Iterator[None]:
    starts = patch.object(teacher_env, "_STARTS_PER_CELL", 2)
    with starts, short_cycles(updates=3, critic_first=1):
        yield


@pytest.fixture(scope="module")
def rollouts() -> GameTrainer:
    """After its first cycle, in which users of the true game moved about at random."""
    made = new_rollouts()
    made.step()
    return made


def experience(rollouts: GameTrainer) -> TransitionStore:
    return rollouts._seen[0]


def test_the_game_model_observes_what_the_true_game_says(rollouts: GameTrainer) -> None:
    """The same moment, in both: every number that a teacher observes."""
    sim = rollouts.task.simulation
    users, game = rollouts.task.imagine(16)
    game.hammer.fixed = rollouts.task.game.hammer.fixed
    sim.explore(5.0)
    sim.reset(seeds=list(range(16)))
    sim.explore(None)
    rng = np.random.default_rng(3)
    for _ in range(30):
        result = sim.step(0.3 * rng.standard_normal((16, 32)))
        ended = np.flatnonzero(result.terminated | result.truncated)
        if len(ended):
            sim.reset([int(i) for i in ended])
    true_users = sim.simulation.users
    motion = motion_of(true_users, rollouts.body.drives)
    columns = [sim.senses.names.index(name) for name in FIELDS]
    fields = torch.tensor(sim.senses.values()[:, columns], dtype=torch.float32)
    everyone = torch.arange(16)
    users.start(everyone, motion)
    game.start(everyone, users.place, fields, torch.full((16,), -1))
    life = np.stack([sim.senses.field(f"cell{c}.life_s") for c in range(9)], 1)
    there = np.stack([sim.senses.field(f"cell{c}.present") for c in range(9)], 1)
    ages = np.where(there > 0, np.round((1.098 - life) / 0.05), -1)
    game._age = torch.tensor(ages, dtype=torch.long)
    names = [*users.names, *game.names]
    seen = torch.cat([users.observe(), game.observe(users.place)], 1)
    imagined = seen[:, [names.index(name) for name in sim.senses.observed_names]].numpy()
    true = sim.observation()[OBSERVATION]
    assert there.sum() > 10
    for i, name in enumerate(sim.senses.observed_names):
        # Where couplings yield, the hammer is turned by some hundredths.
        tolerance = 0.04 if name.startswith("hammer") else 0.01
        np.testing.assert_allclose(imagined[:, i], true[:, i], atol=tolerance, err_msg=name)
    overlap = np.stack([sim.senses.field(f"cell{c}.overlap") for c in range(9)], 1)
    assert ((overlap == 0) | (there > 0)).all()


def test_the_reward_s_gradient_is_that_of_finite_differences(rollouts: GameTrainer) -> None:
    steps = experience(rollouts).rows(torch.arange(0, 60, 10))
    places = rollouts.body.places(steps.after.angles, steps.after.persons)

    def total(actions: torch.Tensor) -> torch.Tensor:
        users, game = rollouts.task.imagine(6)
        game.hammer.fixed = rollouts.task.game.hammer.fixed
        users.start(torch.arange(6), steps.after)
        game.start(torch.arange(6), places, steps.fields, torch.tensor([4, 4, 1, 3, 5, 7]))
        worth = torch.zeros(())
        for change in actions:
            users.step(change, error_share=0.0)
            reward = game.play(users.places(1), SOFT)
            worth = worth + (reward - sum(users.costs())).sum()
        return worth

    generator = torch.Generator().manual_seed(1)
    actions = 0.05 * torch.randn(4, 6, 32, generator=generator)
    actions.requires_grad_(True)
    total(actions).backward()
    direction = torch.randn(4, 6, 32, generator=generator)
    with torch.no_grad():
        h = 2e-3
        slope = (total(actions + h * direction) - total(actions - h * direction)) / (2.0 * h)
    assert actions.grad is not None
    expected = float((actions.grad * direction).sum())
    assert abs(expected) > 1e-3
    assert float(slope) == pytest.approx(expected, rel=0.05)


def test_what_a_motion_costs_by_hand(rollouts: GameTrainer) -> None:
    users, _ = rollouts.task.imagine(2)
    low, high = rollouts.task.simulation.simulation.body.joint_ranges.T
    angles = torch.tensor(np.stack([(low + high) / 2.0] * 2), dtype=torch.float32)
    angles[1, 0] = float(high[0] + 0.1 * (high[0] - low[0]))  # 0.2 of half its range beyond
    speeds, act = torch.zeros(2, 7), torch.zeros(2, 32)
    speeds[1, 3], act[1, 0] = -25.0, 0.8  # 10 rad/s beyond what is wild
    users.start(torch.arange(2), Motion(angles, speeds, act, torch.zeros(2, 0)))
    costs = torch.stack(users.costs())
    assert costs[:, 0].tolist() == [0.0, 0.0, 0.0]
    expected = [0.1 * 0.8**2 / 32, 0.5 * 0.2, 0.02 * 10.0]
    torch.testing.assert_close(costs[:, 1], torch.tensor(expected), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("colour", ["white", "red"])
def test_imagined_motor_noise_is_as_large_as_the_users(colour: Any) -> None:
    """Of 0.3: 0.103 of it for each muscle apart, 0.02 for all alike; red adds up."""
    settings = MotorNoiseSettings(signal_dependent=colour, constant=colour)
    settings = replace(settings, constant_level=0.02)  # so that nothing is cut off
    n, steps = 4000, 2
    imagined_noise, true = ImaginedNoise(settings, n, 3), MotorNoise(settings, n, 3)
    control = torch.full((n, 3), 0.3, requires_grad=True)
    torch.manual_seed(1)
    for _ in range(steps):
        noised = imagined_noise.apply(control)
        noisy = true.apply(np.full((n, 3), 0.3), range(n))
    often = steps if colour == "red" else 1
    shared = often * 0.02**2
    expected = np.full((3, 3), shared) + np.eye(3) * often * (0.103 * 0.3) ** 2
    for got in (noised.detach().numpy(), noisy):
        np.testing.assert_allclose(np.cov(got.T), expected, atol=0.08 * expected[0, 0])
        np.testing.assert_allclose(got.mean(0), 0.3, atol=0.003)
    (noised.sum() / n).backward()
    assert control.grad is not None
    assert float(control.grad.sum()) == pytest.approx(3.0, abs=0.01)  # more control is more
    imagined_noise.forget(torch.arange(n))
    assert not any(float(value.abs().max()) for value in imagined_noise.state_dict().values())


def test_imagined_rollouts_move_the_actor_alone(rollouts: GameTrainer) -> None:
    before = {key: value.clone() for key, value in rollouts.task.policy.state_dict().items()}
    rollouts.step()
    after = rollouts.task.policy.state_dict()
    moved = {key for key in before if not torch.equal(before[key], after[key])}
    assert "action_net.weight" in moved
    assert all(key.startswith(("hidden.", "action_net.")) for key in moved)


def test_the_cycle_that_played_best_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    made = new_rollouts("imagined.cycles=3", "imagined.keep_best=true")
    rates = iter([math.nan, 0.2, 0.6, 0.1])

    def measured() -> None:
        made.task.success_rates = (next(rates), math.nan)

    monkeypatch.setattr(made.task, "end_collecting", measured)
    after = []
    for _ in range(3):
        made.step()
        after.append({k: v.clone() for k, v in made.task.policy.state_dict().items()})
    # What plays in a cycle was learned in the one before it.
    for name, value in after[1].items():
        torch.testing.assert_close(after[2][name], value, rtol=0.0, atol=0.0)
    assert any(not torch.equal(after[0][name], after[1][name]) for name in after[1])
    assert made.state_dict()["best"][0] == 0.6
    made.task.simulation.close()
