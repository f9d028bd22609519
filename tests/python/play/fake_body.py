"""Stands in for the drawing of the body, which needs OpenGL."""

from typing import Any

import numpy as np


class FakeBody:
    """Grey pictures of the size that is asked for."""

    def __init__(self, simulation: Any, width: int, height: int, fast: bool = False) -> None:
        self.size = height, width, 3

    def draw(self, index: int) -> np.ndarray:
        return np.full(self.size, 200, np.uint8)

    def close(self) -> None:
        pass
