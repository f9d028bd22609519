"""The Gymnasium environment: one simulated user in one app."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import OptionValue
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import with_condition, with_game
from sim2vr_harness.envs.simulation import Observation, Simulation

RenderMode = Literal["rgb_array", "headset", "body"]


class Sim2VREnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A muscle-driven user with headset and controller in a VR game.

    Action: (32,) changes of muscle activation in [-1, 1]. Observation: ``vision`` (C, H, W) uint8
    headset image (green and depth by default), ``proprioception`` (56,), ``stateful_information``
    (1,) the game's time feature. Reward: the game's, minus the cost of effort. 20 user steps per
    second of 25 physics steps each.

    Args:
        condition: a condition that the game publishes; None leaves its options as they are.
        config: the whole environment; None takes the defaults.
        render_mode: what :meth:`render` draws, as (480, 640, 3) uint8: ``rgb_array`` the game and
            the user's hand from outside, ``headset`` what the user sees, ``body`` the body.
        log_dir: root of the episode logs, or None.
        game: another game than the configuration's.

    Raises:
        ValueError: a setting that cannot be used; names it, what was got and what was expected.
    """

    metadata = {"render_modes": ["rgb_array", "headset", "body"], "render_fps": 20}  # noqa: RUF012
    render_size = (640, 480)

    def __init__(
        self,
        condition: str | None = None,
        config: EnvConfig | None = None,
        render_mode: RenderMode | None = None,
        log_dir: str | Path | None = None,
        game: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode: got {render_mode!r}, expected one of "
                f"{self.metadata['render_modes']} or None"
            )
        config = with_game(EnvConfig() if config is None else config, game)
        config = with_condition(config, condition)
        self.render_mode = render_mode
        self.simulation = Simulation(config, 1, log_dir=None if log_dir is None else Path(log_dir))
        self.observation_space = self.simulation.observation_space  # type: ignore[assignment]
        self.action_space = self.simulation.action_space
        self._body_renderer: Any = None

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, OptionValue] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode; ``options`` are game options from this round on."""
        super().reset(seed=seed)
        infos = self.simulation.reset(seeds=[seed], options=options)
        return self._observation(), infos[0]

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One user step; see :class:`~sim2vr_harness.envs.simulation.StepBatch` for the info."""
        batch = self.simulation.step(np.asarray(action)[None])
        return (
            self._observation(),
            float(batch.reward[0]),
            bool(batch.terminated[0]),
            bool(batch.truncated[0]),
            batch.infos[0],
        )

    def _observation(self) -> Observation:
        return {key: rows[0] for key, rows in self.simulation.observation().items()}

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the last frame as ``render_mode`` says, (480, 640, 3) uint8, or None."""
        app = self.simulation.apps[0]
        if self.render_mode == "rgb_array":
            return app.render_third_person(*self.render_size)[..., :3]
        if self.render_mode == "headset":
            return app.render_headset(*self.render_size)[..., :3]
        if self.render_mode == "body":
            return self._render_body()
        return None

    def _render_body(self) -> NDArray[np.uint8]:
        if self._body_renderer is None:
            from sim2vr_harness.users.rendering import UserRenderer

            self._body_renderer = UserRenderer(self.simulation.body, *self.render_size)
        users = self.simulation.users
        picture: NDArray[np.uint8] = self._body_renderer.render(
            users.qpos[0], activations=users.act[0]
        )
        return picture

    def close(self) -> None:
        """Ends the app."""
        self.simulation.close()
        if self._body_renderer is not None:
            self._body_renderer.close()
            self._body_renderer = None
