"""Loggers of iterations: JSON lines, TensorBoard and, if requested, Weights & Biases."""

import math
import uuid
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.logger import KVWriter, Logger

from sim2vr_harness.base.optional import needed
from sim2vr_harness.client import GameFacts
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder, append_row, metric_key


def _numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the entries that are numbers, as plain floats."""
    return {
        key: float(value)
        for key, value in values.items()
        if not isinstance(value, str) and hasattr(value, "__float__")
    }


class JsonLines(KVWriter):
    """Appends one JSON object per iteration; numbers that are not finite become null."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Append a row: ``step``, ``time`` (UTC) and every value."""
        row: dict[str, Any] = {
            "step": int(step),
            "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
        }
        for key, value in sorted(_numbers(key_values).items()):
            row[key] = value if math.isfinite(value) else None
        append_row(self._path, row)

    def close(self) -> None:
        """Do nothing: no file is open between two rows."""


class TensorBoard(KVWriter):
    """Writer of scalars for TensorBoard; a resumed run hides the steps that it will repeat."""

    def __init__(self, folder: Path, start_step: int) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(log_dir=str(folder), purge_step=start_step + 1)

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Write every value as a scalar."""
        for key, value in _numbers(key_values).items():
            self._writer.add_scalar(key, value, step)
        self._writer.flush()

    def close(self) -> None:
        """Close the event file."""
        self._writer.close()


class WeightsAndBiases(KVWriter):
    """Sends every row to a run of Weights & Biases, the same one after a resumption."""

    def __init__(self, config: TrainingConfig, folder: RunFolder) -> None:
        wandb = require_wandb()
        run_id = folder.metadata().get("wandb_id") or uuid.uuid4().hex[:12]
        folder.note(wandb_id=run_id)
        self._run = wandb.init(
            project=config.wandb.project,
            entity=config.wandb.entity,
            mode=config.wandb.mode,
            name=config.name,
            id=run_id,
            resume="allow",
            dir=str(folder.path),
            config=config.model_dump(mode="json"),
        )

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Send every value."""
        self._run.log(_numbers(key_values), step=int(step))

    def close(self) -> None:
        """Finish the run."""
        self._run.finish()


def require_wandb() -> Any:
    """Return the wandb package.

    Raises:
        InputError: It is not installed.
    """
    return needed("wandb", "wandb", "wandb.enabled")


def make_logger(config: TrainingConfig, folder: RunFolder, start_step: int) -> Logger:
    """Return the logger of one session."""
    writers: list[KVWriter] = [
        JsonLines(folder.metrics_file),
        TensorBoard(folder.tensorboard_dir, start_step),
    ]
    if config.wandb.enabled:
        writers.append(WeightsAndBiases(config, folder))
    return Logger(folder=str(folder.path), output_formats=writers)


def silent_logger() -> Logger:
    """Return a logger that writes nothing."""
    return Logger(folder=None, output_formats=[])


def episode_means(episodes: list[dict[str, Any]], facts: GameFacts) -> dict[str, float]:
    """Return the means of finished episodes' values, with keys of :func:`metric_key`.

    Args:
        episodes: ``info["episode"]`` of ``SimulationVecEnv``.
        facts: Facts that the game publishes: its proportions, such as a hit rate, are ratios of
            means.
    """
    if not episodes:
        return {}
    means = {
        "ep_rew_mean": float(np.mean([episode["r"] for episode in episodes])),
        "ep_len_mean": float(np.mean([episode["l"] for episode in episodes])),
    }
    for key in ("game_reward", "effort_cost", "max_fatigued"):
        values = [episode[key] for episode in episodes if key in episode]
        if values:
            means[f"ep_{key}_mean"] = float(np.mean(values))
    log: dict[str, float] = {}
    for key in episodes[-1].get("log", {}):
        values = [episode["log"][key] for episode in episodes if key in episode["log"]]
        log[key] = means[f"ep_{key}_mean"] = float(np.mean(values))
    for measure in facts.scalars:
        if measure.only_if is not None and measure.rate_with is None and measure.log_key in log:
            # Episodes without the number (no hit, no hit speed) are left out, as in evaluations.
            own = [measure.value(episode.get("log", {})) for episode in episodes]
            known = [value for value in own if value is not None]
            del means[metric_key(measure)]
            if known:
                means[metric_key(measure)] = float(np.mean(known))
    for measure in facts.scalars:
        share = measure.value(log) if measure.rate_with is not None else None
        if share is not None:
            means[metric_key(measure)] = share
    return means
