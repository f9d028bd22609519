"""The teacher: what it senses, its curriculum, its stage of PPO, and how it is judged."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch
from rich.console import Console
from short_cycles import short_cycles

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.policies.state_actor_critic import load_teacher, new_teacher
from sim2vr_harness.runs.config import TrainingConfig, apply_overrides
from sim2vr_harness.runs.run_folder import RunFolder, read_rows
from sim2vr_harness.runs.teacher_config import TeacherConfig, TeacherPolicyConfig
from sim2vr_harness.training.run.stage import run_stages
from sim2vr_harness.training.teacher import env as teacher_env
from sim2vr_harness.training.teacher.env import TeacherSimulation, blind_env
from sim2vr_harness.training.teacher.evaluation import _score, describe, evaluate_teacher
from sim2vr_harness.training.teacher.initial_states import InitialStates
from sim2vr_harness.training.teacher.stage import TeacherStage

pytest.importorskip("sim2vr_harness._app_runtime")

ENV = EnvConfig(app=AppConfig(options={"condition": "random"}), cores=1)
SMALL = (*("ppo.n_envs=4", "ppo.batch_size=20", "total_timesteps=160"),)


@pytest.fixture(autouse=True, scope="module")
def short_teacher() -> Iterator[None]:
    with short_cycles(n_epochs=2), patch.multiple(teacher_env, _STARTS_PER_CELL=1, _EPISODE_S=0.4):
        yield


def config(*overrides: str) -> TeacherConfig:
    return TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))


def simulation(*overrides: str, **how: Any) -> TeacherSimulation:
    return TeacherSimulation(ENV, config(*overrides), seed=3, **how)


def test_pictures_are_small_but_show_the_same_part_of_the_world() -> None:
    blind = blind_env(ENV)
    assert blind.app.renderer == "null"
    assert blind.vision.width / blind.vision.height == ENV.vision.width / ENV.vision.height
    assert blind.vision.width < ENV.vision.width
    assert blind.user == ENV.user


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


def test_a_game_without_privileged_numbers_has_no_teacher() -> None:
    env = EnvConfig(app=AppConfig(game="sample", options={}))
    with pytest.raises(InputError, match="recipe: got 'distill' for the game 'sample'"):
        TeacherSimulation(env, config(), seed=1)


def test_the_game_model_is_right_handed() -> None:
    env = EnvConfig.model_validate({"user": {"person": {"handedness": "left"}}})
    with pytest.raises(InputError, match="with the left hand, expected one with controller_right"):
        TeacherSimulation(env, config(), seed=1)


def test_near_starts_are_near_a_cell() -> None:
    users = simulation("curriculum.near_starts=1.0")
    users.reset(seeds=[1, 2, 3, 4])
    assert (users.senses.field("aid.start_distance_m") <= 0.08 + 1e-6).all()
    elbow = users.simulation.body.independent_joints.index("elbow_flexion")
    angles = users.simulation.users.qpos[:, users.simulation.body.qpos_independent[elbow]]
    assert ((angles >= 0.5) & (angles <= 1.9)).all()
    users.close()


def test_true_starts_are_the_reference_s() -> None:
    users = simulation("curriculum.near_starts=0.0")
    assert users.postures is None
    users.reset(seeds=[1, 2, 3, 4])
    free = users.simulation.body.qpos_independent
    assert (np.abs(users.simulation.users.qpos[:, free]) <= 0.05).all()
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


def test_actions_are_changes_of_activation_and_clipped() -> None:
    users = simulation()
    assert users.action_space.shape == (32,)
    ends = []
    for size in (1.0, 3.0):
        users.reset(seeds=[1, 2, 3, 4])
        users.step(np.full((4, 32), -size))
        ends.append(users.simulation.users.act)
    np.testing.assert_array_equal(*ends)
    users.close()


def test_hidden_fields_hide_the_own_body_s_too() -> None:
    users = simulation('hidden_fields=["aid.*", "* qacc", "DELT? act"]')
    names = users.senses.observed_names
    assert "elbow_flexion qvel" in names
    assert "nearest.life_s" in names
    assert not any(name.endswith("qacc") or name.startswith("DELT") for name in names)
    users.reset(seeds=[1, 2, 3, 4])
    seen = users.observation()[OBSERVATION]
    speeds = users.simulation.users.qvel[:, users.simulation.body.qvel_independent]
    np.testing.assert_allclose(seen[:, names.index("elbow_flexion qvel")], speeds[:, 3], rtol=1e-6)
    users.close()


def test_exploring_users_begin_near_a_cell_and_soon_again() -> None:
    users = simulation()
    users.explore(0.1)
    users.reset(seeds=[1, 2, 3, 4])
    assert (users.senses.field("aid.start_distance_m") <= 0.08 + 1e-6).mean() >= 0.5
    assert users._limit.max() <= 2
    users.explore(None)
    users.reset(ids=[0])
    assert users._limit[0] == 8
    users.close()


def test_the_true_rules_of_a_condition_are_known() -> None:
    users = simulation()
    rules = [users.describe(number).start for number in range(3)]
    assert [r["round.high"] for r in rules] == [0.0, 0.0, 1.0]
    assert all(r["round.max_targets"] == 3.0 for r in rules)
    assert all(r["round.strike_threshold_mps"] == pytest.approx(0.8) for r in rules)
    users.close()


def test_the_normaliser_knows_mean_and_variance_of_all_batches() -> None:
    users = simulation()
    policy = new_teacher(users.observation_space, users.action_space, TeacherPolicyConfig(), seed=1)
    users.close()
    rng = np.random.default_rng(1)
    size = policy.normaliser.features_dim
    parts = [rng.normal(3.0, 2.0, (n, size)).astype(np.float32) for n in (5, 100, 37)]
    for part in parts:
        policy.normaliser.update(torch.from_numpy(part))
    whole = np.concatenate(parts).astype(np.float64)
    np.testing.assert_allclose(policy.normaliser.mean, whole.mean(0), rtol=1e-6)
    np.testing.assert_allclose(policy.normaliser.variance, whole.var(0), rtol=1e-6)
    far = policy.normaliser({OBSERVATION: torch.full((1, size), 1e6)})
    assert (far == 8.0).all()


def test_the_policy_acts_within_the_student_s_range() -> None:
    users = simulation()
    policy = new_teacher(users.observation_space, users.action_space, TeacherPolicyConfig(), seed=1)
    users.reset(seeds=[1, 2, 3, 4])
    seen = users.observation()
    users.close()
    with torch.no_grad():
        policy.action_net.bias.fill_(5.0)  # a mean of 2.5
    assert (policy.act(seen, None) == 1.0).all()
    with torch.no_grad():
        policy.action_net.bias.fill_(0.0)
    mean = policy.act(seen, None)
    drawn = np.stack([policy.act(seen, np.random.default_rng(k)) for k in range(200)])
    assert np.abs(drawn).max() <= 1.0
    np.testing.assert_allclose(drawn.std(0).mean(), np.exp(-2.1), rtol=0.1)
    np.testing.assert_allclose(drawn.mean(0), mean, atol=0.1)


def stage(folder: Path, *overrides: str) -> TeacherStage:
    settings = config(*overrides)
    run = TrainingConfig(env=ENV, teacher=settings, seed=5, checkpoint={"every_steps": 40})
    return TeacherStage(run, folder, lambda policy: None)


def train(folder: Path, *overrides: str) -> dict[str, torch.Tensor]:
    made = stage(folder, *overrides)
    run_stages([made], RunFolder(folder.parent), Console(file=io.StringIO()))
    return weights(made.folder.latest_checkpoint())


def weights(path: Path) -> dict[str, torch.Tensor]:
    with zipfile.ZipFile(path) as archive:
        return torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)


def test_the_critic_learns_first(tmp_path: Path) -> None:
    with short_cycles(n_epochs=2, ppo_critic_first=3):
        train(tmp_path / "run")
    files = RunFolder(tmp_path / "run").checkpoints()
    assert [file.stem for file in files] == [f"step_{k:09d}" for k in (40, 80, 120, 160)]
    first, _, third, fourth = map(weights, files)
    moved = {key for key in first if not torch.equal(first[key], third[key])}
    actor = {key for key in first if "policy_net" in key or key.startswith(("action_net", "log"))}
    assert any("value_net" in key for key in moved)
    assert not moved & actor
    assert not torch.equal(fourth["action_net.weight"], third["action_net.weight"])


def test_a_loaded_teacher_acts_as_it_was_saved(tmp_path: Path) -> None:
    saved = train(tmp_path / "run", "total_timesteps=80")
    users = simulation()
    file = RunFolder(tmp_path / "run").latest_checkpoint()
    policy = load_teacher(file, users.observation_space, users.action_space, config().policy)
    users.close()
    assert all(torch.equal(value, saved[key]) for key, value in policy.state_dict().items())
    assert policy.normaliser.count == 80


def test_the_score_counts_whole_rounds_by_the_true_rules() -> None:
    quick = EnvConfig(app=AppConfig(options={"condition": "random", "round_seconds": 3.0}), cores=1)
    users = simulation()
    policy = new_teacher(users.observation_space, users.action_space, config().policy, seed=1)
    users.close()
    scores = evaluate_teacher(policy, quick, config(), rounds=2)
    assert [score.condition for score in scores] == ["low-medium", "medium", "high-medium"]
    for score in scores:
        assert score.rounds == 2
        assert len(score.cell_rates) == 9
        assert 0.0 <= score.success_rate <= 1.0
        assert score.effort > 0.0
    again = evaluate_teacher(policy, quick, config(), rounds=2)
    assert [score.game_return for score in again] == [score.game_return for score in scores]
    assert "worst cell" in describe(scores)


def test_what_a_score_counts_by_hand() -> None:
    outcomes = np.zeros((2, 2, 3))
    outcomes[0, :, 0] = [3, 1]  # first round, first cell: 3 hit, 1 missed
    outcomes[1, :, 2] = [0, 2]
    score = _score("medium", list(outcomes), effort=0.1, game_return=2.0)
    assert (score.rounds, score.successes, score.success_rate) == (2, 1.5, 0.5)
    assert score.cell_rates[0] == 0.75
    assert np.isnan(score.cell_rates[1])
    assert (score.cell_rates[2], score.worst_cell) == (0.0, 0.0)


def test_the_score_of_a_stage_is_written_down(tmp_path: Path) -> None:
    settings = ("total_timesteps=40", "conditions=[easy]")
    text = io.StringIO()
    with short_cycles(judged_rounds=1):
        made = stage(tmp_path / "run", *settings)
        run_stages([made], RunFolder(tmp_path), Console(file=text, width=200))
    (row,) = read_rows(tmp_path / "run" / "scores.jsonl")
    assert row["step"] == 40
    assert row["scores"][0]["condition"] == "easy"
    assert "Teacher: easy" in text.getvalue()


def test_rewards_are_the_task_s_scaled() -> None:
    users = simulation("reward_scale=0.5")
    users.reset(seeds=[1, 2, 3, 4])
    result = users.step(np.full((4, 32), 0.1, np.float32))
    task = [info["game_reward"] - info["effort_cost"] for info in result.infos]
    np.testing.assert_allclose(result.reward, 0.5 * np.array(task), atol=1e-12)
    assert max(info["effort_cost"] for info in result.infos) > 0.0
    users.close()
