"""A trained user who plays: the saved policy, acting for one body at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.training.checkpoint import load_policy_weights
from sim2vr_harness.training.config import TrainingConfig
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.policy import UserPolicy
from sim2vr_harness.training.run_folder import RunFolder

__all__ = ["Player", "find_checkpoint"]


def find_checkpoint(run: str | Path) -> tuple[RunFolder, Path]:
    """Return the folder of a run and the checkpoint to use.

    Args:
        run: A run's folder (its newest checkpoint is used) or a checkpoint in one.

    Raises:
        InputError: It is neither.
    """
    path = Path(run)
    if path.is_dir() or not path.exists():
        folder = RunFolder.open(path)
        return folder, folder.latest_checkpoint()
    folder = RunFolder(path.resolve().parent.parent)
    if not folder.exists:
        raise InputError(
            "RUN", f"the file {str(run)!r}", "a run's folder, or a file in its checkpoints folder"
        )
    return folder, path


class Player:
    """The policy of a checkpoint, on the CPU.

    Each body is asked for by itself: what a round's user does must not depend, not even in the
    last bit, on how many rounds are played side by side.

    Args:
        config: The run's configuration.
        checkpoint: The checkpoint to load.
        observation_space: Of the simulation.
        action_space: Of the simulation.

    Raises:
        InputError: The checkpoint cannot be read, or its network has other shapes.
    """

    def __init__(
        self,
        config: TrainingConfig,
        checkpoint: Path,
        observation_space: spaces.Dict,
        action_space: spaces.Box,
    ) -> None:
        # The weights drawn here are replaced at once; a training's random numbers are not touched.
        with torch.random.fork_rng(devices=[]):
            self._policy = UserPolicy(
                observation_space, action_space, lambda _: 0.0, config=config.policy
            )
        self.step = load_policy_weights(checkpoint, self._policy)
        self._policy.set_training_mode(False)
        self._std = np.exp(self._policy.log_std.detach().numpy())

    def act(
        self, observation: dict[str, NDArray], rng: np.random.Generator | None
    ) -> NDArray[np.float32]:
        """Return the action of one user, (A,) in [-1, 1].

        Args:
            observation: key -> (...), of one user.
            rng: Draws the deviation from the mean; None takes the mean (deterministic).
        """
        batch = {key: torch.from_numpy(value[None]) for key, value in observation.items()}
        with torch.no_grad():
            action = self._policy.action_mean(batch).numpy()[0]
        if rng is not None:
            action = action + self._std * rng.standard_normal(action.shape, dtype=np.float32)
        clipped: NDArray[np.float32] = np.clip(action, -1.0, 1.0).astype(np.float32)
        return clipped
