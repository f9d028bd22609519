"""Apps of others that draw their own frames: what pages and OpenXR programs have in common."""

import numpy as np

from sim2vr_harness.client.base import AppClient, UInt8Array
from sim2vr_harness.client.errors import AppError

FARTHEST_M = 10.0
"""Distance of which the depth channel's 255 is, as in our own runtime."""
VERTICAL_FOV_DEG = 90.0
FRAME_RATE_HZ = 72
"""What the app learns that the display does; the first Quest's."""


class ForeignApp(AppClient):
    """An app whose state is its own: it cannot be saved, nor drawn from outside.

    Args:
        width, height: of one eye's image, pixels.
        eyes: 1 or 2.
    """

    def __init__(self, width: int, height: int, eyes: int) -> None:
        self._closed = self._playing = False
        self._left = ""
        shape = (height, width, 4)
        self._image: UInt8Array = np.zeros((2, *shape) if eyes == 2 else shape, np.uint8)

    @property
    def image(self) -> UInt8Array:
        return self._image

    def _require_open(self) -> None:
        if self._closed:
            raise RuntimeError("the app is closed; make a new one")

    def _require_round(self) -> None:
        """Refuse a step without a round, or while another one is under way."""
        self._require_open()
        if not self._playing:
            raise AppError(f"step: {self._left or 'no round was started'}; call reset first")

    def close(self) -> None:
        self._closed = True
