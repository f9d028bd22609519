"""The headsets' pictures of the last moments, whatever the users themselves see of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.perception import Moment
from sim2vr_harness.perception.wrappers import Ring

__all__ = ["BEFORE_S", "PastPictures", "detail_of"]

BEFORE_S = 0.2
"""How far apart the two pictures are that are looked at, s."""


def detail_of(env: EnvConfig) -> int:
    """How many times finer than the rest the middle of the picture is seen; 1: no finer."""
    return 1 if env.sense("fovea") is None else env.vision.zoom


class PastPictures:
    """Colour and depth as the apps drew them; a ``Sense`` that watches N users.

    Users who have the sense ``fovea`` see the middle in detail, too.

    Args:
        simulation: the users; watched from their next reset on.
        late_steps: user steps by which everything is seen late.
    """

    name, pauses, frame = "pictures of the last moments", (), -1
    needs: str | None = None

    def __init__(self, simulation: Any, late_steps: int = 0) -> None:
        self._apps, self._late = simulation.apps, late_steps
        vision = simulation.config.vision
        self._zoom: int = vision.zoom
        shape = (vision.height, vision.width, 4)
        self.space: spaces.Box[Any] = spaces.Box(0, 255, shape, np.uint8)
        self.before = round(BEFORE_S * simulation.config.action_frequency_hz)
        self._ring = Ring(self.name, simulation.n, self.space, late_steps + self.before)
        self._middle: Ring | None = None
        if detail_of(simulation.config) > 1:
            seen: spaces.Box[Any] = spaces.Box(0, 255, (*shape[:2], 3), np.uint8)
            self._middle = Ring("middle of the picture", simulation.n, seen, late_steps)
        simulation.watch(self)

    @property
    def channels(self) -> int:
        """C of :meth:`observe`."""
        return 8 if self._middle is None else 11

    def reset(self, ids: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Let these users' next picture be their whole past."""
        self._ring.forget(ids)
        if self._middle is not None:
            self._middle.forget(ids)

    def glimpse(self, moment: Moment, substep: int) -> None:
        """Nothing: pictures are drawn at the ends of user steps."""

    def take(self, moment: Moment, ids: NDArray[np.int64] | None) -> None:
        """Take in what has just been drawn."""
        rows = range(len(self._apps)) if ids is None else ids
        if not len(rows):
            return
        drawn = [self._one_eye(self._apps[i].image) for i in rows]
        self._ring.push(np.stack([self._wide(image) for image in drawn]), ids)
        if self._middle is not None:
            self._middle.push(np.stack([self._detailed(image) for image in drawn]), ids)

    def observe(self) -> NDArray[np.uint8]:
        """(N, C, H, W) red, green, blue and depth as seen now, and 0.2 s before.

        C is 8, or 11 with red, green and blue of the middle in detail.
        """
        seen = [self._ring.ago(self._late), self._ring.ago(self._late + self.before)]
        if self._middle is not None:
            seen.append(self._middle.ago(self._late))
        return np.ascontiguousarray(np.concatenate(seen, axis=3).transpose(0, 3, 1, 2))

    def get_state(self, i: int) -> dict[str, Any]:
        """User i's past."""
        middle = {} if self._middle is None else {"middle": self._middle.get_state(i)}
        return self._ring.get_state(i) | middle

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """Restore what :meth:`get_state` returned."""
        self._ring.set_state(i, state)
        if self._middle is not None:
            self._middle.set_state(i, state["middle"])

    @staticmethod
    def _one_eye(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Of one eye, or of the left one of two, as it was drawn."""
        return image if image.ndim == 3 else image[0]

    def _wide(self, drawn: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 4) as ``vision`` has it."""
        return drawn[self._zoom // 2 :: self._zoom, self._zoom // 2 :: self._zoom]

    def _detailed(self, drawn: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) as ``fovea`` has it."""
        height, width = self.space.shape[:2]
        top, left = (self._zoom - 1) * height // 2, (self._zoom - 1) * width // 2
        return drawn[top : top + height, left : left + width, :3]
