"""What users have decided, which they see through for some user steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.perception import Moment
from sim2vr_harness.training.skills.moves import Choice

__all__ = ["HeldChoice"]


class HeldChoice:
    """A choice of N users that lasts; a ``Sense`` that forgets with their rounds.

    Args:
        simulation: the users; watched from their next reset on.
        hands: H.
        steps: user steps that a choice lasts.
    """

    name, pauses, frame = "what was decided", (), -1
    needs: str | None = None

    def __init__(self, simulation: Any, hands: int, steps: int) -> None:
        self.choice = Choice(simulation.n, hands)
        self._steps = steps
        self._left = np.zeros(simulation.n, np.int64)
        """User steps for which the choice is still seen through."""
        self.space: spaces.Box[Any] = spaces.Box(-np.inf, np.inf, (hands, 4), np.float32)
        simulation.watch(self)

    @property
    def due(self) -> NDArray[np.int64]:
        """(K,) who decides now."""
        return np.flatnonzero(self._left <= 0)

    def decided(self, ids: NDArray[np.int64]) -> None:
        """Let what these users have just decided last."""
        self._left[ids] = self._steps

    def reset(self, ids: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Let these users rest, and decide at once."""
        self.choice.move[torch.from_numpy(np.asarray(ids))] = -1
        self._left[ids] = 0

    def glimpse(self, moment: Moment, substep: int) -> None:
        """Nothing: choices last whole user steps."""

    def take(self, moment: Moment, ids: NDArray[np.int64] | None) -> None:
        """A user step is over; a reset is none."""
        if ids is None:
            self._left -= 1

    def observe(self) -> NDArray[np.float32]:
        """(N, H, 4) move and place of every hand."""
        both = torch.cat([self.choice.move[..., None].float(), self.choice.place], -1)
        values: NDArray[np.float32] = both.numpy()
        return values

    def get_state(self, i: int) -> dict[str, Any]:
        """User i's choice."""
        choice = self.choice
        return {
            "move": choice.move[i].numpy().copy(),
            "place": choice.place[i].numpy().copy(),
            "left": int(self._left[i]),
        }

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """Restore what :meth:`get_state` returned."""
        self.choice.move[i] = torch.from_numpy(np.asarray(state["move"]))
        self.choice.place[i] = torch.from_numpy(np.asarray(state["place"]))
        self._left[i] = int(state["left"])
