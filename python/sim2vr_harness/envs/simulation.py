"""N simulated users in N apps, in lockstep: the one code path behind every environment."""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.client import AppClient, DevicePoses, OptionValue, frame_times_ns
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.app_group import AppFailure, Logs, app_group
from sim2vr_harness.envs.apps import AppFactory
from sim2vr_harness.envs.config import EnvConfig, NoiseConfig, body_of
from sim2vr_harness.perception import HeadsetVision, Proprioception
from sim2vr_harness.users import Body
from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.bodies import DEVICES
from sim2vr_harness.users.noise import MotorNoiseSettings

Observation = dict[str, NDArray[Any]]

_STATE_FORMAT = "sim2vr simulation state 3"


@dataclass
class StepBatch:
    """What one user step did to each of N users.

    Attributes:
        reward: (N,) float64, the game's reward minus the effort cost.
        terminated: (N,) bool, the game is over or the simulation diverged.
        truncated: (N,) bool, ``max_episode_seconds`` are over, or the app failed.
        game_reward: (N,) float64, 0 where the app was not asked or did not answer.
        effort_cost: (N,) float64.
        answered: (N,) bool, whose app played the step: not that of a user whose simulation
            diverged, nor one that failed.
        logs: the games' named numbers, ``logs[i]`` of user i.
        ends: users whose episode ended here -> ``termination`` (``finished``, ``diverged``,
            ``max_steps_reached`` or ``app_failed``) and ``max_fatigued``; after ``app_failed`` also
            ``app_error``, what happened; where MuJoCo warned in the episode, ``warnings``, how
            often by kind (see :attr:`UserBatch.warnings`).
    """

    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    game_reward: NDArray[np.float64]
    effort_cost: NDArray[np.float64]
    answered: NDArray[np.bool_]
    logs: Logs
    ends: dict[int, dict[str, Any]] = field(default_factory=dict)

    def info(self, i: int) -> dict[str, Any]:
        """User i's part of the step as a dictionary.

        Returns:
            ``game_reward``, ``effort_cost``, ``log`` if the app answered, and the user's entries of
            :attr:`ends`.
        """
        info: dict[str, Any] = {
            "game_reward": float(self.game_reward[i]),
            "effort_cost": float(self.effort_cost[i]),
        }
        if self.answered[i]:
            info["log"] = self.logs[i]
        return info | self.ends.get(i, {})

    @cached_property
    def infos(self) -> list[dict[str, Any]]:
        """:meth:`info` of all users; made when first asked for."""
        return [self.info(i) for i in range(len(self.reward))]


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
        self.body: Body = body_of(config.user)
        substeps = _substeps(config.action_frequency_hz, self.body.timestep)
        _check_frames(config.frames_per_step, substeps)
        self.users = UserBatch(
            self.body,
            n,
            threads=config.threads,
            effort=config.user.effort.model,
            effort_params=config.user.effort.options(),
            noise=_noise(config.user.noise),
            substeps=substeps,
        )
        self.vision = _vision(config, n)
        self.proprioception = Proprioception(self.body)
        self.observation_space = _observation_space(self.vision, self.proprioception)
        self.action_space = spaces.Box(-1.0, 1.0, (self.body.action_size,), np.float32)
        self.max_steps = max(1, round(config.max_episode_seconds * config.action_frequency_hz))
        self._group = app_group(config, n, self.vision, log_dir, make_app)
        self._seeds = [np.random.default_rng() for _ in range(n)]
        self._steps = np.zeros(n, dtype=np.int64)
        self._over = np.ones(n, dtype=bool)
        self._time_feature = np.zeros(n, dtype=np.float32)
        self._proprioception = np.zeros((n, self.proprioception.size), dtype=np.float32)
        self._closed = False

    @property
    def apps(self) -> list[AppClient]:
        """The app of each user."""
        return self._group.apps

    @property
    def app_failures(self) -> list[AppFailure]:
        """Every app that failed so far, the oldest first."""
        return self._group.failures

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
        if not rows:
            return []
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
        users = np.array(rows, dtype=np.int64)
        poses = self._poses(users, -1)
        self._group.reset(users, np.array(round_seeds, dtype=np.int64), poses, options)
        self._steps[users] = 0
        self._over[users] = False
        self.vision.reset(users)
        self._perceive(users)
        logs = self._group.logs()
        return [{"seed": seed, "log": logs[i]} for i, seed in zip(rows, round_seeds, strict=True)]

    @property
    def logs(self) -> Logs:
        """The games' named numbers now."""
        return self._group.logs()

    def observation(self) -> Observation:
        """The present observation of all users: fresh arrays, first axis N.

        ``vision`` (N, C, H, W) uint8, ``proprioception`` (N, P) float32, ``stateful_information``
        (N, 1) float32 (the game's time feature).
        """
        return {
            "vision": self.vision.seen(),
            "proprioception": self._proprioception.copy(),
            "stateful_information": self._time_feature[:, None].copy(),
        }

    def step(self, actions: ArrayLike) -> StepBatch:
        """Advances every user and app by one user step.

        Args:
            actions: (N, A) in [-1, 1]: of muscles, changes of activation.

        Raises:
            ValueError: actions of another shape or not finite.
            RuntimeError: a user's episode is over (reset it first), or the simulation is closed.
        """
        self._require_open()
        if self._over.any():
            over = np.flatnonzero(self._over).tolist()
            raise RuntimeError(f"step: the episodes of users {over} are over; reset them first")
        frames = self.config.frames_per_step
        self.users.step(actions, pose_samples=frames)
        diverged = self.users.diverged
        cost = np.where(diverged, 0.0, self.users.effort_cost)
        self._steps += 1
        # A diverged user's app stays where it was, as does its last finite observation.
        playing = np.flatnonzero(~diverged)
        steps = self._steps[playing]
        # From the step count, so that rounding never accumulates.
        numbers = ((steps - 1) * frames + 1)[:, None] + np.arange(frames)
        times_ns = frame_times_ns(numbers, self.config.action_frequency_hz * frames)
        poses = self._step_poses(playing)
        users = self._group.step(playing, times_ns, poses, steps, self.max_steps)
        answered = np.zeros(self.n, dtype=bool)
        answered[users] = True
        game_reward = np.where(answered, self._group.reward, 0.0).astype(np.float64)
        terminated = diverged | (answered & (self._group.finished != 0))
        failed = np.zeros(self.n, dtype=bool)
        failed[list(self._group.failed)] = True
        truncated = ~terminated & ((self._steps >= self.max_steps) | failed)
        self._over = terminated | truncated
        self._perceive(users)
        return StepBatch(
            game_reward - cost,
            terminated,
            truncated,
            game_reward,
            cost,
            answered,
            self._group.logs(),
            self._ends(terminated, diverged),
        )

    def _ends(
        self, terminated: NDArray[np.bool_], diverged: NDArray[np.bool_]
    ) -> dict[int, dict[str, Any]]:
        ends: dict[int, dict[str, Any]] = {}
        if not self._over.any():
            return ends
        fatigued = self.users.effort.max_fatigued()
        warnings = {name: counts for name, counts in self.users.warnings.items() if counts.any()}
        for i in np.flatnonzero(self._over).tolist():
            end = "diverged" if diverged[i] else "finished"
            ends[i] = {
                "termination": end if terminated[i] else "max_steps_reached",
                "max_fatigued": float(fatigued[i]),
            }
            warned = {name: int(counts[i]) for name, counts in warnings.items() if counts[i]}
            if warned:
                ends[i]["warnings"] = warned
            if i in self._group.failed:
                ends[i] |= {"termination": "app_failed", "app_error": self._group.failed[i]}
        return ends

    def _poses(self, ids: NDArray[np.int64], sample: int) -> DevicePoses:
        """Where these users' devices are, (K, 7); see :meth:`UserBatch.device_poses`."""
        head, right, left = (
            pose_to_app(*(part[ids] for part in self.users.device_poses(name, sample)))
            if name in self.body.devices
            else None
            for name in DEVICES
        )
        assert head is not None  # every body wears a headset
        return DevicePoses(head, right, left)

    def _step_poses(self, ids: NDArray[np.int64]) -> DevicePoses:
        """Where these users' devices were in the F frames of the last step, (K, F, 7)."""
        frames = [self._poses(ids, k) for k in range(self.config.frames_per_step)]
        head, right, left = (
            None if parts[0] is None else np.stack(parts, axis=1)
            for parts in zip(
                *((p.head, p.right_controller, p.left_controller) for p in frames), strict=True
            )
        )
        assert head is not None
        return DevicePoses(head, right, left)

    def _perceive(self, ids: NDArray[np.int64]) -> None:
        """Takes in what the apps of these users have shown."""
        if len(ids) == 0:
            return
        if len(ids) == self.n:
            self.vision.take(self._group.pictures)
        else:
            self.vision.take(self._group.pictures[ids], ids)
        self._proprioception[ids] = self.proprioception.observe(self.users)[ids]
        self._time_feature[ids] = np.clip(self._group.time_feature[ids], -1.0, 1.0)

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
            "apps": [self._group.save(i, int(self._steps[i])) for i in range(self.n)],
            "arrays": {name: getattr(self, name).copy() for name in self._STATE_ARRAYS},
        }
        return pickle.dumps(state)

    @property
    def exact_states(self) -> bool:
        """Whether :meth:`save_state` holds the rounds; SIM2VR apps of others cannot save theirs."""
        return all("save" in app.capabilities for app in self.apps)

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

    _STATE_ARRAYS = ("_steps", "_over", "_time_feature", "_proprioception")

    def close(self) -> None:
        """Ends the apps; idempotent. Later calls raise RuntimeError."""
        self._closed = True
        self._group.close()

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


def observation_space_of(config: EnvConfig) -> spaces.Dict:
    """What the users of a simulation with this configuration would observe."""
    return _observation_space(_vision(config, 1), Proprioception(body_of(config.user)))


def _vision(config: EnvConfig, n: int) -> HeadsetVision:
    return HeadsetVision(
        config.vision.channels,
        config.vision.buffer_s,
        n=n,
        step_seconds=1.0 / config.action_frequency_hz,
        height=config.vision.height,
        width=config.vision.width,
    )


def _observation_space(vision: HeadsetVision, proprioception: Proprioception) -> spaces.Dict:
    return spaces.Dict(
        {
            "vision": vision.observation_space,
            "proprioception": proprioception.observation_space,
            "stateful_information": spaces.Box(-1.0, 1.0, (1,), np.float32),
        }
    )


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
