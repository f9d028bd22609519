"""The headsets' pictures and poses of the last moments, whatever the users see of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.base.state import RowState
from sim2vr_harness.perception import StepContext
from sim2vr_harness.perception.wrappers import Ring

BEFORE_S = 0.2
"""How far apart the two pictures are that are looked at, s."""


class FrameHistory(RowState):
    """Colour and depth as the apps drew them; a ``Sense`` that watches N users.

    Args:
        simulation: the users; watched from their next reset on.
        late_steps: user steps by which everything is seen late.
    """

    _state = ("_ring", "_heads")

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
        pose = spaces.Box(-np.inf, np.inf, (7,), np.float64)
        self._heads = Ring("poses of the last moments", simulation.n, pose, late_steps)
        simulation.watch(self)

    def reset(self, ids: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Let these users' next picture be their whole past."""
        self._ring.forget(ids)
        self._heads.forget(ids)

    def sample(self, moment: StepContext, substep: int) -> None:
        """Nothing: pictures are drawn at the ends of user steps."""

    def take(self, moment: StepContext, ids: NDArray[np.int64] | None) -> None:
        """Take in what has just been drawn."""
        rows = range(len(self._apps)) if ids is None else ids
        if len(rows):
            self._ring.push(np.stack([self._one_eye(self._apps[i].image) for i in rows]), ids)
            heads = np.concatenate(moment.users.device_poses("headset"), axis=1)
            self._heads.push(heads[rows], ids)

    def observe(self) -> NDArray[np.uint8]:
        """(N, 8, H, W) red, green, blue and depth as seen now, and 0.2 s before; channels last."""
        now, before = self._ring.ago(self._late), self._ring.ago(self._late + self.before)
        return np.concatenate([now, before], axis=3).transpose(0, 3, 1, 2)

    def heads(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N, 3) and (N, 4) where headsets were when what is seen now was drawn."""
        pose = self._heads.ago(self._late)
        return pose[:, :3], pose[:, 3:]

    def _one_eye(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 4) of one eye, or of the left one of two, as ``vision`` has it."""
        own = image if image.ndim == 3 else image[0]
        return own[self._zoom // 2 :: self._zoom, self._zoom // 2 :: self._zoom]
