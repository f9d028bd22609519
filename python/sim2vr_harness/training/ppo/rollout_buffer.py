"""A rollout buffer that holds images once, as bytes.

Stable-Baselines3's :class:`DictRolloutBuffer` allocates the observations anew for every rollout
and copies them into environment-major order before the first minibatch. For 40,000 images of
2x80x120 bytes (768 MB) that doubles the memory; here the order is an index computation and the
arrays are kept. Images lie channels last, as the network wants them: turned once when they come
instead of in every epoch. Minibatches have the same values to the bit.
"""

from collections.abc import Generator

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import BaseBuffer, DictRolloutBuffer, RolloutBuffer
from stable_baselines3.common.type_aliases import DictRolloutBufferSamples

_SMALL = ("actions", "values", "log_probs", "advantages", "returns")


class FrameRolloutBuffer(DictRolloutBuffer):
    """A :class:`DictRolloutBuffer` whose observations are stored once; (n_steps, n_envs, ...).

    ``observations`` of images are (n_steps, n_envs, C, H, W) views of memory with C last.
    """

    def reset(self) -> None:
        """Empty the buffer. The observations' memory is kept and written over."""
        spaces_by_key = self.observation_space.spaces
        if not hasattr(self, "observations") or not self.observations:
            self.observations = {
                key: _zeros((self.buffer_size, self.n_envs, *shape), spaces_by_key[key].dtype)
                for key, shape in self.obs_shape.items()
            }
        self.actions = np.zeros(
            (self.buffer_size, self.n_envs, self.action_dim), dtype=self.action_space.dtype
        )
        for name in ("rewards", "returns", "episode_starts", "values", "log_probs", "advantages"):
            setattr(self, name, np.zeros((self.buffer_size, self.n_envs), dtype=np.float32))
        self.generator_ready = False
        super(RolloutBuffer, self).reset()

    def add(  # type: ignore[override]
        self,
        obs: dict[str, NDArray],
        action: NDArray,
        reward: NDArray,
        episode_start: NDArray,
        value: torch.Tensor,
        log_prob: torch.Tensor,
    ) -> None:
        """Append one step of every environment; arrays are (n_envs, ...)."""
        for key, stored in self.observations.items():
            target = stored[self.pos]
            source = obs[key]
            if target.ndim == 4 and not target.flags.c_contiguous and source.flags.c_contiguous:
                # Channel by channel: ten times as quick as NumPy's loop over pixels of a few bytes.
                for channel in range(target.shape[1]):
                    target[:, channel] = source[:, channel]
            else:
                target[...] = source
        self.actions[self.pos] = action.reshape((self.n_envs, self.action_dim))
        self.rewards[self.pos] = reward
        self.episode_starts[self.pos] = episode_start
        self.values[self.pos] = value.detach().cpu().numpy().flatten()
        self.log_probs[self.pos] = log_prob.detach().cpu().numpy().flatten()
        self.pos += 1
        self.full = self.pos == self.buffer_size

    def get(  # type: ignore[override]
        self, batch_size: int | None = None
    ) -> Generator[DictRolloutBufferSamples, None, None]:
        """Yield the rollout in random minibatches.

        Args:
            batch_size: Samples per minibatch; None yields all of them at once.

        Raises:
            RuntimeError: The rollout is not complete.
        """
        if not self.full:
            raise RuntimeError(f"the rollout has {self.pos} of {self.buffer_size} steps")
        total = self.buffer_size * self.n_envs
        indices = np.random.permutation(total)  # noqa: NPY002 - SB3's generator, saved with the run
        if not self.generator_ready:
            for name in _SMALL:
                setattr(self, name, BaseBuffer.swap_and_flatten(getattr(self, name)))
            self.generator_ready = True
        size = batch_size or total
        for start in range(0, total, size):
            batch_inds = indices[start : start + size]
            envs, steps = np.divmod(batch_inds, self.buffer_size)
            samples = DictRolloutBufferSamples(
                observations={
                    key: _rows(stored, steps, envs).to(self.device)
                    for key, stored in self.observations.items()
                },
                actions=self.to_torch(self.actions[batch_inds].astype(np.float32, copy=False)),
                old_values=self.to_torch(self.values[batch_inds].flatten()),
                old_log_prob=self.to_torch(self.log_probs[batch_inds].flatten()),
                advantages=self.to_torch(self.advantages[batch_inds].flatten()),
                returns=self.to_torch(self.returns[batch_inds].flatten()),
            )
            yield samples


def _zeros(shape: tuple[int, ...], dtype: np.dtype | None) -> NDArray:
    """Return zeros (n_steps, n_envs, ...); images are such a view of memory with C last."""
    if len(shape) != 5 or dtype != np.uint8:
        return np.zeros(shape, dtype)
    steps, envs, channels, height, width = shape
    return np.moveaxis(np.zeros((steps, envs, height, width, channels), dtype), -1, 2)


def _rows(stored: NDArray, steps: NDArray, envs: NDArray) -> torch.Tensor:
    if stored.ndim != 5 or stored.dtype != np.uint8:
        return torch.from_numpy(stored[steps, envs])
    return torch.from_numpy(np.moveaxis(stored, 2, -1)[steps, envs]).permute(0, 3, 1, 2)


def buffer_bytes(space: spaces.Dict, steps: int) -> int:
    """Return how much memory the observations of ``steps`` user steps take, bytes."""
    return steps * sum(
        int(np.prod(box.shape or ())) * np.dtype(box.dtype).itemsize
        for box in space.spaces.values()
    )
