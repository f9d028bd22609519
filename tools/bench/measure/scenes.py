"""Benchmark scenes: the body alone, drawing apps, whole users, learning."""

from contextlib import closing
from typing import Any

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from measure import scene as shared
from measure.processes import cpu_seconds
from measure.scene import BenchScene, Spec, actions, digest
from measure.turns import Turn
from sim2vr_harness.client import AppClient, DevicePoses, frame_time_ns
from sim2vr_harness.envs.app_group import app_group
from sim2vr_harness.envs.shards import in_this_process, make_simulation
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.training.ppo import ppo
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.loggers import silent_logger
from sim2vr_harness.training.run.trainer import keep_freed_memory
from sim2vr_harness.users.actuation import Actuation


class PhysicsScene(BenchScene):
    """MuJoCo's own Batch: the user's model, its physics steps per user step, random actions.

    The floor below which no environment of such users can come.
    """

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        config = spec.env(transport=shared.IN_PROCESS, renderer="null")
        with closing(Simulation(config, spec.n)) as start:  # draws the start postures
            self._substeps = start.users.substeps
            self._actuation = Actuation(start.body)
            self._batch = Batch(start.body.physics_model, spec.n, spec.threads)
            self._act, self._ctrl = self._batch.bind("act"), self._batch.bind("ctrl")
            self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
            self._qpos[:], self._qvel[:] = start.users.qpos, start.users.qvel
            self._act[:, self._actuation.activations] = start.users.act
            self._motor = start.users.motor
        self._actions = actions(spec.n, self._ctrl.shape[1]).astype(np.float64)
        self._steps = 0
        for _ in range(shared.WARM_UP_STEPS):
            self.step()
        self.state_hash = digest(shared.body_states(self._qpos, self._qvel, self._act))

    def step(self) -> None:
        """See the base class."""
        action = self._actions[self._steps % shared.ACTIONS]
        controls = self._actuation.controls(action, self._act, self._motor)
        self._ctrl[:, self._actuation.actuators] = controls
        self._batch.step(nstep=self._substeps)
        self._steps += 1


class RenderScene(BenchScene):
    """Apps whose player's head and hand circle; a frame per step, with the headset image drawn.

    With ``env.app.renderer=null`` it is the game alone.
    """

    unit = "frames/s"
    _POSES = 64  # different ones, played in a circle

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        config = spec.env()
        self._frequency_hz = config.action_frequency_hz
        self._circle = _circling_poses(self._POSES)
        self._everyone = np.arange(spec.n)
        self._frame, self._over = 0, True
        self._group = app_group(config, spec.n, None)
        self._stack.callback(self._group.close)
        try:
            for _ in range(shared.WARM_UP_STEPS + 1):  # the first one is the reset
                self.step()
            hashes = [_state_hash(app) for app in self._group.apps]
        except BaseException:
            self.close()
            raise
        self.state_hash = digest([value.to_bytes(8, "little") for value in hashes])
        if config.app.renderer != "null":
            self.observation_hash = digest([image.tobytes() for image in self._group.pictures])

    def step(self) -> None:
        """A step of every app, or a reset of all where a round is over."""
        # Every app's player is elsewhere on the circle, so that the pictures differ.
        places = (self._frame + 7 * self._everyone) % self._POSES
        head, hand = self._circle[0][places], self._circle[1][places]
        if self._over:
            self._frame, self._over = 0, False
            requests_deg = self._group.head_requests(self._everyone, self._everyone, None)
            self._looking = _looking_up(np.nan_to_num(requests_deg))
            head[:, 3:] = self._looking
            self._group.reset(self._everyone, self._everyone, DevicePoses(head, hand), None)
            return
        head[:, 3:] = self._looking
        self._frame += 1
        times = np.full((self.n, 1), frame_time_ns(self._frame, self._frequency_hz))
        steps = np.full(self.n, self._frame)
        poses = DevicePoses(head[:, None], hand[:, None])
        answered = self._group.step(self._everyone, times, poses, steps, last=2**31)
        if len(answered) < self.n:
            raise RuntimeError(f"render: {next(iter(self._group.failed.values()))}")
        self._over = bool(self._group.finished.any())


def _state_hash(app: AppClient) -> int:
    """Of an app that cannot say its state, as a page, that of its picture."""
    if "save" in app.capabilities:
        return app.state_hash()
    return int(digest([app.image.tobytes()]), 16)


def _circling_poses(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Head and right hand, (count, 7) each: the hand circles in front of the body."""
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    zero, one = np.zeros(count), np.ones(count)
    rest = [zero, zero, zero, one]
    head = np.stack([0.01 * np.sin(turn), 1.17 * one, zero, *rest], axis=1)
    hand = [0.15 + 0.1 * np.cos(turn), 1.07 + 0.1 * np.sin(turn), 0.35 * one]
    return head, np.stack([*hand, *rest], axis=1)


def _looking_up(pitch_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) rotations x y z w in the app's frame (left-handed, x right) of heads pitched up."""
    half, zero = np.radians(pitch_deg) / 2.0, np.zeros(len(pitch_deg))
    return np.stack([-np.sin(half), zero, zero, np.cos(half)], axis=1)


class EnvScene(BenchScene):
    """Users in their apps as a learner gets them: vector environment, autoreset, observations."""

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        config = spec.env()
        self.env = SimulationVecEnv(make_simulation(config, spec.n))
        self._stack.callback(self.env.close)
        try:
            simulation: Any = self.env.simulation
            self.env.reset()
            simulation.reset(seeds=list(range(spec.n)))
            if short := shared.short_rounds(config, spec.n):
                simulation.reset(ids=short, options={"round_seconds": shared.SHORT_ROUND_SECONDS})
            self._actions = actions(spec.n, self.env.action_space.shape[0])  # type: ignore[index]
            self._steps = 0
            for _ in range(shared.WARM_UP_STEPS):
                self.step()
            with in_this_process(simulation) as near:
                if near is not simulation:
                    near.load_state_dict(simulation.state_dict())
                self.state_hash = digest([shared.user_state(near, i) for i in range(spec.n)])
            self.observation_hash = shared.observation_digest(simulation.observation())
        except BaseException:
            self.close()
            raise

    def step(self) -> None:
        """See the base class."""
        self.env.step(self._actions[self._steps % shared.ACTIONS])
        self._steps += 1


class TrainScene(BenchScene):
    """Training iterations that are short; the update's number of epochs is the configuration's.

    A turn is one whole iteration, however long it takes, and its rate is that of rollout and update
    together. The policies of two runs need not agree to the bit, so there is no hash.
    """

    most_turns = 3

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        small = short_iteration(spec.config, spec.n, spec.train_steps)
        self.steps = small.ppo.steps_per_iteration
        self.batch_size = small.ppo.batch_size
        keep_freed_memory()
        env = SimulationVecEnv(make_simulation(spec.env(), spec.n))
        self._stack.callback(env.close)
        self.model = ppo.build(small, env)
        self.model.set_logger(silent_logger())

    def step(self) -> None:
        """One iteration."""
        self.model.learn(self.steps, reset_num_timesteps=False)

    def measure(self, seconds: float) -> Turn:
        """One iteration, whatever the time given."""
        cpu_began = cpu_seconds()
        self.step()
        cpu_us = 1e6 * (cpu_seconds() - cpu_began) / self.steps
        rollout, update = self.model.last_times
        parts = {
            "rollout_steps_per_s": self.steps / rollout,
            "update_steps_per_s": self.steps / update,
        }
        return Turn(self.steps / (rollout + update), cpu_us, parts)

    def extra(self) -> dict[str, Any]:
        """See the base class."""
        return {
            "train_steps": self.steps,
            "batch_size": self.batch_size,
            "n_epochs": self.model.n_epochs,
        }


def short_iteration(config: TrainingConfig, n: int, train_steps: int) -> TrainingConfig:
    """The configuration with an iteration of at least ``train_steps`` user steps.

    Minibatches are whole and about as large as the configuration's.

    Args:
        config: the training's.
        n: number of users.
        train_steps: user steps of an iteration; at least two per user are taken.
    """
    n_steps = max(2, -(-train_steps // n))
    minibatches = max(1, round(n * n_steps / config.ppo.batch_size))
    n_steps = minibatches * -(-n_steps // minibatches)
    batch_size = n * n_steps // minibatches
    changes = {"n_envs": n, "n_steps": n_steps, "batch_size": batch_size}
    return config.model_copy(update={"ppo": config.ppo.model_copy(update=changes)})


_SCENES: dict[str, type[Any]] = {
    "physics": PhysicsScene,
    "render": RenderScene,
    "env": EnvScene,
    "train": TrainScene,
}


def open_scene(spec: Spec) -> BenchScene:
    """Makes a scene and plays its warm-up.

    Raises:
        ValueError: a setting that cannot be used.
        RuntimeError: an app or its renderer cannot be started.
    """
    scene: BenchScene = _SCENES[spec.scene](spec)
    return scene
