"""Base class of benchmark scenes, with the seeds, actions and hashes that they share.

Every scene starts from fixed seeds and plays :data:`WARM_UP_STEPS` steps with fixed actions, after
which its state is hashed. User i does the same in every scene of users, for any N, number of
threads and transport.
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from measure.turns import TURNS, Turn, timed_turn
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.runs.config import TrainingConfig

IN_PROCESS = "in_process"
"""The transport that the others are compared with."""

WARM_UP_STEPS = 30
"""User steps before the hash: 1.5 s of play, so that targets are there."""

ACTIONS = 32
"""Different batches of actions, played in a circle: making them costs no measured time."""

SHORT_ROUND_SECONDS = 2.0
SHORT_ROUND_EVERY = 30
"""One user in 30 plays rounds of 2 s instead of 60 s: resets then come as often as in a training,
once in 1,200 user steps, also in a measurement too short for a whole round."""


@dataclass(frozen=True)
class Spec:
    """One scene to measure; see :class:`~measure.rows.Row` for the fields."""

    scene: str
    config: TrainingConfig
    n: int
    threads: int
    transport: str | None = IN_PROCESS
    variant: str = ""
    train_steps: int = 1000

    def env(self, **app: Any) -> EnvConfig:
        """The users' configuration with this transport and these threads.

        Args:
            app: further settings of the app.
        """
        config = self.config.env
        kept = {"game", "options", "renderer", "page", "map", "browser", "task", "timeout_s"}
        if self.transport == "openxr":
            kept |= {"executable", "arguments", "transport_options"}
        settings = config.app.model_dump(include=kept)
        settings |= {"transport": self.transport or IN_PROCESS}
        settings |= {"processes": min(self.threads, self.n), **app}
        return config.model_copy(update={"app": AppConfig(**settings), "cores": self.threads})


class BenchScene(ABC):
    """Something to measure: :meth:`step` moves all users on by one step.

    Args:
        n: number of users.
    """

    unit = "user steps/s"
    state_hash: str | None = None
    observation_hash: str | None = None
    most_turns = TURNS

    def __init__(self, n: int) -> None:
        self.n = n
        self._stack = ExitStack()

    @abstractmethod
    def step(self) -> None:
        """One step of every user."""

    def measure(self, seconds: float) -> Turn:
        """One turn of about ``seconds``."""
        return timed_turn(self.step, self.n, seconds)

    def extra(self) -> dict[str, Any]:
        """Numbers for the row that only this scene has."""
        return {}

    def close(self) -> None:
        """Frees everything."""
        self._stack.close()


def actions(n: int, size: int) -> NDArray[np.float32]:
    """(ACTIONS, n, size) random actions in [-1, 1], as an untrained policy's.

    User i's do not depend on n.
    """
    users = [np.random.default_rng([7, i]).standard_normal((ACTIONS, size)) for i in range(n)]
    return np.clip(np.stack(users, axis=1), -1.0, 1.0).astype(np.float32)


def short_rounds(config: EnvConfig, n: int) -> list[int]:
    """The users with short rounds; none where the configuration or a level gives them a length."""
    if "round_seconds" in config.app.options or game_facts(config.app).level_option is not None:
        return []
    return list(range(SHORT_ROUND_EVERY // 2, n, SHORT_ROUND_EVERY))


def digest(parts: Sequence[bytes]) -> str:
    """16 hexadecimal digits."""
    whole = hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts))
    return whole.hexdigest()[:16]


def body_states(qpos: NDArray, qvel: NDArray, act: NDArray) -> list[bytes]:
    """Each user's joint angles, velocities and activations as bytes; arrays (N, ...)."""
    rows = np.concatenate([qpos, qvel, act], axis=1).astype("<f8")
    return [row.tobytes() for row in rows]


def user_state(simulation: Any, i: int) -> bytes:
    """Body of user i of a Simulation, and the app as far as it can say its state."""
    users = simulation.users
    (body,) = body_states(users.qpos[i, None], users.qvel[i, None], users.act[i, None])
    app = simulation.apps[i]
    if "save" not in app.capabilities:
        return body
    return body + int(app.state_hash()).to_bytes(8, "little")


def observation_digest(observation: dict[str, NDArray]) -> str:
    """Of a dictionary of arrays (N, ...)."""
    return digest([np.ascontiguousarray(observation[key]).tobytes() for key in sorted(observation)])
