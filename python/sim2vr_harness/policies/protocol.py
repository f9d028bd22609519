"""The interface of everything that acts in an environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Act", "Remembering"]

Act = Callable[[dict[str, NDArray], np.random.Generator | None], NDArray[np.float32]]
"""One user's observation and random numbers (None: deterministic) -> action, (A,)."""


@runtime_checkable
class Remembering(Protocol):
    """A policy that may remember something of a round."""

    def for_a_round(self) -> Act:
        """Return what a user does in a round that begins."""
