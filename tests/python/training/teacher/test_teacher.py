"""The teacher: what it senses, its curriculum, and how it acts."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.policies.teacher import load_teacher, new_teacher
from sim2vr_harness.runs.checkpoint import write_tensors
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher import env as teacher_env
from sim2vr_harness.training.teacher.env import InitialStates, TeacherSimulation

ENV = EnvConfig(app=AppConfig(options={"condition": "random"}), cores=1)
SMALL = ("imagined.n_envs=4",)


@pytest.fixture(autouse=True, scope="module")
def short_teacher() -> Iterator[None]:
    with patch.multiple(teacher_env, _STARTS_PER_CELL=1, _EPISODE_S=0.4):
        yield


def config(*overrides: str) -> TeacherConfig:
    return TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))


def simulation(*overrides: str, **how: Any) -> TeacherSimulation:
    return TeacherSimulation(ENV, config(*overrides), seed=3, **how)


def test_the_observation_hides_the_aids() -> None:
    users = simulation()
    names = users.senses.observed_names
    assert users.observation_space[OBSERVATION].shape == (len(names),)
    assert "hammer.strike_mps" in names
    assert "cell4.life_s" in names
    assert not any(name.startswith("aid.") for name in names)
    assert "round.elapsed_s" not in names
    users.reset(seeds=[1, 2, 3, 4])
    observation = users.observation()[OBSERVATION]
    low, mid, high = (
        observation[:, names.index(f"round.{name}")] for name in ("low", "mid", "high")
    )
    np.testing.assert_array_equal(np.stack([low, mid, high]), np.eye(3)[:, [0, 1, 2, 0]])
    users.close()


def test_near_starts_are_near_a_cell() -> None:
    users = simulation("curriculum.near_starts=1.0")
    users.reset(seeds=[1, 2, 3, 4])
    assert (users.senses.field("aid.start_distance_m") <= 0.08 + 1e-6).all()
    elbow = users.simulation.body.independent_joints.index("elbow_flexion")
    angles = users.simulation.users.qpos[:, users.simulation.body.qpos_independent[elbow]]
    assert ((angles >= 0.5) & (angles <= 1.9)).all()
    users.close()


def test_postures_are_drawn_by_the_cells_weights() -> None:
    one, two = np.full((3, 7), 1.0), np.full((2, 7), 2.0)
    postures = InitialStates({"medium": {1: one, 4: two, 5: np.zeros((0, 7))}, "low": {}})
    assert postures.counts("medium") == {1: 3, 4: 2, 5: 0}
    weights = np.zeros(9)
    weights[[1, 4, 5]] = [0.25, 0.75, 5.0]
    rng = np.random.default_rng(1)
    drawn = [float(postures.draw("medium", weights, rng)[0]) for _ in range(400)]  # type: ignore[index]
    assert abs(drawn.count(2.0) - 300) < 40
    assert postures.draw("low", weights, rng) is None


def test_failing_cells_come_up_more_often() -> None:
    users = simulation()
    users.fail_rates[1] = 0.0
    users.fail_rates[1, 6] = 1.0
    weights = users._options(1)["spawn_weights"]
    assert weights[6] == pytest.approx(0.7 / 9 + 0.3, rel=0.02)
    assert weights[0] == pytest.approx(0.7 / 9, rel=0.02)
    assert sum(weights) == pytest.approx(1.0)
    # 3 of 4 missed: (1 - 0.97^4) of the way to 0.75.
    users._condition[0] = 2
    users.fail_rates[2, 5] = 0.0
    users._remember_failures(0, {"hitsTarget5": 1.0, "missesTarget5": 3.0})
    assert users.fail_rates[2, 5] == pytest.approx((1 - 0.97**4) * 0.75)
    users.close()


def test_numbers_are_normalised_and_cut() -> None:
    users = simulation()
    policy = new_teacher(users.observation_space, users.action_space, seed=1)
    users.close()
    policy.normaliser.mean.fill_(3.0)
    policy.normaliser.variance.fill_(4.0)
    size = len(policy.normaliser.mean)
    told = torch.tensor([3.0, 4.0, -1e6])[:, None].expand(3, size)
    with torch.no_grad():
        normal = policy.normaliser({OBSERVATION: told})
    np.testing.assert_allclose(normal[:, 0], [0.0, 0.5, -8.0], atol=1e-6)


def test_a_loaded_teacher_acts_as_it_was_saved(tmp_path: Path) -> None:
    users = simulation()
    spaces = users.observation_space, users.action_space
    saved, file = new_teacher(*spaces, seed=1), tmp_path / "policy.pt"
    users.reset(seeds=[1, 2, 3, 4])
    seen = users.observation()
    users.close()
    saved.normaliser.mean.fill_(0.5)
    write_tensors(file, saved.state_dict())
    np.testing.assert_array_equal(load_teacher(file, *spaces).act(seen), saved.act(seen))
    weights = saved.state_dict()
    del weights["action_net.bias"]
    write_tensors(file, weights)
    with pytest.raises(InputError, match=r"policy.pt.*expected the weights of imagined rollouts"):
        load_teacher(file, *spaces)
