"""N simulated users as one Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sim2vr_harness.client import OptionValue
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import with_condition, with_game
from sim2vr_harness.envs.simulation import Observation, Simulation

__all__ = ["Sim2VRVectorEnv"]


class Sim2VRVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Users who start a new episode in the very step in which one ends (``SAME_STEP``).

    Actions (N, 32), observations as :meth:`Simulation.observation`, rewards (N,) float64. Infos
    hold ``game_reward`` and ``effort_cost``, (N,) each; where an episode has ended ``final_obs``
    (object array of N) has its last observation and ``final_info`` its last info, with the game's
    log, as Gymnasium's own vector environments lay them out.

    Args:
        num_envs: number of users N.
        condition: a condition that the game publishes; None leaves its options as they are.
        config: the whole environment; None takes the defaults.
        log_dir: root of the episode logs, or None.
        game: another game than the configuration's.

    Raises:
        ValueError: a setting that cannot be used; names it, what was got and what was expected.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        condition: str | None = None,
        config: EnvConfig | None = None,
        log_dir: str | Path | None = None,
        game: str | None = None,
    ) -> None:
        super().__init__()
        config = with_game(EnvConfig() if config is None else config, game)
        config = with_condition(config, condition)
        self.simulation = Simulation(
            config, num_envs, log_dir=None if log_dir is None else Path(log_dir)
        )
        self.num_envs = num_envs
        self.single_observation_space = self.simulation.observation_space
        self.single_action_space = self.simulation.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts episodes.

        Args:
            seed: user i gets seed + i, or the i-th of N.
            options: game options from this round on; ``reset_mask`` (N,) bool starts only some
                users anew.
        """
        game_options: dict[str, OptionValue] = dict(options or {})
        mask = game_options.pop("reset_mask", np.ones(self.num_envs, dtype=bool))
        if np.shape(mask) != (self.num_envs,) or np.asarray(mask).dtype != np.bool_:
            raise ValueError(
                f"reset_mask: got {np.asarray(mask).dtype} {np.shape(mask)}, expected bool "
                f"({self.num_envs},)"
            )
        ids = np.flatnonzero(np.asarray(mask)).tolist()
        if isinstance(seed, int):
            seeds: Sequence[int | None] = [seed + i for i in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else list(seed)
        infos: dict[str, Any] = {}
        chosen = [seeds[i] for i in ids]
        started = self.simulation.reset(ids=ids, seeds=chosen, options=game_options or None)
        for i, info in zip(ids, started, strict=True):
            infos = self._add_info(infos, dict(info), i)
        return self.simulation.observation(), infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One user step of everybody; see the class for the infos."""
        batch = self.simulation.step(actions)
        infos: dict[str, Any] = {}
        for name in ("game_reward", "effort_cost"):
            infos[name] = getattr(batch, name)
            infos[f"_{name}"] = np.ones(self.num_envs, dtype=bool)
        observation = self.simulation.observation()
        ended = sorted(batch.ends)
        if ended:
            for i in ended:
                last = {key: rows[i].copy() for key, rows in observation.items()}
                infos = self._add_info(infos, {"final_obs": last, "final_info": batch.info(i)}, i)
            self.simulation.reset(ids=ended)
            observation = self.simulation.observation()
        return observation, batch.reward, batch.terminated, batch.truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the apps."""
        self.simulation.close()
