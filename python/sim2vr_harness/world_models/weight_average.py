"""The mean of weights over the last updates."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch
from torch import Tensor


class WeightAverage:
    """The mean of weights over about the last updates, each counting a little less than the next.

    Args:
        weights: that learn.
        updates: over how many; 0: there is no mean, weights are taken as they are.
    """

    def __init__(self, weights: Sequence[Tensor], updates: int) -> None:
        self._weights, self._updates = list(weights), updates
        self._count = 0
        self._mean = [weight.detach().clone() for weight in weights] if updates else []

    def add(self) -> None:
        """Take in the present weights; the first ones are taken in alike."""
        self._count += 1
        share = 1.0 / max(1, min(self._count, self._updates))
        for mean, weight in zip(self._mean, self._weights, strict=False):
            mean.lerp_(weight.detach(), share)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Have the mean in place of the weights."""
        learning = [weight.detach().clone() for weight in self._weights[: len(self._mean)]]
        self._take(self._mean)
        try:
            yield
        finally:
            self._take(learning)

    def settle(self) -> None:
        """Replace the weights by their mean."""
        self._take(self._mean)

    def _take(self, values: Sequence[Tensor]) -> None:
        with torch.no_grad():
            for weight, value in zip(self._weights, values, strict=False):
                weight.copy_(value)

    def state_dict(self) -> list[Tensor]:
        """Return the complete state of the average."""
        return [torch.tensor(self._count), *self._mean]

    def load_state_dict(self, state: Sequence[Tensor]) -> None:
        """Restore a state of :meth:`state_dict`."""
        self._count = int(state[0])
        for mean, value in zip(self._mean, state[1:], strict=True):
            mean.copy_(value)
