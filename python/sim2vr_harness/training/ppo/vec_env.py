"""Stable-Baselines3's vector environment over a :class:`Simulation`."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.checks import checked_options, checked_seeds, checked_users
from sim2vr_harness.envs.simulation import Simulation

_SUMS = ("game_reward", "effort_cost")


class SimulationVecEnv(VecEnv):
    """N simulated users with autoreset, as Stable-Baselines3 expects them.

    The infos of users who play on are empty. When an episode ends, its user is reset at once; the
    last observation is in ``info["terminal_observation"]`` and ``info["episode"]`` holds, like
    SB3's Monitor, the return ``r``, the length ``l`` (steps) and the wall time ``t`` (s), the sums
    ``game_reward`` and ``effort_cost``, ``max_fatigued`` if the effort model knows it, and under
    ``log`` the game's final log. ``info["TimeLimit.truncated"]`` is set where the episode was cut
    by a time limit or by an app that failed; an episode of the latter kind has no
    ``info["episode"]``: its numbers are not those of a round.

    Args:
        simulation: The users; owned by the adapter from now on.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        super().__init__(simulation.n, simulation.observation_space, simulation.action_space)
        self._actions: NDArray | None = None
        self._started = time.monotonic()
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)
        self._sums = {name: np.zeros(self.num_envs) for name in _SUMS}
        self.last_logs: Any = None
        """The games' logs after the last step (``StepBatch.logs``), for displays; None before."""
        resolved = getattr(simulation, "resolved", None)
        self.facts = GameFacts("") if resolved is None else resolved.facts
        """Facts that the game publishes."""

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seeds of the next :meth:`reset`.

        They are drawn from ``seed``, not counted up from it, so that an evaluation, whose rounds
        have the seeds 1, 2, ..., does not repeat rounds of the training.
        """
        (checked,) = checked_seeds([seed], 1)
        drawn = np.random.SeedSequence(checked).generate_state(self.num_envs, np.uint32)
        self._seeds = [int(value) for value in drawn]
        return self._seeds

    def reset(self) -> dict[str, NDArray]:
        """Start a new episode for all users.

        With the seeds given to :meth:`seed` and the options given to :meth:`set_options`, if any.
        Options hold from this round on, as those of a single environment's ``reset`` do.

        Raises:
            ValueError: The game refuses an option.
        """
        seeds, options = list(self._seeds), [dict(one) for one in self._options]
        self._reset_seeds()
        self._reset_options()
        # Users in groups of equal options, in the order of each group's first.
        groups: list[list[int]] = []
        for alike_i, alike_one in enumerate(options):
            for group in groups:
                if options[group[0]] == alike_one:
                    group.append(alike_i)
                    break
            else:
                groups.append([alike_i])
        for ids in groups:
            infos = self.simulation.reset(
                ids=ids, seeds=[seeds[i] for i in ids], options=options[ids[0]] or None
            )
            for i, info in zip(ids, infos, strict=True):
                self.reset_infos[i] = info
        self._actions = None
        self._clear(slice(None))
        return self.simulation.observation()

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Set the game's options of the next :meth:`reset`: of all users, or one mapping for each.

        Raises:
            ValueError: They are neither.
        """
        given = options if isinstance(options, list) else [options] * self.num_envs
        if len(given) != self.num_envs:
            raise ValueError(f"options: got {len(given)}, expected {self.num_envs}, one per user")
        self._options = [checked_options(one) for one in given]

    def step_async(self, actions: NDArray) -> None:
        """Copy the actions, (N, A) in [-1, 1], for the next :meth:`step_wait`.

        Raises:
            ValueError: Another shape, or no numbers.
        """
        taken, shape = np.array(actions), (self.num_envs, *(self.action_space.shape or ()))
        if taken.shape != shape or taken.dtype.kind not in "fiu":
            raise ValueError(
                f"actions: got {taken.dtype} {taken.shape}, expected real numbers {shape}"
            )
        self._actions = taken

    def step_wait(self) -> tuple[dict[str, NDArray], NDArray, NDArray, list[dict[str, Any]]]:
        """Advance every user by one step; see the class for episodes that end."""
        if self._actions is None:
            raise RuntimeError("step_wait was called without step_async")
        actions, self._actions = self._actions, None
        result = self.simulation.step(actions)
        self._returns += result.reward
        self._lengths += 1
        for name, sums in self._sums.items():
            sums += getattr(result, name)
        self.last_logs = result.logs
        dones = np.asarray(result.over, dtype=bool)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        observation = self.simulation.observation()
        ended = np.flatnonzero(dones).tolist()
        if ended:
            for i in ended:
                infos[i] = self._end(i, observation, result)
            self.simulation.reset(ids=ended)
            observation = self.simulation.observation()
        return observation, result.reward.astype(np.float32), dones, infos

    def _end(self, i: int, observation: dict[str, NDArray], result: Any) -> dict[str, Any]:
        """Return the info of user i, whose episode has ended."""
        info: dict[str, Any] = result.info(i)
        info["terminal_observation"] = {key: value[i] for key, value in observation.items()}
        info["TimeLimit.truncated"] = not bool(result.terminated[i])
        if info.get("termination") != "app_failed":
            info["episode"] = {
                "r": float(self._returns[i]),
                "l": int(self._lengths[i]),
                "t": round(time.monotonic() - self._started, 3),
                **{name: float(sums[i]) for name, sums in self._sums.items()},
                # A diverged user's app was not asked in the last step: the log before stands.
                "log": {key: float(value) for key, value in result.logs[i].items()},
            }
            if "max_fatigued" in info:
                info["episode"]["max_fatigued"] = float(info["max_fatigued"])
        self._clear(i)
        return info

    def _clear(self, which: int | slice | list[int]) -> None:
        self._returns[which] = 0.0
        self._lengths[which] = 0
        for sums in self._sums.values():
            sums[which] = 0.0

    def state_dict(self) -> dict[str, NDArray]:
        """Return the exact state: users, apps and the unfinished episodes' sums."""
        sums = {f"sums.{key}": values.copy() for key, values in self._sums.items()}
        own = {"returns": self._returns.copy(), "lengths": self._lengths.copy()}
        return own | sums | self.simulation.state_dict()

    def load_state_dict(self, state: Mapping[str, NDArray]) -> list[int]:
        """Continue from :meth:`state_dict` of an environment with the same configuration.

        Returns:
            The users whose rounds start again because their apps cannot be saved.
        """
        saved = len(state["lengths"])
        if saved != self.num_envs:
            raise RuntimeError(f"the saved state is of {saved} users, not of {self.num_envs}")
        anew = self.simulation.load_state_dict(state)
        self._returns[:], self._lengths[:] = state["returns"], state["lengths"]
        for key, sums in self._sums.items():
            sums[:] = state[f"sums.{key}"]
        self._clear(anew)
        return anew

    def close(self) -> None:
        """Free the simulation."""
        self.simulation.close()

    # --- what SB3 asks of single environments ---------------------------------------------------

    def _get_indices(self, indices: Any) -> list[int]:
        """The users that are meant.

        Raises:
            ValueError: There is no such user, or one comes twice.
        """
        return checked_users("indices", indices, self.num_envs)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the simulation, once per environment."""
        count = len(self._get_indices(indices))
        if attr_name == "render_mode":
            return [None] * count
        return [getattr(self.simulation, attr_name)] * count

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the users of one simulation share their settings."""
        self._get_indices(indices)
        raise NotImplementedError(
            f"cannot set {attr_name!r}: the users of one simulation share their settings; "
            "make a new one with another EnvConfig"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of single environments' apps, for example ``render_headset``."""
        apps: Sequence[Any] = self.get_attr("apps", indices=[0])[0]
        chosen = self._get_indices(indices)
        return [getattr(apps[i], method_name)(*method_args, **method_kwargs) for i in chosen]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for every environment: nothing is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray | None]:
        """Return None for every environment: images are requested from the apps instead."""
        return [None] * self.num_envs
