"""Pictures of users at play, for people and videos."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.simulation import Simulation

RENDER_MODES: tuple[str, ...] = ("rgb_array", "headset", "body")
"""``rgb_array``: the game and the user's hand from outside."""
RENDER_SIZE = (640, 480)
"""Width and height."""


class Views:
    """Draws the users of a simulation.

    Args:
        simulation: of the users; stays the caller's.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._body_renderer: Any = None

    def draw(self, mode: str, i: int) -> NDArray[np.uint8]:
        """User i after its last frame, (480, 640, 3) uint8; ``mode`` is of ``RENDER_MODES``."""
        app = self._simulation.apps[i]
        if mode == "rgb_array":
            return app.render_third_person(*RENDER_SIZE)[..., :3]
        if mode == "headset":
            return app.render_headset(*RENDER_SIZE)[..., :3]
        if self._body_renderer is None:
            from sim2vr_harness.users.rendering import UserRenderer

            self._body_renderer = UserRenderer(self._simulation.body, *RENDER_SIZE)
        users = self._simulation.users
        picture: NDArray[np.uint8] = self._body_renderer.render(
            users.qpos[i], activations=users.act[i]
        )
        return picture

    def close(self) -> None:
        """Free the renderer; idempotent."""
        if self._body_renderer is not None:
            self._body_renderer.close()
            self._body_renderer = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickle and copy, without renderers, which a copy makes again."""
        return {"_simulation": self._simulation, "_body_renderer": None}
