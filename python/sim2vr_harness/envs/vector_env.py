"""N simulated users as one Gymnasium vector environment."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sim2vr_harness.client import OptionValue
from sim2vr_harness.envs.checks import checked_options, checked_seeds
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.pictures import RENDER_MODES, Views
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.shards import make_simulation
from sim2vr_harness.envs.simulation import Observation, Simulation
from sim2vr_harness.registration import require_known


class Sim2VRVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Users who start a new episode by themselves when one has ended.

    Actions (N, A), observations as :meth:`Simulation.observation`, rewards (N,) float64. Infos
    hold ``game_reward`` and ``effort_cost``, (N,) each. Episodes end as in Gymnasium's own vector
    environments, by ``autoreset_mode``:

    - ``SAME_STEP``: the next one starts in the very step. ``final_obs`` (object array of N) has the
      last observation and ``final_info`` the last info, with the game's log.
    - ``NEXT_STEP``: the next call of :meth:`step` starts it, whatever the user's action; the reward
      is 0 there. The last infos (``termination``, ``log``, ...) come with the step of the end.
    - ``DISABLED``: :meth:`reset` does, with a ``reset_mask``.

    Like single environments they can be pickled and copied.

    Args:
        num_envs: number of users N.
        condition: a condition that the game publishes; None leaves its options as they are.
        config: the whole environment; None takes the defaults.
        render_mode: what :meth:`render` draws of every user: ``rgb_array``, ``headset`` or ``body``
            (see :class:`Sim2VREnv`).
        log_dir: root of the episode logs, or None.
        autoreset_mode: an ``AutoresetMode`` or its value, such as ``"NextStep"``.
        game: another game than the configuration's.

    Raises:
        ValueError: a setting that cannot be used; names it, what was got and what was expected.
    """

    metadata = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": list(RENDER_MODES),
        "render_fps": 20,
    }

    def __init__(
        self,
        num_envs: int = 1,
        condition: str | None = None,
        config: EnvConfig | ResolvedEnv | None = None,
        render_mode: str | None = None,
        log_dir: str | Path | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        game: str | None = None,
        **unknown: Any,
    ) -> None:
        super().__init__()
        require_known(unknown, Sim2VRVectorEnv.__init__)
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(
                f"render_mode: got {render_mode!r}, expected one of {list(RENDER_MODES)} or None"
            )
        modes = [mode.value for mode in AutoresetMode]
        if autoreset_mode not in (*AutoresetMode, *modes):
            raise ValueError(f"autoreset_mode: got {autoreset_mode!r}, expected one of {modes}")
        env = ResolvedEnv.of(config).with_game(game).with_condition(condition)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.render_mode = render_mode
        self.metadata = {
            **self.metadata,
            "autoreset_mode": self.autoreset_mode,
            "render_fps": env.config.action_frequency_hz,
        }
        # Images are drawn in this process.
        make = make_simulation if render_mode is None else Simulation
        self.simulation = make(env, num_envs, log_dir=None if log_dir is None else Path(log_dir))
        self.num_envs = num_envs
        self.single_observation_space = self.simulation.observation_space
        self.single_action_space = self.simulation.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._views = Views(self.simulation)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Start episodes.

        Args:
            seed: user i gets seed + i, or the i-th of N.
            options: game options from this round on; ``reset_mask`` (N,) bool resets only some
                users.

        Raises:
            ValueError: an option, a seed or a mask that cannot be used; rounds are unchanged.
        """
        game_options: dict[str, Any] = checked_options(options)
        mask = game_options.pop("reset_mask", np.ones(self.num_envs, dtype=bool))
        if np.shape(mask) != (self.num_envs,) or np.asarray(mask).dtype != np.bool_:
            raise ValueError(
                f"reset_mask: got {np.asarray(mask).dtype} {np.shape(mask)}, expected bool "
                f"({self.num_envs},)"
            )
        ids = np.flatnonzero(np.asarray(mask)).tolist()
        if isinstance(seed, (int, np.integer)) and not isinstance(seed, bool):
            seed = [int(seed) + i for i in range(self.num_envs)]
        seeds = checked_seeds(seed, self.num_envs)  # type: ignore[arg-type]
        chosen = [seeds[i] for i in ids]
        infos = self._start({}, ids, chosen, game_options or None)
        return self.simulation.observation(), infos

    def _start(
        self,
        infos: dict[str, Any],
        ids: Sequence[int],
        seeds: Sequence[int | None] | None = None,
        options: Mapping[str, OptionValue] | None = None,
    ) -> dict[str, Any]:
        """Start episodes and add their infos."""
        started = self.simulation.reset(ids=ids, seeds=seeds, options=options)
        for i, info in zip(ids, started, strict=True):
            infos = self._add_info(infos, dict(info), i)
        return infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all users by one step; see the class for the end of episodes."""
        waiting = np.zeros(0, dtype=np.int64)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            waiting = np.flatnonzero(self.simulation.over)
        batch = self.simulation.step(actions, resting=waiting)
        infos: dict[str, Any] = {}
        played = np.ones(self.num_envs, dtype=bool)
        played[waiting] = False
        for name in ("game_reward", "effort_cost"):
            infos[name] = getattr(batch, name)
            infos[f"_{name}"] = played.copy()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and batch.ends:
            ended = sorted(batch.ends)
            observation = self.simulation.observation()
            for i in ended:
                last = {key: rows[i].copy() for key, rows in observation.items()}
                infos = self._add_info(infos, {"final_obs": last, "final_info": batch.info(i)}, i)
            self.simulation.reset(ids=ended)
        elif self.autoreset_mode != AutoresetMode.SAME_STEP:
            for i, end in batch.ends.items():
                infos = self._add_info(infos, end | {"log": dict(batch.logs[i])}, i)
        if len(waiting):
            infos = self._start(infos, waiting.tolist())
        observation = self.simulation.observation()
        return observation, batch.reward, batch.terminated, batch.truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return an image of each user, (480, 640, 3) uint8, or None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._views.draw(self.render_mode, i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """End the apps."""
        self.simulation.close()
        self._views.close()
