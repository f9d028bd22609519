"""What PPO asks of a policy beyond Stable-Baselines3."""

from __future__ import annotations

from typing import Any

from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

__all__ = ["StagePolicy"]


class StagePolicy(ActorCriticPolicy):
    """An actor and a critic that any stage of a run can train."""

    @property
    def in_shards(self) -> bool:
        """Whether batches are computed in shards, one thread each (:mod:`.sharding`)."""
        return False

    def critic_parameters(self) -> list[Tensor]:
        """Return the weights that only the values depend on."""
        raise NotImplementedError

    def end_update(self, observations: dict[str, Any]) -> None:
        """Take in a rollout after it was learned from; key -> (n_steps, n_envs, ...)."""
