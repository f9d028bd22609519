"""A policy of your own, or of another library, in the place of a trained user.

    sim2vr-harness evaluate docs/examples/own_policy.py:StableBaselines --episodes 2

The class names the environment that it acts in (``config``: a configuration's name, its file, or
keys of one). It gets the spaces, and acts for all users of a simulation at once.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
from gymnasium import spaces
from numpy.typing import NDArray


class StableBaselines:
    """A model of Stable-Baselines3, as ``train_with_sb3.py`` writes it (``SB3_MODEL=user.zip``)."""

    config = {"env": {"app": {"game": "whacamole", "options": {"condition": "easy"}}}}

    def __init__(self, observation_space: spaces.Dict, action_space: spaces.Box) -> None:
        """Load the model; the spaces are those of the environment."""
        file = Path(os.environ.get("SB3_MODEL", "user.zip"))
        self._model = stable_baselines3.PPO.load(file, device="cpu")
        self.steps = self._model.num_timesteps

    def begin(self, n: int) -> None:
        """Return the memory of N users whose episodes begin: this policy has none."""

    def restart(self, memory: None, users: Sequence[int]) -> None:
        """Let the episodes of these users begin anew."""

    def act(
        self,
        observations: dict[str, NDArray[Any]],
        memory: None,
        rngs: Sequence[np.random.Generator | None],
    ) -> NDArray[np.float32]:
        """Return the actions, (N, A) in [-1, 1]."""
        actions, _ = self._model.predict(observations, deterministic=rngs[0] is None)
        return actions

    def state_dict(self) -> dict[str, Any]:
        """Return the weights by name."""
        return self._model.policy.state_dict()
