"""Training and evaluation on the real simulation: tiny, but nothing is replaced."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.training.run import trainer

SETTINGS = [
    "ppo.n_envs=2",
    "ppo.n_steps=30",
    "ppo.batch_size=30",
    "ppo.n_epochs=2",
    "ppo.learning_rate.initial=1e-3",
    "env.app.options.round_seconds=1.0",
    "env.app.options.condition=random",
    "evaluation.conditions=[low-medium, medium]",
    "device=cpu",
]


def config(frames: int) -> TrainingConfig:
    settings = [*SETTINGS, f"env.frames_per_step={frames}"]
    return load_config("whacamole_adaptive_constrained", settings)


def train(folder: Path, stop: int, frames: int = 1, **how: bool) -> trainer.TrainResult:
    console = Console(file=io.StringIO())
    return trainer.train(config(frames), folder, timesteps=stop, console=console, **how)


def test_a_resumed_run_keeps_its_tracking_rate(tmp_path: Path) -> None:
    train(tmp_path / "run", 60, frames=5)
    with pytest.raises(InputError, match="frames_per_step: got 1, expected 5"):
        train(tmp_path / "run", 120, frames=1, resume=True)


@pytest.mark.parametrize("frames", [1, 5])
def test_evaluation_does_not_depend_on_the_batch(tmp_path: Path, frames: int) -> None:
    from sim2vr_harness.evaluation.evaluate import Request, evaluate

    result = train(tmp_path / "run", 60, frames)
    found = evaluate(result.checkpoint, Request(episodes=2))
    alone = evaluate(result.checkpoint, Request(episodes=2, batch=1))
    assert found.summaries == alone.summaries
    summary = found.summaries["low-medium"]
    assert summary["effort"] > 0.0
    assert 0.0 < summary["max_fatigued"] < 1.0
    assert -1.0 < summary["hammer_depth_m"] < 1.0
    assert summary["return"] == pytest.approx(summary["game_return"] - summary["effort"])
