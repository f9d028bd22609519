"""Whole training sessions on the quick stand-in for the simulation."""

import io
import sys
import types
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch
from fake_simulation import FakeSimulation
from rich.console import Console

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import describe_game
from sim2vr_harness.runs.config import TrainingConfig, parse_config
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.run import trainer
from sim2vr_harness.training.run.loggers import episode_means

QUIET = Console(file=io.StringIO())
ITERATION = 60  # 3 users x 20 steps


def tiny(**changes: Any) -> TrainingConfig:
    tree = {
        "total_timesteps": 600,
        "device": "cpu",
        "policy": {"net_arch": [16], "vision_features": 8, "proprioception_features": 8},
        "ppo": {
            "n_envs": 3,
            "n_steps": 20,
            "batch_size": 15,
            "n_epochs": 2,
            "learning_rate": {"initial": 1e-3, "final": 1e-5},
        },
        "checkpoint": {"every_steps": 100},
    }
    return parse_config(tree | changes)


def run(
    folder: Path, stop: int, config: TrainingConfig | None = None, fail_at: int | None = None, **how
) -> trainer.TrainResult:
    def simulation(settings: TrainingConfig) -> FakeSimulation:
        made = FakeSimulation(settings.env, settings.ppo.n_envs)
        made.fail_at = fail_at
        return made

    config = config or tiny()
    return trainer.train(
        config, folder, timesteps=stop, console=QUIET, simulation=simulation, **how
    )


def member(path: Path, name: str) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        return torch.load(io.BytesIO(archive.read(name)), weights_only=True)


def assert_same_learner(one: Path, other: Path) -> None:
    a, b = member(one, "policy.pth"), member(other, "policy.pth")
    assert a.keys() == b.keys()
    for key in a:
        assert torch.equal(a[key], b[key]), key
    a, b = member(one, "policy.optimizer.pth"), member(other, "policy.optimizer.pth")
    assert a["param_groups"] == b["param_groups"]
    for key, state in a["state"].items():
        for name in state:
            assert torch.equal(state[name], b["state"][key][name]), (key, name)


def rows_without_times(folder: Path) -> list[dict[str, Any]]:
    rows = RunFolder(folder).metrics()
    return [
        {key: value for key, value in row.items() if not key.startswith("time")} for row in rows
    ]


def test_interrupted_and_resumed_equals_uninterrupted_bit_for_bit(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", 5 * ITERATION)
    parts = tmp_path / "parts"
    first = run(parts, 2 * ITERATION)
    assert first.step == 2 * ITERATION
    cut = run(parts, 5 * ITERATION, fail_at=30, resume=True)  # inside the second rollout
    assert cut.interrupted
    assert (cut.step, cut.lost_steps) == (3 * ITERATION, 9 * 3)
    last = run(parts, 5 * ITERATION, resume=True)
    assert last.step == whole.step == 5 * ITERATION
    assert_same_learner(whole.checkpoint, last.checkpoint)
    assert rows_without_times(tmp_path / "whole") == rows_without_times(parts)
    sessions = RunFolder(parts).metadata()["sessions"]
    assert [s["status"] for s in sessions] == ["finished", "interrupted", "finished"]
    assert [s["start_step"] for s in sessions] == [0, 2 * ITERATION, 3 * ITERATION]


def test_learning_rate_runs_over_the_whole_training_wherever_a_session_stops(
    tmp_path: Path,
) -> None:
    run(tmp_path / "a", 2 * ITERATION)
    run(tmp_path / "a", 10 * ITERATION, resume=True)
    rates = [row["train/learning_rate"] for row in RunFolder(tmp_path / "a").metrics()]
    # Constant for the first fifth of 600 steps, then linear from 1e-3 to 1e-5.
    expected = [
        1e-3 if step <= 120 else 1e-5 + (600 - step) / 480 * (1e-3 - 1e-5)
        for step in range(60, 601, 60)
    ]
    np.testing.assert_allclose(rates, expected, rtol=1e-9)


def test_run_folder_holds_what_is_needed(tmp_path: Path) -> None:
    result = run(tmp_path / "run", 4 * ITERATION)
    folder = result.folder
    assert folder.load_config() == tiny()
    # Every 100 steps, rounded up to iterations, and the end.
    assert [file.name for file in folder.checkpoints()] == [
        "step_000000120.zip",
        "step_000000240.zip",
    ]
    session = folder.metadata()["sessions"][0]
    assert {"torch", "mujoco", "stable-baselines3"} <= session["versions"].keys()
    assert "git_commit" in session
    rows = folder.metrics()
    assert [row["step"] for row in rows] == [60, 120, 180, 240]
    for key in ("rollout/ep_rew_mean", "rollout/ep_Points_mean", "rollout/ep_hit_rate",
                "train/std", "time/steps_per_second", "rollout/ep_effort_cost_mean"):  # fmt: skip
        assert key in rows[0]
    assert list(folder.tensorboard_dir.glob("events*"))
    model = stable_baselines3.PPO.load(result.checkpoint, device="cpu")
    actions, _ = model.predict(FakeSimulation(n=2).observation(), deterministic=True)
    assert (model.num_timesteps, actions.shape) == (4 * ITERATION, (2, 3))
    more = run(
        folder.path, 6 * ITERATION, tiny(checkpoint={"every_steps": 60, "keep": 2}), resume=True
    )
    assert [file.stem for file in more.folder.checkpoints()] == [
        "step_000000300",
        "step_000000360",
    ]


def test_existing_folders_are_never_overwritten_by_accident(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run(folder, ITERATION)
    with pytest.raises(
        InputError, match=r"^--out: got .*run', which holds a run.*--resume.*--over"
    ):
        run(folder, ITERATION)
    (folder / "notes.txt").write_text("mine")
    result = run(folder, 2 * ITERATION, overwrite=True)
    assert [file.stem for file in result.folder.checkpoints()] == ["step_000000120"]
    assert (folder / "notes.txt").read_text() == "mine"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.txt").write_text("")
    with pytest.raises(InputError, match="which holds other files"):
        run(tmp_path / "other", ITERATION)
    with pytest.raises(InputError, match="which is a file"):
        run(tmp_path / "other" / "a.txt", ITERATION)


def test_resuming_needs_a_run_with_the_same_settings(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^--resume: got .*holds no run"):
        run(tmp_path / "none", ITERATION, resume=True)
    folder = tmp_path / "run"
    run(folder, ITERATION)
    with pytest.raises(InputError, match=r"^seed: got 2, expected 1 as in .*config\.yaml"):
        run(folder, 2 * ITERATION, tiny(seed=2), resume=True)
    before = (folder / "run.json").read_bytes()
    assert run(folder, ITERATION, resume=True).step == ITERATION
    assert (folder / "run.json").read_bytes() == before, "nothing to train, nothing touched"
    longer = run(folder, 2 * ITERATION, tiny(total_timesteps=1200), resume=True)
    assert longer.folder.load_config().total_timesteps == 1200


def test_a_crash_of_the_engine_saves_and_is_reported(tmp_path: Path) -> None:
    def simulation(settings: TrainingConfig) -> FakeSimulation:
        made = FakeSimulation(settings.env, settings.ppo.n_envs)
        step = made.step

        def crash(actions: np.ndarray) -> Any:
            if made.total_steps == 30:
                raise RuntimeError("engine fault")
            return step(actions)

        made.step = crash
        return made

    folder = tmp_path / "run"
    with pytest.raises(RuntimeError, match="engine fault"):
        trainer.train(tiny(), folder, timesteps=300, console=QUIET, simulation=simulation)
    saved = RunFolder(folder)
    assert [file.stem for file in saved.checkpoints()] == ["step_000000060"]
    assert saved.metadata()["sessions"][0]["status"] == "failed"


def test_weights_and_biases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = tiny(wandb={"enabled": True, "mode": "offline"})
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match=r"^wandb\.enabled: .*pip install 'sim2vr-harness\[wandb"):
        run(tmp_path / "run", ITERATION, config)
    assert not (tmp_path / "run").exists()
    rows: list[tuple[int, dict]] = []
    ids: list[str] = []

    def init(**settings: Any) -> Any:
        ids.append(settings["id"])
        return types.SimpleNamespace(
            log=lambda values, step: rows.append((step, values)), finish=lambda: None
        )

    monkeypatch.setitem(sys.modules, "wandb", types.SimpleNamespace(init=init))
    run(tmp_path / "run", ITERATION, config)
    run(tmp_path / "run", 2 * ITERATION, config, resume=True)
    assert [step for step, _ in rows] == [60, 120]
    assert "rollout/ep_rew_mean" in rows[0][1]
    assert ids[0] == ids[1]


def test_episode_means_by_hand() -> None:
    episodes = [
        {"r": 1.0, "l": 4, "effort_cost": 0.5, "log": {"Points": 3.0, "Misses": 1.0}},
        {"r": 3.0, "l": 6, "effort_cost": 1.5, "log": {"Points": 0.0, "Misses": 4.0}},
    ]
    means = episode_means(episodes, describe_game("whacamole"))
    assert means["ep_rew_mean"] == 2.0
    assert means["ep_len_mean"] == 5.0
    assert means["ep_effort_cost_mean"] == 1.0
    assert means["ep_hit_rate"] == 3 / 8
    # Hitting speed of the episodes that have a hit; none in episodes without any.
    for episode, speed in zip(episodes, (1.5, 0.0), strict=True):
        episode["log"]["HitSpeed"] = speed  # type: ignore[index]
    assert episode_means(episodes, describe_game("whacamole"))["ep_HitSpeed_mean"] == 1.5
    assert "ep_HitSpeed_mean" not in episode_means(episodes[1:], describe_game("whacamole"))
    assert episode_means([], describe_game("whacamole")) == {}
    assert "ep_hit_rate" not in episode_means(episodes, describe_game("sample"))
