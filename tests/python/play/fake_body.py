"""Stands in for the drawing of the body, which needs OpenGL."""

from typing import Any

import numpy as np


class FakeBody:
    """Grey pictures of the size that is asked for."""

    def __init__(
        self, simulation: Any, size: tuple[int, int], headset: tuple[int, int], **_: Any
    ) -> None:
        self.sizes = [(height, width, 3) for width, height in (size, headset)]

    def draw(self, index: int) -> tuple[np.ndarray, ...]:
        return tuple(np.full(size, 200, np.uint8) for size in self.sizes)

    def close(self) -> None:
        pass
