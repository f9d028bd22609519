from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_simulation import FakeSimulation

from sim2vr_harness.evaluation import evaluate as module
from sim2vr_harness.evaluation.evaluate import Request, evaluate, evaluation_env
from sim2vr_harness.evaluation.metrics import METRICS, RoundResult, round_result, summarise
from sim2vr_harness.evaluation.player import Player
from sim2vr_harness.evaluation.rollouts import Job, jobs_for, play
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.run_folder import RunFolder
from sim2vr_harness.training.trained_users import find_user


def play_with(trained: Path, request: Request, **how: Any) -> module.Evaluation:
    return evaluate(trained, request, simulation=FakeSimulation, **how)


def result(hits: float, misses: float, **log: float) -> RoundResult:
    return round_result(
        condition="medium",
        episode=0,
        seed=1,
        steps=1200,
        game_return=100.0,
        effort=20.0,
        info={"termination": "finished", "max_fatigued": 0.2},
        log={"Points": hits, "Misses": misses, "Contacts": 4.0, **log},
    )


def test_numbers_of_a_round_by_hand() -> None:
    values = result(30.0, 10.0, HitSpeed=1.5, HammerDepthZ=-0.05).values
    assert tuple(values) == METRICS
    assert values["hit_rate"] == 0.75
    assert values["hit_speed_mps"] == 1.5
    assert values["hammer_depth_m"] == -0.05
    assert values["max_fatigued"] == 0.2
    assert values["return"] == 80.0
    empty = result(0.0, 0.0, HitSpeed=0.0).values
    assert empty["hit_rate"] is None
    assert empty["hit_speed_mps"] is None, "no hit has no speed"
    assert result(0.0, 5.0).values["hit_rate"] == 0.0


def test_the_return_s_terms_add_up_and_cells_are_pooled() -> None:
    one = result(
        3.0, 1.0, DistanceReward=-30.0, hitsTarget0=1.0, missesTarget0=3.0, hitsTarget2=2.0
    )
    other = result(3.0, 1.0, DistanceReward=-50.0, hitsTarget0=2.0, missesTarget0=0.0)
    summary = summarise([one, other])
    terms = summary["return_terms"]
    assert terms == {"hits and the rest": 140.0, "DistanceReward": -40.0, "effort": -20.0}
    assert sum(terms.values()) == summary["return"]
    assert summary["cell_hit_rates"] == [0.5, None, 1.0]


@pytest.mark.parametrize(("low", "expected"), [(-1.0, 1.5), (0.5, 0.0)])
def test_the_change_of_actions(low: float, expected: float) -> None:
    """A user who swings between two actions, and one who holds still."""
    turn = iter(range(10_000))
    results = play(
        lambda n: FakeSimulation(n=n),
        lambda _: lambda observation, rng: np.full(3, (low, 0.5)[next(turn) % 2], np.float32),
        [Job("easy", 0, 0)],
        deterministic=True,
    )
    assert results[0].values["action_change"] == pytest.approx(expected)


def test_summary_by_hand() -> None:
    summary = summarise([result(30.0, 10.0, HitSpeed=1.5), result(0.0, 10.0, HitSpeed=0.0)])
    assert summary["episodes"] == 2
    assert summary["hits"] == 15.0
    assert summary["hits_sd"] == pytest.approx(30.0 / np.sqrt(2))
    assert summary["hit_rate"] == 0.375, "mean of the rounds' rates, as in the study"
    assert summary["hit_rate_pooled"] == 30 / 50
    assert summary["hit_speed_mps"] == 1.5
    assert summary["hit_speed_mps_sd"] is None
    assert summary["hammer_depth_m"] is None


def test_results_do_not_depend_on_how_many_rounds_are_played_side_by_side(trained: Path) -> None:
    request = dict(conditions=["easy", "hard"], episodes=4)
    together = play_with(trained, Request(**request, batch=10))
    assert [r.condition for r in together.rounds] == ["easy"] * 4 + ["hard"] * 4
    for batch in (1, 3):
        alone = play_with(trained, Request(**request, batch=batch))
        assert alone.summaries == together.summaries
    steps = {r.steps for r in together.rounds}
    assert len(steps) > 1, "rounds of different lengths, or this shows nothing"


def test_seeds_decide_and_conditions_share_them(trained: Path) -> None:
    one = play_with(trained, Request(seed=5, episodes=2))
    again = play_with(trained, Request(seed=5, episodes=2))
    other = play_with(trained, Request(seed=6, episodes=2))
    assert one.summaries == again.summaries
    # Round k has seed + k.
    first = [r.values for r in one.rounds if r.condition == "medium"]
    second = [r.values for r in other.rounds if r.condition == "medium"]
    assert first[1] == second[0]
    assert first[0] != second[1]
    sampled = one.summaries["medium"]["return"]
    mean = play_with(trained, Request(seed=5, episodes=2, deterministic=True)).summaries
    assert mean["medium"]["return"] != sampled


def test_defaults_come_from_the_run_and_results_are_stored(trained: Path) -> None:
    found = play_with(trained, Request())
    assert list(found.summaries) == ["medium", "hard"]
    assert found.step == 120
    summary = found.summaries["medium"]
    assert (summary["episodes"], summary["seed"], summary["deterministic"]) == (3, 1, False)
    file = trained / "evaluation" / "step_000000120" / "results.json"
    assert found.files == [file]
    assert json.loads(file.read_text()) == found.summaries
    assert all(np.isfinite(row["return"]) for row in summary["rounds"])


def test_a_checkpoint_can_be_named(trained: Path) -> None:
    checkpoint = find_user(trained).source
    assert find_user(checkpoint).source == checkpoint
    assert play_with(checkpoint, Request(episodes=1)).step == 120


def test_the_curriculum_is_switched_off(trained: Path) -> None:
    config = RunFolder(trained).load_config()
    assert config.env.app.options["adaptive"] is True
    assert evaluation_env(config).app.options == {"condition": "medium", "adaptive": False}


def test_the_environment_can_be_another_than_the_training_s(trained: Path) -> None:
    config = RunFolder(trained).load_config()
    overrides = ["env.user.noise.constant=white", "env.app.options.adaptive=true"]
    changed = evaluation_env(config, overrides=overrides)
    assert changed.user.noise.constant == "white"
    assert changed.app.options == {"condition": "medium", "adaptive": True}
    kept = changed.model_copy(update={"app": config.env.app, "user": config.env.user})
    assert kept == config.env
    found = play_with(trained, Request(episodes=1, overrides=overrides))
    assert found.summaries["medium"]["overrides"] == overrides
    folder = "user.noise.constant=white,app.options.adaptive=true"
    place = trained / "evaluation" / "step_000000120" / folder
    assert found.files == [place / "results.json"]  # beside the results without changes


def test_bad_requests(trained: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="condition: got 'impossible', expected easy"):
        play_with(trained, Request(conditions=["easy", "impossible"]))
    for request, message in [
        (Request(episodes=0), r"^--episodes: got 0, expected at least 1"),
        (Request(seed=-1), r"^--seed: got -1"),
        (Request(overrides=["ppo.n_envs=4"]), r"^--set: got 'ppo.n_envs=4', expected env.KEY"),
        (Request(overrides=["env.users.noise=1"]), r"env.users"),
        (
            Request(overrides=["env.action_frequency_hz=10"]),
            r"^environment: got .*trained with",
        ),
        (Request(batch=0), r"^--batch: got 0"),
        (Request(conditions=["easy", "easy"]), r"^--condition: .* every condition once"),
    ]:
        with pytest.raises(InputError, match=message):
            play_with(trained, request)
    with pytest.raises(InputError, match="which does not exist"):
        play_with(tmp_path / "none", Request())
    with pytest.raises(InputError, match=r"holds no config\.yaml"):
        play_with(tmp_path, Request())
    (tmp_path / "x.zip").write_text("")
    with pytest.raises(InputError, match="a file in its checkpoints folder, or pretrained:"):
        play_with(tmp_path / "x.zip", Request())
    shutil.copytree(trained, tmp_path / "run")
    for file in (tmp_path / "run" / "checkpoints").iterdir():
        file.unlink()
    with pytest.raises(InputError, match="which has no checkpoint yet"):
        play_with(tmp_path / "run", Request())


def test_progress_and_logs(trained: Path, tmp_path: Path) -> None:
    shares: list[float] = []
    folders: list[Path | None] = []

    def simulation(config: Any, n: int, *, log_dir: Path | None = None) -> FakeSimulation:
        folders.append(log_dir)
        return FakeSimulation(config, n, log_dir=log_dir)

    stale = tmp_path / "logs" / "user000"
    stale.mkdir(parents=True)
    request = Request(log=True, out=tmp_path, batch=2)
    evaluate(trained, request, simulation=simulation, on_progress=shares.append)
    assert folders[0] is None, "asking for the conditions writes no logs"
    assert folders[1] == tmp_path / "logs"
    assert not stale.exists()
    assert 0.0 <= min(shares) <= max(shares) <= 1.0
    assert shares[-1] > 0.9


def test_player_is_the_mean_plus_its_own_noise(trained: Path) -> None:
    simulation = FakeSimulation(n=2)
    simulation.reset(seeds=[1, 2])
    player = Player(find_user(trained), simulation.observation_space, simulation.action_space)
    own = {key: value[1] for key, value in simulation.observation().items()}
    mean = player.act(own, None)
    assert mean.dtype == np.float32
    draws = np.array([player.act(own, np.random.default_rng(k)) for k in range(300)])
    assert np.abs(draws).max() == 1.0
    # Standard deviation 1, clipped at +-1: 0.52 in all (numerically) around a mean near 0.
    assert draws.std() == pytest.approx(0.72, abs=0.05)
    assert np.array_equal(draws[0], player.act(own, np.random.default_rng(0)))


def test_users_who_finish_early_do_not_disturb_the_others() -> None:
    resets: list[Any] = []

    class Watched(FakeSimulation):
        def reset(self, ids=None, seeds=None, options=None):
            resets.append((ids, options))
            return super().reset(ids, seeds, options)

    jobs = [Job("easy", k, k) for k in range(4)]
    results = play(
        lambda n: Watched(n=n),
        lambda simulation: lambda observation, rng: rng.uniform(-1, 1, 3).astype(np.float32),
        jobs,
        deterministic=False,
    )
    assert [r.seed for r in results] == [0, 1, 2, 3]
    idle = [ids for ids, options in resets if options is None]
    longest = max(r.steps for r in results)
    assert sum(len(ids) for ids in idle) == sum(r.steps < longest for r in results)


def test_jobs() -> None:
    assert jobs_for(["a", "b"], 2, 7) == [
        Job("a", 0, 7), Job("a", 1, 8), Job("b", 0, 7), Job("b", 1, 8)
    ]  # fmt: skip
