"""Checkpoints of the stages of Stable-Baselines3's learners."""

from __future__ import annotations

from typing import Any

import torch

from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.stage import Callbacks


class CheckpointedStage:
    """A :class:`~sim2vr_harness.training.run.stage.Stage` that ends at a checkpoint.

    Attributes:
        folder: where checkpoints and ``metrics.jsonl`` go.
        stop: user steps after which it ends.
    """

    unit = "user steps"
    folder: RunFolder
    stop: int
    _env: SimulationVecEnv | None = None
    _model: Any = None

    @property
    def begun(self) -> bool:
        """See the protocol."""
        return bool(self.folder.checkpoints())

    @property
    def finished(self) -> bool:
        """See the protocol."""
        return self.begun and self.folder.step >= self.stop

    @property
    def saved(self) -> str:
        """See the protocol."""
        return f"step {self.folder.step:,} of {self.stop:,}" if self.begun else ""

    def close(self) -> None:
        """See the protocol."""
        if self._env is not None:
            self._env.close()
        self._env = self._model = None

    def tidy(self) -> None:
        """See the protocol; checkpoints are kept."""

    def _note(
        self, callbacks: Callbacks, model: Any, start_step: int, renderer: str | None
    ) -> None:
        """Note in the run what learns, and on what."""
        callbacks.note(
            start_step=start_step,
            device=str(model.device),
            renderer=renderer,
            torch_threads=torch.get_num_threads(),
            parameters=sum(weight.numel() for weight in model.policy.parameters()),
        )
