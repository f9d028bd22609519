"""What can be measured: the body alone, the game alone, drawing, whole users, learning.

Every scene starts from fixed seeds and plays :data:`WARM_UP_STEPS` steps with fixed actions, after
which its state is hashed. User i does the same in every scene of users, whatever N, the threads or
the transport.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.bench.turns import TURNS, Turn, timed_turn
from sim2vr_harness.client import AppClient, DevicePoses, InProcessBatch, frame_time_ns
from sim2vr_harness.envs.apps import app_factory, in_process_batch
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.perception import HeadsetVision
from sim2vr_harness.training.config import TrainingConfig

__all__ = [
    "DRAWING",
    "SCENES",
    "TRANSPORTS",
    "WARM_UP_STEPS",
    "Scene",
    "SceneName",
    "Spec",
    "open_scene",
]

SceneName = Literal["physics", "game", "render", "env", "reference-way", "train"]
SCENES: tuple[SceneName, ...] = get_args(SceneName)

Transport = Literal["in_process", "protocol1", "protocol2"]
TRANSPORTS: tuple[Transport, ...] = get_args(Transport)

DRAWING: tuple[SceneName, ...] = ("render", "env", "reference-way", "train")
"""The scenes whose apps draw."""

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
    """One scene to measure; see :class:`~sim2vr_harness.bench.rows.Row` for the fields."""

    scene: SceneName
    config: TrainingConfig
    n: int
    threads: int | None
    transport: Transport | None = "in_process"
    variant: str = ""
    train_steps: int = 1000

    def env(self, *, blind: bool = False) -> EnvConfig:
        """The users' configuration with this transport and these threads.

        Args:
            blind: whether the apps draw nothing.
        """
        config = self.config.env
        settings = config.app.model_dump(include={"game", "options", "renderer"})
        if blind:
            settings["renderer"] = "null"
        threads = self.threads or 1
        app = AppConfig(
            **settings, transport=self.transport or "in_process", processes=min(threads, self.n)
        )
        return config.model_copy(update={"app": app, "threads": threads})


class Scene(ABC):
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


def open_scene(spec: Spec) -> Scene:
    """Makes a scene and plays its warm-up.

    Raises:
        ValueError: a setting that cannot be used.
        RuntimeError: an app or its renderer cannot be started.
    """
    makers: dict[SceneName, Callable[[Spec], Scene]] = {
        "physics": PhysicsScene,
        "game": lambda spec: AppScene(spec, blind=True),
        "render": lambda spec: AppScene(spec, blind=False),
        "env": EnvScene,
        "reference-way": _reference_way,
        "train": _train,
    }
    return makers[spec.scene](spec)


def _reference_way(spec: Spec) -> Scene:
    from sim2vr_harness.bench.reference_way import ReferenceWayScene

    return ReferenceWayScene(spec)


def _train(spec: Spec) -> Scene:
    from sim2vr_harness.bench.train import TrainScene

    return TrainScene(spec)


# --- the body alone ------------------------------------------------------------------------------


class PhysicsScene(Scene):
    """MuJoCo's own Batch: the user's model, its physics steps per user step, random muscle control.

    The floor below which no environment of such users can come.
    """

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        from mujoco.batch import Batch

        from sim2vr_harness.envs.simulation import Simulation
        from sim2vr_harness.users.batch import UserBatch

        one = Simulation(spec.env(blind=True).model_copy(update={"app": _silent(spec)}), 1)
        self._stack.callback(one.close)
        self._substeps = one.users.substeps
        start = UserBatch(one.body, spec.n, threads=1, effort="zero")  # draws the start postures
        self._batch = Batch(one.body.physics_model, spec.n, spec.threads or 1)
        self._act, self._ctrl = self._batch.bind("act"), self._batch.bind("ctrl")
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._qpos[:], self._qvel[:], self._act[:] = start.qpos, start.qvel, start.act
        self._actions = actions(spec.n, self._act.shape[1])
        self._steps = 0
        for _ in range(WARM_UP_STEPS):
            self.step()
        self.state_hash = digest(body_states(self._qpos, self._qvel, self._act))

    def step(self) -> None:
        """See the base class."""
        action = self._actions[self._steps % ACTIONS]
        np.clip(self._act + action, 0.0, 1.0, out=self._ctrl)
        self._batch.step(nstep=self._substeps)
        self._steps += 1


def _silent(spec: Spec) -> AppConfig:
    settings = spec.config.env.app.model_dump(include={"game", "options"})
    return AppConfig(**settings, renderer="null")


# --- apps alone ----------------------------------------------------------------------------------


class AppScene(Scene):
    """Apps whose player's head and hand circle; one frame per step, the headset image drawn or not.

    Args:
        spec: what to measure.
        blind: whether nothing is drawn (``game``); else every frame is (``render``).
    """

    unit = "frames/s"
    _POSES = 64  # different ones, played in a circle

    def __init__(self, spec: Spec, *, blind: bool) -> None:
        super().__init__(spec.n)
        config = spec.env(blind=blind)
        self._frequency_hz = config.action_frequency_hz
        self._vision = HeadsetVision(
            config.vision.channels, height=config.vision.height, width=config.vision.width
        )
        self._circle = _circling_poses(self._POSES)
        self._frame, self._over = 0, True
        self._batch: InProcessBatch | None = None
        self._apps: list[AppClient] = []
        try:
            if config.app.transport == "in_process":
                self._open_batch(config)
            else:
                make = app_factory(config, self.n)
                for index in range(self.n):
                    self._apps.append(make(config, index, None))
                    self._stack.callback(self._apps[-1].close)
            for _ in range(WARM_UP_STEPS + 1):  # the first one is the reset
                self.step()
        except BaseException:
            self.close()
            raise
        if not blind:
            self.observation_hash = digest([picture.tobytes() for picture in self._pictures()])
        self.state_hash = digest([app.state_hash().to_bytes(8, "little") for app in self._apps])

    def _open_batch(self, config: EnvConfig) -> None:
        self._batch = in_process_batch(config, self.n, None, self._vision.channel_indices)
        for index in range(self.n):
            self._apps.append(self._batch.app(index))
            self._stack.callback(self._apps[-1].close)

    def _pictures(self) -> NDArray[np.uint8]:
        """(N, C, H, W) the channels that the users see."""
        if self._batch is not None:
            return self._batch.vision
        return np.stack([self._vision.pick(app.image) for app in self._apps])

    def step(self) -> None:
        """A step of every app, or a reset of all where a round is over."""
        # Every app's player is elsewhere on the circle, so that the pictures differ.
        places = (self._frame + 7 * np.arange(self.n)) % self._POSES
        head, hand = self._circle[0][places], self._circle[1][places]
        if self._over:
            self._reset(head, hand)
            return
        self._frame += 1
        time_ns = frame_time_ns(self._frame, self._frequency_hz)
        if self._batch is not None:
            times = np.full((self.n, 1), time_ns, dtype=np.int64)
            everyone = np.arange(self.n)
            self._batch.step_frames(everyone, times, DevicePoses(head[:, None], hand[:, None]))
            self._over = bool(self._batch.finished.any())
            return
        for i, app in enumerate(self._apps):
            app.start_step(np.array([time_ns]), DevicePoses(head[i, None], hand[i, None]))
        self._over = any([app.finish_step().finished for app in self._apps])

    def _reset(self, head: NDArray[np.float64], hand: NDArray[np.float64]) -> None:
        for i, app in enumerate(self._apps):
            app.reset(i, DevicePoses(head[i], hand[i]))
        self._frame, self._over = 0, False


def _circling_poses(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Head and right hand, (count, 7) each: the hand circles in front of the body."""
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    zero, one = np.zeros(count), np.ones(count)
    rest = [zero, zero, zero, one]
    head = np.stack([0.01 * np.sin(turn), 1.17 * one, zero, *rest], axis=1)
    hand = [0.15 + 0.1 * np.cos(turn), 1.07 + 0.1 * np.sin(turn), 0.35 * one]
    return head, np.stack([*hand, *rest], axis=1)


# --- whole users ---------------------------------------------------------------------------------


class EnvScene(Scene):
    """Users in their apps as a learner gets them: vector environment, autoreset, observations."""

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        from sim2vr_harness.envs.simulation import Simulation
        from sim2vr_harness.training.vec_env import SimulationVecEnv

        config = spec.env()
        self.env = SimulationVecEnv(Simulation(config, spec.n))
        self._stack.callback(self.env.close)
        try:
            simulation: Any = self.env.simulation
            self.env.reset()
            simulation.reset(seeds=list(range(spec.n)))
            if short := short_rounds(config, spec.n):
                simulation.reset(ids=short, options={"round_seconds": SHORT_ROUND_SECONDS})
            self._actions = actions(spec.n, self.env.action_space.shape[0])  # type: ignore[index]
            self._steps = 0
            for _ in range(WARM_UP_STEPS):
                self.step()
            self.state_hash = digest([user_state(simulation, i) for i in range(spec.n)])
            self.observation_hash = observation_digest(simulation.observation())
        except BaseException:
            self.close()
            raise

    def step(self) -> None:
        """See the base class."""
        self.env.step(self._actions[self._steps % ACTIONS])
        self._steps += 1


def actions(n: int, size: int) -> NDArray[np.float32]:
    """(ACTIONS, n, size) random actions in [-1, 1], as an untrained policy's.

    User i's do not depend on n.
    """
    users = [np.random.default_rng([7, i]).standard_normal((ACTIONS, size)) for i in range(n)]
    return np.clip(np.stack(users, axis=1), -1.0, 1.0).astype(np.float32)


def short_rounds(config: EnvConfig, n: int) -> list[int]:
    """The users with short rounds; none in games that do not have the option."""
    if config.app.game != "whacamole" or "round_seconds" in config.app.options:
        return []
    return list(range(SHORT_ROUND_EVERY // 2, n, SHORT_ROUND_EVERY))


# --- hashes --------------------------------------------------------------------------------------


def digest(parts: Sequence[bytes]) -> str:
    """16 hexadecimal digits."""
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[
        :16
    ]


def body_states(qpos: NDArray, qvel: NDArray, act: NDArray) -> list[bytes]:
    """Each user's joint angles, velocities and activations as bytes; arrays (N, ...)."""
    rows = np.concatenate([qpos, qvel, act], axis=1).astype("<f8")
    return [row.tobytes() for row in rows]


def user_state(simulation: Any, i: int) -> bytes:
    """Body and app of user i of a Simulation."""
    users = simulation.users
    (body,) = body_states(users.qpos[i, None], users.qvel[i, None], users.act[i, None])
    return body + int(simulation.apps[i].state_hash()).to_bytes(8, "little")


def observation_digest(observation: dict[str, NDArray]) -> str:
    """Of a dictionary of arrays (N, ...)."""
    return digest([np.ascontiguousarray(observation[key]).tobytes() for key in sorted(observation)])
