"""Results of one user step of N users."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.app_group import Logs


@dataclass
class StepBatch:
    """What one user step did to each of N users.

    Attributes:
        reward: (N,) float64, the game's reward minus the effort cost.
        terminated: (N,) bool, the game is over or the simulation diverged.
        truncated: (N,) bool, ``max_episode_seconds`` are over, or the app failed.
        game_reward: (N,) float64, 0 where the app was not asked or did not answer.
        effort_cost: (N,) float64.
        answered: (N,) bool, whose app played the step: not that of a user whose simulation
            diverged, nor one that failed.
        logs: the games' named numbers, ``logs[i]`` of user i.
        ends: users whose episode ended here -> ``termination`` (``finished``, ``diverged``,
            ``max_steps_reached``, ``app_left`` or ``app_failed``) and ``max_fatigued``; after
            ``app_left`` also ``app_left``, how the app ended its session by itself; after
            ``app_failed`` also ``app_error``, what happened; where MuJoCo warned in the episode,
            ``warnings``, how often by kind (see :attr:`UserBatch.warnings`).
    """

    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    game_reward: NDArray[np.float64]
    effort_cost: NDArray[np.float64]
    answered: NDArray[np.bool_]
    logs: Logs
    ends: dict[int, dict[str, Any]] = field(default_factory=dict)

    @property
    def over(self) -> NDArray[np.bool_]:
        """(N,) whose episode ended here, for whatever reason."""
        return self.terminated | self.truncated

    def info(self, i: int) -> dict[str, Any]:
        """User i's part of the step as a dictionary.

        Returns:
            ``game_reward``, ``effort_cost``, ``log`` if the app answered, and the user's entries of
            :attr:`ends`.
        """
        info: dict[str, Any] = {
            "game_reward": float(self.game_reward[i]),
            "effort_cost": float(self.effort_cost[i]),
        }
        if self.answered[i]:
            info["log"] = self.logs[i]
        return info | self.ends.get(i, {})

    @cached_property
    def infos(self) -> list[dict[str, Any]]:
        """:meth:`info` of all users; made when first requested."""
        return [self.info(i) for i in range(len(self.reward))]
