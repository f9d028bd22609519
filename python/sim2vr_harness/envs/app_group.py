"""The apps of N users, stepped by one call: in this process as arrays, elsewhere in parallel."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import (
    APP_FAILURES,
    AppClient,
    AppDied,
    AppReply,
    DevicePoses,
    HapticPulse,
    OptionValue,
    SoundEvent,
    transport_named,
)
from sim2vr_harness.client.devices import Hand
from sim2vr_harness.client.in_process import LogRows
from sim2vr_harness.envs.apps import IPD_M, AppFactory, app_factory, apps_wanted, judged
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.perception import channel_indices, pick_channels

RESET_ATTEMPTS = 3
"""Apps in a row that may fail before a user's round is given up."""

IntArray = NDArray[np.int64]
T = TypeVar("T")


@dataclass(frozen=True)
class AppFailure:
    """Failure of an app outside this process: it died, hung or sent invalid data.

    Attributes:
        user: the user of the app.
        step: user steps of the round that it ended.
        error: description of the failure, with the end of the app's log.
    """

    user: int
    step: int
    error: str


class AppGroup(Protocol):
    """N apps. A call moves those of some users and writes their rows of the results."""

    failed: dict[int, str]
    """Users whose app has failed, with the reason; their next reset starts another app."""
    left: dict[int, str]
    """Users whose app has left VR by itself, which ended their round, with the way it did."""
    failures: list[AppFailure]
    """Every app that failed so far, the oldest first."""
    drawn_by_gpu: bool
    """True if a GPU draws inside this process: it draws while the bodies of other users move."""
    reward: NDArray[Any]
    """(N,) of the last step or reset."""
    finished: NDArray[np.uint8]
    """(N,) 1 where the game says that the round is over."""
    time_feature: NDArray[np.float32]
    """(N,) where in the round the game is, as it says itself."""
    gaze: NDArray[np.float32]
    """(N, 2) middles of the pictures around the gaze, right and up, m at a depth of 1 m; the
    caller's to write before each call."""
    fovea: NDArray[np.uint8]
    """(N, h, w, 4) these pictures, RGBA; none without ``vision.fovea``."""
    fovea_depth: NDArray[np.float32]
    """(N, h, w) their depths, m."""
    pictures: NDArray[np.uint8]
    """(N, C, H, W) the channels of the headset images that the users see; with two eyes the left
    one's first. None where the user has no sight."""

    @property
    def apps(self) -> list[AppClient]:
        """One for each user."""

    @property
    def haptics(self) -> Mapping[int, tuple[HapticPulse, ...]]:
        """Haptic pulses of the last step or reset, for the users that received any."""

    @property
    def sounds(self) -> Mapping[int, tuple[SoundEvent, ...]]:
        """Sounds that began in it."""

    def head_requests(
        self, ids: IntArray, seeds: IntArray, options: Mapping[str, OptionValue] | None
    ) -> NDArray[np.float64]:
        """Return the head pitch that the apps request for the next episodes.

        Args:
            ids: (M,) users.
            seeds: (M,) of the episodes that :meth:`reset` will start.
            options: game options of these episodes.

        Returns:
            (M,) pitch in degrees, up positive; NaN: no request.

        Raises:
            ValueError: an option that cannot be used.
        """

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        """Start rounds.

        Args:
            ids: (M,) users.
            seeds: (M,) 32-bit seeds.
            poses: (M, 7) each.
            options: game options of these users from this round on.

        Raises:
            ValueError: an option that cannot be used.
            AppDied: one app after the other failed.
        """

    def step(
        self,
        ids: IntArray,
        times_ns: IntArray,
        poses: DevicePoses,
        steps: IntArray,
        last: int,
        *,
        drawn: int | IntArray = -1,
    ) -> IntArray:
        """Advance the apps by one user step of K frames.

        Args:
            ids: (M,) users.
            times_ns: (M, K) game times.
            poses: (M, K, 7) each.
            steps: (M,) number of this user step in the round.
            last: number of the step after which the user ends the round.
            drawn: index of the drawn frame of the K, -1 the last; (M,) if users differ.

        Returns:
            The users whose apps answered, in the order of ``ids``.
        """

    def logs(self) -> LogRows:
        """Return copies of the present logs, which later steps do not change."""

    def save(self, i: int, step: int) -> bytes | None:
        """Return the state of user ``i``'s app; None if it cannot be saved, or has failed."""

    def close(self) -> None:
        """End the apps; idempotent."""


def app_group(
    config: EnvConfig,
    n: int,
    log_dir: Path | None,
    make_app: AppFactory | None = None,
    ipd_m: float = IPD_M,
) -> AppGroup:
    """Return the apps of ``config.app``.

    Args:
        log_dir: root of the apps' episode logs, or None.
        make_app: makes the app of each user; None: by ``config.app.transport``.
        ipd_m: distance of the users' pupils.

    Raises:
        ValueError: a setting that cannot be used.
        RuntimeError: an app or its renderer cannot be started.
    """
    batch = transport_named(config.app.transport).batch
    if make_app is None and batch is not None and not judged(config.app):
        return batch(apps_wanted(config, n, ipd_m), log_dir, _channels(config))
    make = app_factory(config, n, ipd_m) if make_app is None else make_app
    return ClientGroup(make, config, n, log_dir)


def _channels(config: EnvConfig) -> list[int]:
    """Return the image channels of a user; none without vision."""
    sees = any(config.sense(name) is not None for name in ("vision", "fovea"))
    return channel_indices(config.vision.channels) if sees else []


class ClientGroup:
    """Apps that are clients each, most of them outside this process, where they may fail.

    A step is sent to all of them before the first answer is waited for.

    Args:
        make_app: of each user.
        log_dir: root of the apps' episode logs, or None.
    """

    def __init__(
        self,
        make_app: AppFactory,
        config: EnvConfig,
        n: int,
        log_dir: Path | None,
    ) -> None:
        self.apps: list[AppClient] = []
        self.failed: dict[int, str] = {}
        self.left: dict[int, str] = {}
        self.failures: list[AppFailure] = []
        self.drawn_by_gpu = False
        self._config, self._log_dir, self._channels = config, log_dir, _channels(config)
        self._make_app = make_app
        self._options: list[dict[str, OptionValue]] = [{} for _ in range(n)]
        try:
            for i in range(n):
                self.apps.append(make_app(config, i, log_dir))
        except BaseException:
            self.close()
            raise
        self.reward: NDArray[Any] = np.zeros(n)
        self.finished = np.zeros(n, dtype=np.uint8)
        self.time_feature = np.zeros(n, dtype=np.float32)
        vision = config.vision
        channels = vision.eyes * len(self._channels)
        self.pictures = np.zeros((n, channels, vision.height, vision.width), np.uint8)
        eye = vision.fovea
        size = (0, 0) if eye is None else (eye.height, eye.width)
        self.gaze = np.zeros((n, 2), np.float32)
        self.fovea = np.zeros((n, *size, 4), np.uint8)
        self.fovea_depth = np.zeros((n, *size), np.float32)
        self.haptics: dict[int, tuple[HapticPulse, ...]] = {}
        self.sounds: dict[int, tuple[SoundEvent, ...]] = {}
        self._logs: list[Mapping[str, float]] = [{} for _ in range(n)]

    def head_requests(
        self, ids: IntArray, seeds: IntArray, options: Mapping[str, OptionValue] | None
    ) -> NDArray[np.float64]:
        """Return the requested head pitches; NaN for apps that do not support the request."""
        requests = [
            self._at_a_start(i, partial(_head_request, seed=int(seed)), options)
            for i, seed in zip(ids.tolist(), seeds, strict=True)
        ]
        return np.array([math.nan if pitch is None else pitch for pitch in requests])

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        for k, i in enumerate(ids.tolist()):
            start = partial(_reset, seed=int(seeds[k]), poses=poses[k])
            self._take(i, self._at_a_start(i, start, options))
            self._options[i] |= options or {}

    def _at_a_start(
        self, i: int, ask: Callable[..., T], options: Mapping[str, OptionValue] | None
    ) -> T:
        """Return the app's answer at the start of an episode; a failed app is replaced first.

        Args:
            i: user.
            ask: (app, options) -> answer.
            options: game options from this episode on; a new app also receives the earlier ones.
        """
        for _ in range(RESET_ATTEMPTS):
            with self._noting_failure(i, 0):
                if i in self.failed:
                    self.apps[i] = self._make_app(self._config, i, self._log_dir)
                    del self.failed[i]
                self.apps[i].gaze = self.gaze[i]
                return ask(self.apps[i], {**self._options[i], **(options or {})})
        raise AppDied(
            f"user {i}: {RESET_ATTEMPTS} apps in a row failed at the start of a round; the last "
            f"one: {self.failed[i]}"
        )

    def step(
        self,
        ids: IntArray,
        times_ns: IntArray,
        poses: DevicePoses,
        steps: IntArray,
        last: int,
        *,
        drawn: int | IntArray = -1,
    ) -> IntArray:
        users, frames = ids.tolist(), np.broadcast_to(drawn, len(ids)).tolist()
        for k, i in enumerate(users):
            if i in self.failed:  # found out while the state was saved
                continue
            with self._noting_failure(i, int(steps[k])):
                ending = bool(steps[k] >= last)
                self.apps[i].gaze = self.gaze[i]
                self.apps[i].start_step(times_ns[k], poses[k], last=ending, drawn=frames[k])
        answered = []
        for k, i in enumerate(users):
            if i in self.failed:
                continue
            with self._noting_failure(i, int(steps[k])):
                self._take(i, self.apps[i].finish_step())
                answered.append(i)
        return np.array(answered, dtype=np.int64)

    def _take(self, i: int, reply: AppReply) -> None:
        self.reward[i], self.finished[i] = reply.reward, reply.finished
        self.time_feature[i] = reply.time_feature
        if self._channels:
            self.pictures[i] = pick_channels(self.apps[i].image, self._channels)
        if self.fovea.size:
            self.fovea[i], self.fovea_depth[i] = self.apps[i].fovea
        self._logs[i] = reply.log
        left = (self.left, reply.left)
        for events, new in (left, (self.haptics, reply.haptics), (self.sounds, reply.sounds)):
            events.pop(i, None)
            if new:
                events[i] = new  # type: ignore[assignment]

    @contextmanager
    def _noting_failure(self, i: int, step: int) -> Iterator[None]:
        """End the app of user ``i``, and store the reason, if the block finds it failed."""
        try:
            yield
        except APP_FAILURES as error:
            self.failed[i] = str(error)
            self.failures.append(AppFailure(i, step, str(error)))
            self.apps[i].close()

    def logs(self) -> LogRows:
        return LogRows.of(self._logs)

    def save(self, i: int, step: int) -> bytes | None:
        if i in self.failed or "save" not in self.apps[i].capabilities:
            return None
        state: bytes | None = None
        with self._noting_failure(i, step):
            state = self.apps[i].save()
        return state

    def close(self) -> None:
        with ExitStack() as stack:  # each one, whatever happens to the others
            for app in self.apps:
                stack.callback(app.close)


def _reset(
    app: AppClient, options: Mapping[str, OptionValue], *, seed: int, poses: DevicePoses
) -> AppReply:
    return app.reset(seed, poses, options)


def _head_request(app: AppClient, options: Mapping[str, OptionValue], *, seed: int) -> float | None:
    if "head_request" not in app.capabilities:
        return None
    return app.head_request(seed, options)


# --- apps for both hands --------------------------------------------------------------------------

_OTHER: dict[str, Hand] = {"left": "right", "right": "left"}
_POSE = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
"""Signs of x right, y up, z forward, and of x y z w: a rotation's axis is a pseudovector."""


class MirroredGroup:
    """Apps of users of which some are mirror images; see :class:`~.app_group.AppGroup`.

    Args:
        option: the game's option for the hand that plays.
        hand: with which the users' body plays.
        eyes: 1 or 2.
    """

    def __init__(self, group: AppGroup, n: int, option: str, hand: str, eyes: int) -> None:
        self.drawn_by_gpu = False  # one hand's users play after the other's
        self._group, self._option, self._hand, self._eyes = group, option, hand, eyes
        self._mirrored = np.zeros(n, dtype=bool)
        self.pictures: NDArray[np.uint8] = group.pictures.copy()
        # Lists, dictionaries and arrays that the group changes in place.
        self.apps, self.failed, self.failures = group.apps, group.failed, group.failures
        self.left, self.gaze = group.left, group.gaze
        self.fovea, self.fovea_depth = group.fovea, group.fovea_depth
        self.reward, self.finished = group.reward, group.finished
        self.time_feature = group.time_feature
        self._haptics: dict[int, tuple[HapticPulse, ...]] = {}
        self._sounds: dict[int, tuple[SoundEvent, ...]] = {}

    def resume(self, mirrored: NDArray[np.bool_]) -> None:
        """Continue rounds of loaded apps; (N,) True if the user is a mirror image."""
        self._mirrored[:] = mirrored
        self._begin()
        for rows, _ in self._parts(np.arange(len(mirrored)), None):
            self._take(rows)

    def mirror(self, ids: IntArray, mirrored: NDArray[np.bool_]) -> None:
        """Set which of these users are mirror images, from the next reset on; (M,) each."""
        self._mirrored[ids] = mirrored

    @property
    def haptics(self) -> Mapping[int, tuple[HapticPulse, ...]]:
        return self._haptics

    @property
    def sounds(self) -> Mapping[int, tuple[SoundEvent, ...]]:
        return self._sounds

    def head_requests(
        self, ids: IntArray, seeds: IntArray, options: Mapping[str, OptionValue] | None
    ) -> NDArray[np.float64]:
        """(M,) pitch in degrees, which is the same in a mirror."""
        return self._group.head_requests(ids, seeds, options)

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        """Start rounds, each for the hand that its user plays with."""
        self._begin()
        for rows, own in self._parts(ids, options):
            self._group.reset(ids[rows], seeds[rows], self._seen(poses, ids, rows), own)
            self._take(ids[rows])

    def step(
        self,
        ids: IntArray,
        times_ns: IntArray,
        poses: DevicePoses,
        steps: IntArray,
        last: int,
        *,
        drawn: int | IntArray = -1,
    ) -> IntArray:
        """Advance by one user step, right-handers first."""
        self._begin()
        answered = []
        for rows, _ in self._parts(ids, None):
            own = drawn if isinstance(drawn, int) else drawn[rows]
            seen = self._seen(poses, ids, rows)
            answered.append(
                self._group.step(ids[rows], times_ns[rows], seen, steps[rows], last, drawn=own)
            )
            self._take(ids[rows])
        found = np.concatenate(answered) if answered else np.zeros(0, dtype=np.int64)
        return np.asarray(ids[np.isin(ids, found)])

    def logs(self) -> LogRows:
        """Return the games' numbers."""
        return self._group.logs()

    def save(self, i: int, step: int) -> bytes | None:
        """Return the state of a user's app."""
        return self._group.save(i, step)

    def close(self) -> None:
        """End the apps."""
        self._group.close()

    def _parts(
        self, ids: IntArray, options: Mapping[str, OptionValue] | None
    ) -> list[tuple[IntArray, dict[str, OptionValue]]]:
        """Return rows of ``ids`` for each hand in use, and the options of their games."""
        mirrored = self._mirrored[ids]
        parts = []
        for hand, own in ((self._hand, ~mirrored), (_OTHER[self._hand], mirrored)):
            rows = np.flatnonzero(own)
            if len(rows):
                parts.append((rows, {**(options or {}), self._option: hand}))
        return parts

    def _seen(self, poses: DevicePoses, ids: IntArray, rows: IntArray) -> DevicePoses:
        """Return the devices of one hand's users as their apps receive them."""
        own = poses[rows]
        return mirrored_poses(own) if self._mirrored[ids[rows[0]]] else own

    def _begin(self) -> None:
        self._haptics, self._sounds = {}, {}

    def _take(self, ids: IntArray) -> None:
        """Copy the results of a call for users of one hand."""
        mirrored = bool(self._mirrored[ids[0]])
        pictures = self._group.pictures[ids]
        if mirrored and pictures.size:
            eyes = pictures.reshape(len(ids), self._eyes, -1, *pictures.shape[2:])
            pictures = eyes[:, ::-1, ..., ::-1].reshape(pictures.shape)
        self.pictures[ids] = pictures
        moved = set(ids.tolist())
        for i, pulses in self._group.haptics.items():
            if i in moved:
                self._haptics[i] = (
                    tuple(replace(pulse, hand=_OTHER[pulse.hand]) for pulse in pulses)
                    if mirrored
                    else pulses
                )
        for i, sounds in self._group.sounds.items():
            if i in moved:
                self._sounds[i] = tuple(map(_heard, sounds)) if mirrored else sounds


def mirrored_poses(poses: DevicePoses) -> DevicePoses:
    """Return the devices mirrored between left and right: the controllers change hands.

    Args:
        poses: rows (..., 7) in the app's frame, and inputs.
    """
    turned = poses.map(lambda rows: rows * _POSE if rows.shape[-1] == len(_POSE) else rows)
    return DevicePoses(
        head=turned.head,
        right_controller=turned.left_controller,
        left_controller=turned.right_controller,
        right_inputs=turned.left_inputs,
        left_inputs=turned.right_inputs,
    )


def _heard(sound: SoundEvent) -> SoundEvent:
    x, y, z = sound.position_m
    return replace(sound, position_m=(-x, y, z))
