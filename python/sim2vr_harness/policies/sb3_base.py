"""Interface of policies for PPO, beyond Stable-Baselines3's."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from sim2vr_harness.policies.protocol import shapes_in_words


class StagePolicy(ActorCriticPolicy):
    """An actor and a critic that any stage of a run can train."""

    def __repr__(self) -> str:
        """Return what it observes, and the sizes of its action and its network."""
        observed = self.observation_space
        boxes = observed.spaces if isinstance(observed, spaces.Dict) else {"": observed}
        shapes = shapes_in_words({key: box.shape or () for key, box in boxes.items()})
        size = sum(each.numel() for each in self.parameters())
        actions = f"{self.action_space.shape} actions"
        return f"{type(self).__name__}({shapes}; {actions}; {size:,} weights)"

    @property
    def in_shards(self) -> bool:
        """Whether batches are computed in shards, one thread each (:mod:`.sharding`)."""
        return False

    def critic_parameters(self) -> list[Tensor]:
        """Return the weights that only the values depend on."""
        raise NotImplementedError

    def end_update(self, observations: dict[str, Any]) -> None:
        """Take in a rollout after it was learned from; key -> (n_steps, n_envs, ...)."""
