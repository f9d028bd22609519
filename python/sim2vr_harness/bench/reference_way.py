"""The same users as the reference runs them, to compare with.

SIM2VR trains with Stable-Baselines3's ``SubprocVecEnv``: each user is a Python process of its own
that steps its own MuJoCo simulation, and talks to an app process of its own over protocol 1. Here
the processes hold our environment of one user and our app, so what is compared is the way of
running them: bodies, game and pictures are the same to the bit.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any

import gymnasium

from sim2vr_harness import paths
from sim2vr_harness.bench.processes import descendants_memory_mb
from sim2vr_harness.bench.scenes import (
    ACTIONS,
    SHORT_ROUND_SECONDS,
    WARM_UP_STEPS,
    Scene,
    Spec,
    actions,
    digest,
    observation_digest,
    short_rounds,
    user_state,
)
from sim2vr_harness.bench.turns import Turn
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.gym_env import Sim2VREnv
from sim2vr_harness.training.errors import InputError

__all__ = ["MOST_USERS", "ReferenceWayScene"]

_CLOSE_S = 10.0

MOST_USERS = 128
"""Two processes per user: 128 users take some 15 GB."""


class ReferenceWayScene(Scene):
    """N users with a Python process and an app process each.

    Raises:
        InputError: more than MOST_USERS users.
        FileNotFoundError: the app's executable was not built.
    """

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        from sim2vr_harness.training.measuring import subprocess_vec_env

        if spec.n > MOST_USERS:
            raise InputError(
                "--n",
                f"{spec.n} with scene reference-way",
                f"at most {MOST_USERS}: every user takes two processes",
            )
        paths.app_executable()
        config = spec.env()
        self._env = subprocess_vec_env([partial(_make_user, config) for _ in range(spec.n)])
        self._stack.callback(self._close_env)
        try:
            self._start(config)
        except (EOFError, ConnectionError) as error:
            self.close()
            raise RuntimeError("reference-way: a user's process has ended; see above") from error
        except BaseException:
            self.close()
            raise

    def _start(self, config: EnvConfig) -> None:
        env = self._env
        for i in range(self.n):
            env.env_method("reset", seed=i, indices=[i])
        for i in short_rounds(config, self.n):
            env.env_method("reset", options={"round_seconds": SHORT_ROUND_SECONDS}, indices=[i])
        assert env.action_space.shape is not None
        self._actions = actions(self.n, env.action_space.shape[0])
        self._steps = 0
        observation: Any = None
        for _ in range(WARM_UP_STEPS):
            observation = self._step()
        self.state_hash = digest(env.env_method("state"))
        self.observation_hash = observation_digest(observation)

    def _step(self) -> Any:
        observation, *_ = self._env.step(self._actions[self._steps % ACTIONS])
        self._steps += 1
        return observation

    def step(self) -> None:
        """See the base class."""
        self._step()

    def measure(self, seconds: float) -> Turn:
        """See the base class."""
        try:
            return super().measure(seconds)
        except (EOFError, ConnectionError) as error:
            raise RuntimeError("reference-way: a user's process has ended; see above") from error

    def extra(self) -> dict[str, Any]:
        """Memory of all the processes."""
        memory_mb = descendants_memory_mb()
        return {} if memory_mb is None else {"processes_memory_mb": round(memory_mb, 1)}

    def _close_env(self) -> None:
        # Not by the environment's own close: interrupted within a step it waits for answers that
        # were taken already.
        for remote in self._env.remotes:
            with suppress(OSError):  # the process has ended
                remote.send(("close", None))
        for process in self._env.processes:
            process.join(timeout=_CLOSE_S)
            if process.is_alive():
                process.kill()
                process.join()


class _User(gymnasium.Wrapper):
    """One user's environment that tells its state; lives in a worker process."""

    def state(self) -> bytes:
        return user_state(self._inner.simulation, 0)

    @property
    def _inner(self) -> Sim2VREnv:
        inner = self.unwrapped
        assert isinstance(inner, Sim2VREnv)
        return inner


def _make_user(config: EnvConfig) -> gymnasium.Env:
    app = config.app.model_copy(update={"transport": "protocol1"})
    return _User(Sim2VREnv(config=config.model_copy(update={"app": app, "threads": 1})))
