"""Does imagined pointing play by the true game's rules? Both see the same users."""

from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch
from true_users import worn_by

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.games.pointing.game import FIELDS, ImaginedPointing
from sim2vr_harness.games.pointing.settings import GameModelSettings
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher import env as teacher_env
from sim2vr_harness.training.teacher.env import TeacherSimulation

N, STEPS, STEP_S = 24, 150, 0.05
# Large targets, so that random play hits; one block again and again, so that both play the same.
OPTIONS: dict[str, Any] = {
    "targets": 5,
    "distances_m": [0.25],
    "widths_m": [0.30],
    "height_m": -0.15,
    "repeats": 100,
    "timeout_seconds": 1.5,
    "error_cost": 3.0,
}


@pytest.fixture(autouse=True, scope="module")
def short_teacher() -> Iterator[None]:
    with patch.multiple(teacher_env, _STARTS_PER_CELL=8, _EPISODE_S=60.0):
        yield


@pytest.fixture(scope="module")
def played() -> dict[str, Any]:
    """Users who begin near targets and move about at random, in the true game and in the model."""
    settings = [f"imagined.n_envs={N}", "curriculum.near_starts=1.0", "conditions=[near]"]
    config = TeacherConfig.model_validate(apply_overrides({}, settings))
    app = AppConfig(game="pointing", options=OPTIONS)
    sim = TeacherSimulation(EnvConfig(app=app, cores=1), config, seed=1)
    conditions = [sim.describe(0)]
    game = ImaginedPointing(N, conditions, GameModelSettings(), frame_s=STEP_S, seed=1)
    sim.reset(seeds=list(range(N)))
    sim._limit[:] = STEPS + 1  # no round is cut
    columns = [sim.senses.names.index(name) for name in FIELDS]
    fields = torch.tensor(sim.senses.values()[:, columns], dtype=torch.float32)
    everyone = torch.arange(N)
    game.calibrate(worn_by(sim), fields)
    game.start(everyone, worn_by(sim), fields, everyone)
    game.begin(everyone)
    told = [sim.senses.names.index(name) for name in game.names]
    soft = game.settings.relaxation(1.0)
    rng = np.random.default_rng(3)
    wild = np.zeros((N, 32))
    imagined, true, scores, rewards = [], [], [], []
    for _ in range(STEPS):
        wild = 0.8 * wild + 0.6 * rng.standard_normal(wild.shape)
        result = sim.step(0.5 * wild + 0.3 * (0.1 - sim.simulation.users.act))
        place = worn_by(sim)
        game.play(place[:, None], soft)
        imagined.append(game.observe(place).numpy())
        true.append(sim.senses.values()[:, told])
        scores.append(game.score.numpy())
        rewards.append(result.reward + result.effort_cost)
    logs = [dict(log) for log in sim.simulation.logs]
    sim.close()
    return {
        "names": game.names,
        "imagined": np.array(imagined),
        "true": np.array(true),
        "scores": np.array(scores),
        "rewards": np.array(rewards),
        "counts": game.counts[:, 0, 0].numpy(),
        "logs": logs,
        "stylus": game.stylus.fixed,
    }


def test_the_tip_lies_on_the_grips_axis(played: dict[str, Any]) -> None:
    """10 cm in front of the grip, straight ahead, as the game's page says."""
    expected = torch.tensor([0.10, 0.0, 0.0])
    torch.testing.assert_close(played["stylus"], expected, atol=2e-3, rtol=0.0)


def test_hits_and_failures_are_the_same(played: dict[str, Any]) -> None:
    hits, failures = (sum(log[key] for log in played["logs"]) for key in ("Points", "Failures"))
    timeouts = sum(log["Timeouts"] for log in played["logs"])
    assert hits >= 10
    assert timeouts >= 10
    assert failures - timeouts >= 10
    # A tap that grazes a target's edge, or the plane, may differ.
    np.testing.assert_allclose(played["counts"], [hits, failures], atol=1)


def test_rewards_are_the_same(played: dict[str, Any]) -> None:
    """Every user step's, wherever both have the same target."""
    wrong = np.abs(played["scores"] - played["rewards"])
    assert (wrong < 1e-3).mean() > 0.99
    assert np.abs(played["rewards"]).max() > 9.0


def test_teachers_observe_the_same(played: dict[str, Any]) -> None:
    names = list(played["names"])
    wrong = np.abs(played["imagined"] - played["true"])
    goal = [names.index(f"target.{axis}_m") for axis in "xyz"]
    alike = (wrong[:, :, goal] < 5e-3).all(-1)
    assert alike.mean() > 0.99
    for i, name in enumerate(names):
        assert float(wrong[:, :, i][alike].max()) < 2e-3, name
