"""A window for people to look on, by pygame."""

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray


class Window:
    """Shows pictures at their frame rate; opens with the first one.

    Args:
        title: of the window.
        fps: pictures per second, at most.

    Raises:
        DependencyNotInstalled: pygame is missing.
    """

    def __init__(self, title: str, fps: int) -> None:
        self._title, self._fps = title, fps
        try:
            import pygame
        except ImportError as error:
            raise DependencyNotInstalled(
                "render_mode: got 'human', which needs pygame; install it with "
                "'pip install sim2vr-harness[video]', or take 'rgb_array'"
            ) from error
        self._pygame: Any = pygame
        self._surface: Any = None
        self._clock: Any = None

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Shows a picture, (H, W, 3) uint8, no sooner than one frame after the last."""
        pygame, size = self._pygame, (picture.shape[1], picture.shape[0])
        if self._surface is None:
            pygame.display.init()
            pygame.display.set_caption(self._title)
            self._surface = pygame.display.set_mode(size)
            self._clock = pygame.time.Clock()
        drawn = pygame.surfarray.make_surface(np.ascontiguousarray(picture.swapaxes(0, 1)))
        self._surface.blit(drawn, (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Closes the window; idempotent."""
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and copy: a copy opens a window of its own."""
        return {"_title": self._title, "_fps": self._fps}

    def __setstate__(self, made: dict[str, Any]) -> None:
        """See :meth:`__getstate__`."""
        self.__init__(made["_title"], made["_fps"])  # type: ignore[misc]
