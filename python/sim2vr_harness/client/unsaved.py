"""Apps of others that draw their own frames: what pages and OpenXR programs have in common."""

from collections.abc import Mapping

import numpy as np

from sim2vr_harness.client.base import OptionValue, ThirdPersonView, UInt8Array
from sim2vr_harness.client.errors import AppError, AppUnsupported
from sim2vr_harness.client.scene import AppScene
from sim2vr_harness.client.split_step import SplitStep

FARTHEST_M = 10.0
"""Distance of which the depth channel's 255 is, as in our own runtime."""
VERTICAL_FOV_DEG = 90.0
FRAME_RATE_HZ = 72
"""What the app learns that the display does; the first Quest's."""


class UnsavedApp(SplitStep):
    """An app whose state is its own: it cannot be saved, nor drawn from outside.

    Args:
        kind: what it is, in a word with its article: ``a page``.
        width, height: of one eye's image, pixels.
        eyes: 1 or 2.
    """

    def __init__(self, kind: str, width: int, height: int, eyes: int) -> None:
        self._kind = kind
        self._closed = self._playing = False
        self._left = ""
        shape = (height, width, 4)
        self._image: UInt8Array = np.zeros((2, *shape) if eyes == 2 else shape, np.uint8)

    @property
    def image(self) -> UInt8Array:
        return self._image

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        """See :class:`AppClient`; such an app has no wish."""
        return None

    def render_headset(self, width: int, height: int) -> UInt8Array:
        """See :class:`AppClient`; a frame is drawn once, in its own size."""
        if self._image.shape == (height, width, 4):
            return self._image.copy()
        raise self._unsupported("views", "draws one view")

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        """See :class:`AppClient`; not for such an app."""
        raise self._unsupported("views", "draws one view")

    def scene(self) -> AppScene:
        """See :class:`AppClient`; not for such an app."""
        raise self._unsupported("scene", "keeps what it draws to itself")

    def save(self) -> bytes:
        """See :class:`AppClient`; not for such an app."""
        raise self._unsupported("save", "cannot be saved in a round")

    def load(self, state: bytes) -> None:
        """See :class:`AppClient`; not for such an app."""
        raise self._unsupported("save", "cannot be saved in a round")

    def state_hash(self) -> int:
        """See :class:`AppClient`; not for such an app."""
        raise self._unsupported("save", "cannot be saved in a round")

    def _unsupported(self, capability: str, why: str) -> AppUnsupported:
        return AppUnsupported(f"{capability}: {self._kind} {why}")

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
