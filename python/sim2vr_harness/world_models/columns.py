"""Columns of tensors; all of them in order cost nothing."""

from collections.abc import Sequence
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor


class Columns:
    """Some columns of (B, F) tensors, differentiable.

    Args:
        which: of the columns, in the order that is wanted.
        of: F.
    """

    def __init__(self, which: Sequence[int] | NDArray[Any], of: int) -> None:
        self.ids = torch.tensor(list(which), dtype=torch.long)
        """(K,) numbers of the columns."""
        self.all = list(which) == list(range(of))
        """True if these are all columns, in their order."""

    def __len__(self) -> int:
        return len(self.ids)

    def __call__(self, values: Tensor) -> Tensor:
        """(B, K) of them; the tensor itself if these are all its columns."""
        return values if self.all else values[:, self.ids]
