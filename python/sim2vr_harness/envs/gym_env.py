"""The Gymnasium environment: one simulated user in one app."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from sim2vr_harness.client import OptionValue
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.pictures import RENDER_MODES, Views
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Observation, Simulation
from sim2vr_harness.registration import require_known


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
        """Show an image, (H, W, 3) uint8, no sooner than one frame after the last."""
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
        """Close the window; idempotent."""
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickle and copy: a copy opens its own window."""
        return {"_title": self._title, "_fps": self._fps}

    def __setstate__(self, made: dict[str, Any]) -> None:
        """Restore a copy from :meth:`__getstate__`."""
        self.__init__(made["_title"], made["_fps"])  # type: ignore[misc]


RenderMode = Literal["rgb_array", "headset", "body", "human"]


class Sim2VREnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A muscle-driven user with headset and controller in a VR game.

    Action: (32,) changes of muscle activation in [-1, 1], then those of fingers and gaze if the
    configuration gives the user any. Observation: an entry per sense, by default ``vision``
    (C, H, W) uint8 headset image (green and depth), ``proprioception`` (56,) and
    ``stateful_information`` (1,) the game's time feature. Reward: the game's, minus the cost of
    effort. 20 user steps per second of 25 physics steps each.

    Environments can be pickled and copied in the middle of a round: the copy continues exactly, in
    an app of its own, and writes no logs.

    Args:
        condition: a condition that the game publishes; None leaves its options as they are.
        config: the whole environment; None: the defaults.
        render_mode: the image that :meth:`render` returns, (480, 640, 3) uint8: ``rgb_array`` the
            game and the user's hand from outside, ``headset`` the user's view, ``body`` the body;
            ``human`` shows ``rgb_array`` in a window after every reset and step.
        log_dir: root of the episode logs, or None.
        game: another game than the configuration's.
        unknown: rejected; the error names the keywords above.

    Raises:
        ValueError: a setting that cannot be used; names it, the given and the expected value.
        DependencyNotInstalled: ``human`` without pygame.
    """

    metadata = {"render_modes": [*RENDER_MODES, "human"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        condition: str | None = None,
        config: EnvConfig | ResolvedEnv | None = None,
        render_mode: RenderMode | None = None,
        log_dir: str | Path | None = None,
        game: str | None = None,
        **unknown: Any,
    ) -> None:
        require_known(unknown, Sim2VREnv.__init__)
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode: got {render_mode!r}, expected one of "
                f"{self.metadata['render_modes']} or None"
            )
        env = ResolvedEnv.of(config).with_game(game).with_condition(condition)
        self.render_mode = render_mode
        fps = env.config.action_frequency_hz
        self.metadata = {**self.metadata, "render_fps": fps}
        self._window = Window("sim2vr", fps) if render_mode == "human" else None
        self.simulation = Simulation(env, 1, log_dir=None if log_dir is None else Path(log_dir))
        self.observation_space = self.simulation.observation_space  # type: ignore[assignment]
        self.action_space = self.simulation.action_space
        self._views = Views(self.simulation)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, OptionValue] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; ``options`` are game options from this round on."""
        super().reset(seed=seed)
        infos = self.simulation.reset(seeds=[seed], options=options)
        self._show()
        return self._observation(), infos[0]

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one user step; info as :class:`~sim2vr_harness.envs.simulation.StepBatch`."""
        batch = self.simulation.step(np.asarray(action)[None])
        self._show()
        return (
            self._observation(),
            float(batch.reward[0]),
            bool(batch.terminated[0]),
            bool(batch.truncated[0]),
            batch.infos[0],
        )

    def _observation(self) -> Observation:
        return {key: rows[0] for key, rows in self.simulation.observation().items()}

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self._views.draw("rgb_array", 0))

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image of the last frame by ``render_mode``, (480, 640, 3) uint8, or None."""
        if self.render_mode is None or self.render_mode == "human":
            return None
        return self._views.draw(self.render_mode, 0)

    def close(self) -> None:
        """End the app."""
        self.simulation.close()
        self._views.close()
        if self._window is not None:
            self._window.close()
