"""The teacher's stage: its senses, its aids, its learner, and its exact resumption."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from rich.console import Console

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.training import teacher
from sim2vr_harness.training.config import apply_overrides
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.run_folder import RunFolder
from sim2vr_harness.training.start_postures import StartPostures
from sim2vr_harness.training.teacher_config import Ramp, TeacherConfig
from sim2vr_harness.training.teacher_env import OBSERVATION, TeacherSimulation, blind_env
from sim2vr_harness.training.teacher_policy import TeacherPolicy

pytest.importorskip("sim2vr_harness._app_runtime")

ENV = EnvConfig(app=AppConfig(options={"condition": "random"}), threads=1)
SMALL = (
    *("ppo.n_envs=4", "ppo.n_steps=10", "ppo.batch_size=20", "ppo.n_epochs=2"),
    *("ppo.critic_first_iterations=1", "ppo.net_arch=[16]"),
    *("total_timesteps=160", "coarse_until_step=80", "imagination.cycles=0"),
    *("aids.episode_seconds={start: 0.4, end: 0.4}", "aids.starts_per_cell=1"),
    *("evaluate_every_steps=1000000", "evaluate_rounds=0"),
)


def config(*overrides: str) -> TeacherConfig:
    return TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))


def simulation(*overrides: str, **how: Any) -> TeacherSimulation:
    return TeacherSimulation(ENV, config(*overrides), seed=3, **how)


def test_a_ramp_is_constant_linear_constant() -> None:
    ramp = Ramp(start=0.3, end=0.8, from_step=100, to_step=200)
    assert [ramp.at(step) for step in (0, 100, 150, 200, 900)] == [
        *(0.3, 0.3),
        pytest.approx(0.55),
        *(0.8, 0.8),
    ]
    assert Ramp(start=0.3, end=0.8).at(0) == 0.8
    with pytest.raises(ValueError, match="to_step: got 5, expected from_step=7 or more"):
        Ramp(start=0, end=1, from_step=7, to_step=5)


def test_the_task_is_the_true_one_in_the_end() -> None:
    aids, end = TeacherConfig().aids, TeacherConfig().total_timesteps
    assert aids.strike_threshold_mps.at(end) == 0.8
    assert aids.life_seconds.at(end) == 1.0
    assert aids.effort.at(end) == 1.0


def test_pictures_are_small_but_show_the_same_part_of_the_world() -> None:
    blind = blind_env(ENV, 0.005)
    assert blind.app.renderer == "null"
    assert blind.vision.width / blind.vision.height == ENV.vision.width / ENV.vision.height
    assert blind.vision.width < ENV.vision.width
    assert blind.user.timestep_s == 0.005
    assert blind_env(ENV).user.timestep_s is None


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


def test_near_starts_are_near_a_cell() -> None:
    users = simulation("aids.near_starts={start: 1.0, end: 1.0}")
    users.reset(seeds=[1, 2, 3, 4])
    assert (users.senses.field("aid.start_distance_m") <= 0.08 + 1e-6).all()
    elbow = users.simulation.body.independent_joints.index("elbow_flexion")
    angles = users.simulation.users.qpos[:, users.simulation.body.qpos_independent[elbow]]
    assert ((angles >= 0.5) & (angles <= 1.9)).all()
    users.close()


def test_true_starts_are_the_reference_s() -> None:
    users = simulation("aids.near_starts={start: 0.0, end: 0.0}")
    assert users.postures is None
    users.reset(seeds=[1, 2, 3, 4])
    free = users.simulation.body.qpos_independent
    assert (np.abs(users.simulation.users.qpos[:, free]) <= 0.05).all()
    users.close()


def test_postures_are_drawn_by_the_cells_weights() -> None:
    one, two = np.full((3, 7), 1.0), np.full((2, 7), 2.0)
    postures = StartPostures({"medium": {1: one, 4: two, 5: np.zeros((0, 7))}, "low": {}})
    assert postures.counts("medium") == {1: 3, 4: 2, 5: 0}
    weights = np.zeros(9)
    weights[[1, 4, 5]] = [0.25, 0.75, 5.0]
    rng = np.random.default_rng(1)
    drawn = [float(postures.draw("medium", weights, rng)[0]) for _ in range(400)]  # type: ignore[index]
    assert abs(drawn.count(2.0) - 300) < 40
    assert postures.draw("low", weights, rng) is None


def test_the_reward_is_the_task_s_plus_the_aids() -> None:
    """Without aids, and with effort's share 0, what is left is the game's, scaled."""
    off = [f"aids.{name}={{start: 0, end: 0}}" for name in ("progress", "strike", "straight_elbow")]
    users = simulation(*off, "aids.effort={start: 0, end: 0}", "ppo.reward_scale=0.5")
    users.reset(seeds=[1, 2, 3, 4])
    result = users.step(np.full((4, 32), 0.1, np.float32))
    game = [info["game_reward"] for info in result.infos]
    np.testing.assert_allclose(result.reward, 0.5 * np.array(game), atol=1e-12)
    users.close()

    on = "aids.straight_elbow={start: 0.3, end: 0.3}"
    users = simulation(*off[:2], on, "ppo.reward_scale=1.0", "aids.near_starts={start: 0, end: 0}")
    users.reset(seeds=[1, 2, 3, 4])
    result = users.step(np.zeros((4, 32), np.float32))
    elbow = users.simulation.body.independent_joints.index("elbow_flexion")
    angles = users.simulation.users.qpos[:, users.simulation.body.qpos_independent[elbow]]
    for i, info in enumerate(result.infos):
        task = info["game_reward"] - info["effort_cost"]
        assert result.reward[i] == pytest.approx(task - 0.3 * max(0.0, 0.5 - angles[i]))
    users.close()


def test_progress_is_paid_by_the_metre() -> None:
    users = simulation(
        "aids.progress={start: 10, end: 10}",
        "aids.strike={start: 0, end: 0}",
        "aids.straight_elbow={start: 0, end: 0}",
        "ppo.reward_scale=1.0",
        "aids.episode_seconds={start: 5, end: 5}",
    )
    users.reset(seeds=[1, 2, 3, 4])
    paid = 0.0
    for step in range(12):
        before = users.senses.field("aid.progress_m")
        # The first episodes end at different times; only those that go on are compared.
        result = users.step(np.full((4, 32), 0.5 if step % 2 else -0.5, np.float32))
        after = users.senses.field("aid.progress_m")
        task = np.array([info["game_reward"] - info["effort_cost"] for info in result.infos])
        np.testing.assert_allclose(result.reward - task, 10.0 * (after - before), atol=1e-4)
        paid += float(np.abs(after - before).sum())
        ended = np.flatnonzero(result.truncated | result.terminated)
        if len(ended):
            users.reset(ids=[int(i) for i in ended])
    assert paid > 0.0
    users.close()


def test_failing_cells_come_up_more_often() -> None:
    users = simulation("aids.failing_cells={start: 0.5, end: 0.5}")
    users.fail_rates[1] = 0.0
    users.fail_rates[1, 6] = 1.0
    weights = users._options(1)["spawn_weights"]
    assert weights[6] == pytest.approx(0.5 / 9 + 0.5, rel=0.02)
    assert weights[0] == pytest.approx(0.5 / 9, rel=0.02)
    assert sum(weights) == pytest.approx(1.0)
    # 3 of 4 missed: (1 - 0.97^4) of the way to 0.75.
    users._condition[0] = 2
    users.fail_rates[2, 5] = 0.0
    users._remember_failures(0, {"hitsTarget5": 1.0, "missesTarget5": 3.0})
    assert users.fail_rates[2, 5] == pytest.approx((1 - 0.97**4) * 0.75)
    users.close()


def test_the_rules_follow_the_ramps() -> None:
    users = simulation("aids.strike_threshold_mps={start: 0.2, end: 0.8, to_step: 40}")
    assert users._options(0)["strike_threshold_mps"] == pytest.approx(0.2)
    users.reset(seeds=[1, 2, 3, 4])
    column = users.senses.field("round.strike_threshold_mps")
    np.testing.assert_allclose(column, 0.2)
    for _ in range(10):
        result = users.step(np.zeros((4, 32), np.float32))
        ended = np.flatnonzero(result.truncated | result.terminated)
        if len(ended):
            users.reset(ids=[int(i) for i in ended])
    users.reset()
    np.testing.assert_allclose(users.senses.field("round.strike_threshold_mps"), 0.8)
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


def test_the_game_tells_a_condition_s_true_rules() -> None:
    users = simulation("aids.strike_threshold_mps={start: 0.3, end: 0.3}")
    told = [users.told_of(number) for number in range(3)]
    assert [t["round.high"] for t in told] == [0.0, 0.0, 1.0]
    assert all(t["round.max_targets"] == 3.0 for t in told)
    assert all(t["round.strike_threshold_mps"] == pytest.approx(0.8) for t in told)
    users.close()


def test_the_normaliser_knows_mean_and_variance_of_all_batches() -> None:
    users = simulation()
    policy = TeacherPolicy(users.observation_space, users.action_space, lambda _: 1e-3)
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
    policy = TeacherPolicy(users.observation_space, users.action_space, lambda _: 1e-3)
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


def train(folder: Path, stop: int | None = None, *overrides: str) -> teacher.TeacherResult:
    console = Console(file=io.StringIO())
    return teacher.train_teacher(
        config(*overrides), ENV, folder, seed=5, timesteps=stop, console=console
    )


def weights(path: Path) -> dict[str, torch.Tensor]:
    with zipfile.ZipFile(path) as archive:
        return torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)


@pytest.mark.parametrize("stop", [40, 80, 120])  # in, at the end of, and after the coarse physics
def test_a_resumed_teacher_is_bit_identical(tmp_path: Path, stop: int) -> None:
    whole = train(tmp_path / "whole")
    first = train(tmp_path / "parts", stop)
    assert (whole.step, first.step) == (160, stop)
    parts = train(tmp_path / "parts")
    one, other = weights(whole.checkpoint), weights(parts.checkpoint)
    assert all(torch.equal(one[key], other[key]) for key in one)
    assert not all(torch.equal(one[key], value) for key, value in weights(first.checkpoint).items())
    assert train(tmp_path / "parts").step == 160  # nothing left to do


def test_the_critic_learns_first(tmp_path: Path) -> None:
    # The first rollout fills the statistics; iterations 2 and 3 are the critic's.
    settings = "ppo.critic_first_iterations=3"
    train(tmp_path / "run", 40, settings)
    first = _newest(tmp_path / "run")
    train(tmp_path / "run", 120, settings)
    third = _newest(tmp_path / "run")
    moved = {key for key in first if not torch.equal(first[key], third[key])}
    actor = {key for key in first if "policy_net" in key or key.startswith(("action_net", "log"))}
    assert any("value_net" in key for key in moved)
    assert not moved & actor
    train(tmp_path / "run", 160, settings)
    fourth = _newest(tmp_path / "run")
    assert not torch.equal(fourth["action_net.weight"], third["action_net.weight"])


def _newest(folder: Path) -> dict[str, torch.Tensor]:
    return weights(RunFolder(folder).latest_checkpoint())


def test_a_folder_keeps_its_teacher_s_settings(tmp_path: Path) -> None:
    train(tmp_path / "run", 40)
    with pytest.raises(InputError, match="a teacher of other settings"):
        train(tmp_path / "run", 80, "ppo.gamma=0.9")
    file = tmp_path / "run" / "teacher.yaml"
    settings = yaml.safe_load(file.read_text())
    del settings["teacher"]["imagination"]["stuck_cost"]  # as if it were younger than the run
    file.write_text(yaml.safe_dump(settings))
    assert train(tmp_path / "run", 80).step == 80
    settings["teacher"]["unheard_of"] = 1
    file.write_text(yaml.safe_dump(settings))
    with pytest.raises(InputError, match="a teacher of other settings"):
        train(tmp_path / "run", 80)


def test_a_loaded_teacher_acts_as_it_was_saved(tmp_path: Path) -> None:
    result = train(tmp_path / "run", 80)
    policy = teacher.load_teacher(result.checkpoint, config(), ENV)
    saved = weights(result.checkpoint)
    assert all(torch.equal(value, saved[key]) for key, value in policy.state_dict().items())
    assert policy.normaliser.count == 80


def test_the_score_counts_whole_rounds_by_the_true_rules() -> None:
    quick = EnvConfig(
        app=AppConfig(options={"condition": "random", "round_seconds": 3.0}), threads=1
    )
    users = simulation()
    policy = TeacherPolicy(users.observation_space, users.action_space, lambda _: 1e-3)
    users.close()
    scores = teacher.evaluate_teacher(policy, quick, config(), rounds=2)
    assert [score.condition for score in scores] == ["low-medium", "medium", "high-medium"]
    for score in scores:
        assert score.rounds == 2
        assert len(score.cell_rates) == 9
        assert 0.0 <= score.hit_rate <= 1.0
        assert score.effort > 0.0
    again = teacher.evaluate_teacher(policy, quick, config(), rounds=2)
    assert [score.game_return for score in again] == [score.game_return for score in scores]
    assert "worst cell" in teacher.describe(scores)
