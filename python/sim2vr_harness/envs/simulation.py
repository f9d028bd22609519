"""N simulated users in N apps, in lockstep: the one code path behind every environment."""

from __future__ import annotations

import io
import math
import pickle
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.client import (
    APP_FAILURES,
    AppClient,
    AppDied,
    AppReply,
    DevicePoses,
    OptionValue,
    frame_time_ns,
)
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.apps import AppFactory, app_factory
from sim2vr_harness.envs.config import EnvConfig, NoiseConfig
from sim2vr_harness.perception import HeadsetVision, Proprioception
from sim2vr_harness.users import User, load_user
from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.noise import MotorNoiseSettings

Observation = dict[str, NDArray[Any]]

EFFORT_MODELS = {
    "cumulative_fatigue_3ccr": "CumulativeFatigue3CCr",
    "neural": "Neural",
    "muscle_state": "MuscleState",
    "consumed_endurance": "ConsumedEndurance",
    "zero": "Zero",
}

RESET_ATTEMPTS = 3
"""Apps in a row that may fail before a user's round is given up."""

_STATE_FORMAT = "sim2vr simulation state 1"


@dataclass
class StepBatch:
    """What one user step did to each of N users.

    Attributes:
        reward: (N,) float64, the game's reward minus the effort cost.
        terminated: (N,) bool, the game is over or the simulation diverged.
        truncated: (N,) bool, ``max_episode_seconds`` are over, or the app failed.
        infos: N dictionaries: ``game_reward`` and ``effort_cost`` of the step, ``log`` (the game's
            named numbers), ``condition`` when the game reports one; at the end of an episode also
            ``termination`` (``finished``, ``diverged``, ``max_steps_reached`` or ``app_failed``)
            and ``max_fatigued``; after ``app_failed`` ``app_error``, what happened.
    """

    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    infos: list[dict[str, Any]]


@dataclass(frozen=True)
class AppFailure:
    """An app outside this process that died, hung or talked nonsense.

    Attributes:
        user: whose app it was.
        step: user steps of the round that it ended.
        error: what happened, with the end of the app's log.
    """

    user: int
    step: int
    error: str


class Simulation:
    """N users playing in N apps, without automatic reset.

    One user step: muscle control -> MuJoCo substeps -> device poses at the end of the step -> one
    app frame (collisions, game, reward, image) -> effort subtracted -> observation. With
    ``frames_per_step`` K the app gets the poses of K moments, evenly spread over the step, in one
    exchange, runs a frame for each and draws the last. An episode depends on its seed and actions
    only, not on N, the position in the batch or the threads.

    An app outside this process may fail. Its user's episode ends there (``app_failed``, truncated,
    on the last observation), the others go on, and the user's next reset starts another app.

    Args:
        config: user, app and perception.
        n: number of users N.
        log_dir: root of the apps' episode logs, or None.
        make_app: how to get the app of each user; None goes by ``config.app.transport``.

    Raises:
        ValueError: a setting that cannot be used; names it, what was got and what was expected.
        RuntimeError: the app or its renderer cannot be started.
    """

    def __init__(
        self,
        config: EnvConfig,
        n: int = 1,
        *,
        log_dir: Path | None = None,
        make_app: AppFactory | None = None,
    ) -> None:
        self.config = config
        self.n = n
        self.user: User = load_user(
            config.user.model,
            skull_rotation_wxyz=_pitch_down(config.user.skull_rotation_deg),
            timestep_s=config.user.timestep_s,
        )
        substeps = _substeps(config.action_frequency_hz, self.user.timestep)
        _check_frames(config.frames_per_step, substeps)
        self.users = UserBatch(
            self.user,
            n,
            threads=config.threads,
            effort=EFFORT_MODELS[config.user.effort.model],
            effort_weight=None if config.user.effort.model == "zero" else config.user.effort.weight,
            noise=_noise(config.user.noise),
            substeps=substeps,
        )
        self.vision = HeadsetVision(
            config.vision.channels,
            config.vision.buffer_s,
            n=n,
            step_seconds=1.0 / config.action_frequency_hz,
            height=config.vision.height,
            width=config.vision.width,
        )
        self.proprioception = Proprioception(self.user)
        self.observation_space = spaces.Dict(
            {
                "vision": self.vision.observation_space,
                "proprioception": self.proprioception.observation_space,
                "stateful_information": spaces.Box(-1.0, 1.0, (1,), np.float32),
            }
        )
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.user.muscles),), np.float32)
        self.max_steps = max(1, round(config.max_episode_seconds * config.action_frequency_hz))
        self._log_dir = log_dir
        self._make_app = app_factory(config, n) if make_app is None else make_app
        self.apps: list[AppClient] = []
        self.app_failures: list[AppFailure] = []
        """Every app that failed so far, the oldest first."""
        self._failed: dict[int, str] = {}  # users whose app is to be started anew
        self._options: list[dict[str, OptionValue]] = [{} for _ in range(n)]
        try:
            for i in range(n):
                self.apps.append(self._make_app(config, i, log_dir))
        except BaseException:
            self._close_apps()
            raise
        self._seeds = [np.random.default_rng() for _ in range(n)]
        self._steps = np.zeros(n, dtype=np.int64)
        self._over = np.ones(n, dtype=bool)
        self._time_feature = np.zeros(n, dtype=np.float32)
        self._images = np.zeros((n, config.vision.height, config.vision.width, 4), dtype=np.uint8)
        self._seen = np.zeros((n, *self.vision.observation_space.shape), dtype=np.uint8)
        self._proprioception = np.zeros((n, self.proprioception.size), dtype=np.float32)
        self._closed = False

    @property
    def renderer_description(self) -> str:
        """The GL renderer that draws the headset images."""
        return self.apps[0].renderer_description

    # --- episodes ----------------------------------------------------------------------------

    def reset(
        self,
        ids: Sequence[int] | None = None,
        seeds: Sequence[int | None] | None = None,
        options: Mapping[str, OptionValue] | None = None,
        postures: Sequence[NDArray[np.float64] | None] | None = None,
    ) -> list[dict[str, Any]]:
        """Starts new episodes.

        Args:
            ids: (K,) users to reset; None for all.
            seeds: K seeds; a seed restarts that user's stream of episodes, None goes on with it
                (a user never seeded starts from entropy).
            options: game options for these users from this round on.
            postures: K postures to start in (see `UserBatch.reset`); None draws all of them.

        Returns:
            K info dictionaries with ``seed`` (of the app's round) and ``log``.

        Raises:
            ValueError: an option or seed that cannot be used.
            RuntimeError: the simulation is closed.
        """
        self._require_open()
        rows = list(range(self.n)) if ids is None else [int(i) for i in ids]
        given = [None] * len(rows) if seeds is None else list(seeds)
        if len(given) != len(rows):
            raise ValueError(f"seeds: got {len(given)} seeds, expected {len(rows)}, one per user")
        for i, seed in zip(rows, given, strict=True):
            if seed is not None:
                if seed < 0:
                    raise ValueError(f"seed: got {seed}, expected an integer of 0 or above")
                self._seeds[i] = np.random.default_rng(seed)
        round_seeds = [int(self._seeds[i].integers(2**32)) for i in rows]
        self.users.reset(rows, [self._seeds[i] for i in rows], postures)
        poses = self._device_poses()
        infos = []
        for i, round_seed in zip(rows, round_seeds, strict=True):
            reply = self._reset_app(i, round_seed, poses[i], options)
            self._take_reply(i, reply)
            infos.append({"seed": round_seed, "log": reply.log})
        self._steps[rows] = 0
        self._over[rows] = False
        self.vision.reset(rows)
        self._perceive(rows)
        return infos

    def observation(self) -> Observation:
        """The present observation of all users: fresh arrays, first axis N.

        ``vision`` (N, C, H, W) uint8, ``proprioception`` (N, 56) float32, ``stateful_information``
        (N, 1) float32 (the game's time feature).
        """
        return {
            "vision": self._seen.copy(),
            "proprioception": self._proprioception.copy(),
            "stateful_information": self._time_feature[:, None].copy(),
        }

    def step(self, actions: ArrayLike) -> StepBatch:
        """Advances every user and app by one user step.

        Args:
            actions: (N, M) changes of muscle activation in [-1, 1].

        Raises:
            ValueError: actions of another shape or not finite.
            RuntimeError: a user's episode is over (reset it first), or the simulation is closed.
        """
        self._require_open()
        if self._over.any():
            over = np.flatnonzero(self._over).tolist()
            raise RuntimeError(f"step: the episodes of users {over} are over; reset them first")
        self.users.step(actions, pose_samples=self.config.frames_per_step)
        diverged = self.users.diverged
        cost = np.where(diverged, 0.0, self.users.effort_cost)
        self._steps += 1
        # A diverged user's app stays where it was, as does its last finite observation.
        playing = [int(i) for i in np.flatnonzero(~diverged)]
        replies = self._step_apps(playing, self._step_poses())
        reward = np.zeros(self.n)
        terminated = diverged.copy()
        infos: list[dict[str, Any]] = []
        for i in range(self.n):
            reply = replies.get(i)
            game_reward = 0.0 if reply is None else reply.reward
            reward[i] = game_reward - cost[i]
            info: dict[str, Any] = {"game_reward": game_reward, "effort_cost": float(cost[i])}
            if reply is not None:
                self._take_reply(i, reply)
                terminated[i] = reply.finished
                info["log"] = reply.log
            infos.append(info)
        failed = np.array([i in self._failed for i in range(self.n)])
        truncated = ~terminated & ((self._steps >= self.max_steps) | failed)
        self._describe_ends(infos, terminated, truncated, diverged)
        self._over = terminated | truncated
        self._perceive(list(replies))
        return StepBatch(reward, terminated, truncated, infos)

    def _describe_ends(
        self,
        infos: list[dict[str, Any]],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
    ) -> None:
        fatigued = self.users.effort.max_fatigued()
        for i in map(int, np.flatnonzero(terminated | truncated)):
            end = "diverged" if diverged[i] else "finished"
            infos[i]["termination"] = end if terminated[i] else "max_steps_reached"
            infos[i]["max_fatigued"] = float(fatigued[i])
            if i in self._failed:
                infos[i] |= {"termination": "app_failed", "app_error": self._failed[i]}

    # --- apps, which may fail when they run outside this process --------------------------------

    def _step_apps(self, users: Sequence[int], poses: list[DevicePoses]) -> dict[int, AppReply]:
        """The step's frames in the apps of ``users``, side by side; without apps that failed."""
        replies: dict[int, AppReply] = {}
        for i in users:
            if i in self._failed:  # found out while the state was saved
                continue
            with self._noting_failure(i):
                last = bool(self._steps[i] >= self.max_steps)
                self.apps[i].start_step(self._times_ns(i), poses[i], last=last)
        for i in users:
            if i in self._failed:
                continue
            with self._noting_failure(i):
                replies[i] = self.apps[i].finish_step()
        return replies

    def _reset_app(
        self,
        i: int,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> AppReply:
        """Starts a round, in a new app where the one before has failed."""
        for _ in range(RESET_ATTEMPTS):
            with self._noting_failure(i):
                chosen = options
                if i in self._failed:
                    self.apps[i] = self._make_app(self.config, i, self._log_dir)
                    del self._failed[i]
                    chosen = {**self._options[i], **(options or {})}
                reply = self.apps[i].reset(seed, poses, chosen)
                self._options[i] |= options or {}
                return reply
        raise AppDied(
            f"user {i}: {RESET_ATTEMPTS} apps in a row failed at the start of a round; the last "
            f"one: {self._failed[i]}"
        )

    @contextmanager
    def _noting_failure(self, i: int) -> Iterator[None]:
        """Ends the app of user ``i``, and remembers why, when the block finds it failed."""
        try:
            yield
        except APP_FAILURES as error:
            self._failed[i] = str(error)
            self.app_failures.append(AppFailure(i, int(self._steps[i]), str(error)))
            self.apps[i].close()

    def _times_ns(self, i: int) -> NDArray[np.int64]:
        # From the step count, so that rounding never accumulates.
        frames = self.config.frames_per_step
        first = (int(self._steps[i]) - 1) * frames + 1
        rate_hz = self.config.action_frequency_hz * frames
        return np.array([frame_time_ns(first + k, rate_hz) for k in range(frames)], dtype=np.int64)

    def _device_poses(self) -> list[DevicePoses]:
        """Where every user's devices are now, arrays of 7."""
        head = pose_to_app(*self.users.device_poses("headset"))
        right = pose_to_app(*self.users.device_poses("controller_right"))
        return [DevicePoses(head[i], right[i]) for i in range(self.n)]

    def _step_poses(self) -> list[DevicePoses]:
        """Where every user's devices were in the K frames of the last step, arrays (K, 7)."""
        head, right = (
            np.stack(
                [
                    pose_to_app(*self.users.device_poses(name, k))
                    for k in range(self.config.frames_per_step)
                ],
                axis=1,
            )
            for name in ("headset", "controller_right")
        )
        return [DevicePoses(head[i], right[i]) for i in range(self.n)]

    def _take_reply(self, i: int, reply: AppReply) -> None:
        self._images[i] = self.apps[i].image
        self._time_feature[i] = min(1.0, max(-1.0, reply.time_feature))

    def _perceive(self, ids: Sequence[int] | NDArray[np.int64]) -> None:
        rows = np.asarray(ids, dtype=np.int64)
        if len(rows) == 0:
            return
        self._seen[rows] = self.vision.observe(self._images[rows], rows)
        self._proprioception[rows] = self.proprioception.observe(self.users)[rows]

    # --- saved states ------------------------------------------------------------------------

    def save_state(self) -> bytes:
        """Everything the future depends on, mid-episode included: random streams, bodies, apps.

        Raises:
            RuntimeError: some user was never reset, or the simulation is closed.
        """
        self._require_open()
        state = {
            "format": _STATE_FORMAT,
            "n": self.n,
            "seeds": [generator.bit_generator.state for generator in self._seeds],
            "users": [self.users.get_state(i) for i in range(self.n)],
            "vision": [self.vision.get_state(i) for i in range(self.n)],
            "apps": [self._app_state(i) for i in range(self.n)],
            "arrays": {name: getattr(self, name).copy() for name in self._STATE_ARRAYS},
        }
        return pickle.dumps(state)

    @property
    def exact_states(self) -> bool:
        """Whether :meth:`save_state` holds the rounds; SIM2VR apps of others cannot save theirs."""
        return all(app.can_save for app in self.apps)

    def _app_state(self, i: int) -> bytes | None:
        """What the app saves; None if it cannot, or has failed."""
        if i in self._failed or not self.apps[i].can_save:
            return None
        state: bytes | None = None
        with self._noting_failure(i):
            state = self.apps[i].save()
        return state

    def load_state(self, state: bytes) -> list[int]:
        """Goes on from :meth:`save_state` of a simulation with the same configuration and N.

        Returns:
            The users whose apps could not save their rounds; they have started new ones.

        Raises:
            ValueError: the bytes are of something else or of another number of users.
            RuntimeError: an app refuses its part, or the simulation is closed.
        """
        self._require_open()
        saved = _PlainUnpickler(io.BytesIO(state)).load()
        if not isinstance(saved, dict) or saved.get("format") != _STATE_FORMAT:
            raise ValueError(f"state: got other bytes, expected a '{_STATE_FORMAT}'")
        if saved["n"] != self.n:
            raise ValueError(f"state: got one of {saved['n']} users, expected {self.n}")
        for i in range(self.n):
            self._seeds[i].bit_generator.state = saved["seeds"][i]
            self.users.set_state(i, saved["users"][i])
            self.vision.set_state(i, saved["vision"][i])
            if saved["apps"][i] is not None:
                self.apps[i].load(saved["apps"][i])
        for name in self._STATE_ARRAYS:
            getattr(self, name)[...] = saved["arrays"][name]
        anew = [i for i in range(self.n) if saved["apps"][i] is None]
        if anew:
            self.reset(ids=anew)
        return anew

    _STATE_ARRAYS = ("_steps", "_over", "_time_feature", "_images", "_seen", "_proprioception")

    def close(self) -> None:
        """Ends the apps; idempotent. Later calls raise RuntimeError."""
        self._closed = True
        self._close_apps()

    def _close_apps(self) -> None:
        with ExitStack() as stack:  # each one, whatever happens to the others
            for app in self.apps:
                stack.callback(app.close)

    def _require_open(self) -> None:
        if self._closed:
            raise RuntimeError("the simulation is closed; make a new one")


class _PlainUnpickler(pickle.Unpickler):
    """Reads arrays and plain values only, so that a state file cannot run code."""

    _ALLOWED = frozenset(
        {
            ("numpy", "ndarray"),
            ("numpy", "dtype"),
            ("numpy._core.multiarray", "_reconstruct"),
            ("numpy._core.multiarray", "scalar"),
            ("numpy._core.numeric", "_frombuffer"),
        }
    )

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self._ALLOWED:
            raise ValueError(f"state: got an object of type {module}.{name}, expected plain data")
        return super().find_class(module, name)


def _pitch_down(degrees: float) -> tuple[float, float, float, float] | None:
    """Rotation of the skull (thorax frame: y up, x forward, z right) that looks down."""
    if degrees == 0.0:
        return None
    half = math.radians(degrees) / 2.0
    return (math.cos(half), 0.0, 0.0, -math.sin(half))


def _noise(config: NoiseConfig) -> MotorNoiseSettings | None:
    if config.signal_dependent is None and config.constant is None:
        return None
    return MotorNoiseSettings(signal_dependent=config.signal_dependent, constant=config.constant)


def _substeps(action_frequency_hz: int, timestep_s: float) -> int:
    exact = 1.0 / (action_frequency_hz * timestep_s)
    substeps = round(exact)
    if substeps < 1 or abs(exact - substeps) > 1e-9:
        raise ValueError(
            f"action_frequency_hz: got {action_frequency_hz}, expected a divisor of "
            f"{round(1.0 / timestep_s)} (one physics step is {timestep_s} s)"
        )
    return substeps


def _check_frames(frames_per_step: int, substeps: int) -> None:
    if frames_per_step < 1 or substeps % frames_per_step:
        divisors = [str(k) for k in range(1, substeps + 1) if substeps % k == 0]
        raise ValueError(
            f"frames_per_step: got {frames_per_step}, expected {', '.join(divisors)} (a divisor of "
            f"the {substeps} physics steps of a user step)"
        )
