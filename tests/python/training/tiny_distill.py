"""The distilled recipe in seconds: the real game, and as little of everything as there can be."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from rich.console import Console
from short_cycles import short_cycles

from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.training.dagger import dagger
from sim2vr_harness.training.run import trainer

SETTINGS = [
    "recipe=distill",
    "device=cpu",
    "env.cores=1",
    "env.app.options.round_seconds=2.0",
    "policy.scale_proprioception=true",
    "teacher.imagined.cycles=2",
    "teacher.imagined.average_updates=2",
    "teacher.imagined.first_play_steps=30",
    "teacher.imagined.body_width=16",
    "teacher.imagined.users=8",
    "teacher.imagined.n_envs=4",
    "teacher.curriculum.near_starts=0.0",
    "student.n_envs=2",
    "student.frames=96",
    "student.batch_size=16",
    "student.stagger_steps=20",
    "ppo.n_envs=2",
    "ppo.n_steps=10",
    "ppo.batch_size=10",
    "ppo.n_epochs=1",
    "ppo.critic_first_updates=1",
    "total_timesteps=40",
    "checkpoint.every_steps=20",
]


def config(*settings: str) -> TrainingConfig:
    return load_config("whacamole_constrained", [*SETTINGS, *settings])


def train(folder: Path, *settings: str, **how: Any) -> tuple[trainer.TrainResult, str]:
    text = io.StringIO()
    console = Console(file=text, width=200)
    with (
        patch.object(dagger, "SETTINGS", replace(dagger.SETTINGS, rollout_steps=8)),
        short_cycles(),
    ):
        return trainer.train(config(*settings), folder, console=console, **how), text.getvalue()


def weights(path: Path) -> dict[str, torch.Tensor]:
    with zipfile.ZipFile(path) as archive:
        return torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
