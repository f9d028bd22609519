"""The apps of N users, stepped by one call: in this process as arrays, elsewhere side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import (
    APP_FAILURES,
    AppClient,
    AppDied,
    AppReply,
    DevicePoses,
    InProcessBatch,
    OptionValue,
)
from sim2vr_harness.envs.apps import AppFactory, app_factory, in_process_batch
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.perception import HeadsetVision

__all__ = ["AppFailure", "AppGroup", "BatchGroup", "ClientGroup", "Logs", "app_group"]

RESET_ATTEMPTS = 3
"""Apps in a row that may fail before a user's round is given up."""

IntArray = NDArray[np.int64]


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


class Logs(Protocol):
    """The games' named numbers at one moment, one entry per user."""

    def __getitem__(self, i: int) -> Mapping[str, float]:
        """Those of user ``i``."""

    def total(self, name: str) -> float:
        """The sum of one number over all users; 0 where the game has none of that name."""


class AppGroup(Protocol):
    """N apps. A call moves those of some users and writes their rows of the results."""

    apps: list[AppClient]
    failed: dict[int, str]
    """Users whose app has failed, and why; their next reset starts another one."""
    failures: list[AppFailure]
    """Every app that failed so far, the oldest first."""
    reward: NDArray[Any]
    """(N,) of the last step or reset."""
    finished: NDArray[np.uint8]
    """(N,) 1 where the game says that the round is over."""
    time_feature: NDArray[np.float32]
    """(N,) where in the round the game is, as it says itself."""
    pictures: NDArray[np.uint8]
    """(N, C, H, W) the channels of the headset images that the users see."""

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        """Starts rounds.

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
        self, ids: IntArray, times_ns: IntArray, poses: DevicePoses, steps: IntArray, last: int
    ) -> IntArray:
        """One user step of K frames.

        Args:
            ids: (M,) users.
            times_ns: (M, K) game times.
            poses: (M, K, 7) each.
            steps: (M,) which user step of the round this is.
            last: the number of the step after which the user ends the round.

        Returns:
            The users whose apps answered, in the order of ``ids``.
        """

    def logs(self) -> Logs:
        """The logs as they are now; later steps do not change what was returned."""

    def save(self, i: int, step: int) -> bytes | None:
        """The state of user ``i``'s app; None if it cannot be saved, or has failed (just now)."""

    def close(self) -> None:
        """Ends the apps; idempotent."""


def app_group(
    config: EnvConfig,
    n: int,
    vision: HeadsetVision,
    log_dir: Path | None,
    make_app: AppFactory | None = None,
) -> AppGroup:
    """The apps that ``config.app`` asks for.

    Args:
        config: of the users.
        n: number of users N.
        vision: whose channels are picked.
        log_dir: root of the apps' episode logs, or None.
        make_app: how to get the app of each user; None goes by ``config.app.transport``.

    Raises:
        ValueError: a setting that cannot be used.
        RuntimeError: an app or its renderer cannot be started.
    """
    if make_app is None and config.app.transport == "in_process":
        return BatchGroup(in_process_batch(config, n, log_dir, vision.channel_indices), n)
    make = app_factory(config, n) if make_app is None else make_app
    return ClientGroup(make, config, n, vision, log_dir)


class BatchGroup:
    """The apps of one :class:`InProcessBatch`: arrays there and back, no loop over users."""

    def __init__(self, batch: InProcessBatch, n: int) -> None:
        self.apps: list[AppClient] = [batch.app(i) for i in range(n)]
        self.failed: dict[int, str] = {}
        self.failures: list[AppFailure] = []
        self._batch = batch
        self.reward, self.finished = batch.rewards, batch.finished
        self.time_feature, self.pictures = batch.time_features, batch.vision

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        """See :class:`AppGroup`."""
        self._batch.reset_rounds(ids, seeds, poses, options)

    def step(
        self, ids: IntArray, times_ns: IntArray, poses: DevicePoses, steps: IntArray, last: int
    ) -> IntArray:
        """See :class:`AppGroup`; every app answers."""
        self._batch.step_frames(ids, times_ns, poses)
        return ids

    def logs(self) -> Logs:
        """See :class:`AppGroup`."""
        return _LogRows(self._batch.log_names, self._batch.logs.copy())

    def save(self, i: int, step: int) -> bytes:
        """See :class:`AppGroup`."""
        return self.apps[i].save()

    def close(self) -> None:
        """See :class:`AppGroup`."""
        for app in self.apps:
            app.close()


class _LogRows:
    """Rows of numbers that become dictionaries only when somebody looks."""

    def __init__(self, names: Sequence[str], rows: NDArray[np.float64]) -> None:
        self._names, self._rows = names, rows

    def __getitem__(self, i: int) -> Mapping[str, float]:
        return dict(zip(self._names, self._rows[i].tolist(), strict=True))

    def total(self, name: str) -> float:
        if name not in self._names:
            return 0.0
        return float(self._rows[:, self._names.index(name)].sum())


class _LogList:
    """Dictionaries as the apps sent them."""

    def __init__(self, logs: Sequence[Mapping[str, float]]) -> None:
        self._logs = tuple(logs)

    def __getitem__(self, i: int) -> Mapping[str, float]:
        return self._logs[i]

    def total(self, name: str) -> float:
        return sum(log.get(name, 0.0) for log in self._logs)


class ClientGroup:
    """Apps that are clients each, most of them outside this process, where they may fail.

    A step is sent to all of them before the first answer is waited for.

    Args:
        make_app: of each user.
        config: of the users.
        n: number of users N.
        vision: whose channels are picked.
        log_dir: root of the apps' episode logs, or None.
    """

    def __init__(
        self,
        make_app: AppFactory,
        config: EnvConfig,
        n: int,
        vision: HeadsetVision,
        log_dir: Path | None,
    ) -> None:
        self.apps: list[AppClient] = []
        self.failed: dict[int, str] = {}
        self.failures: list[AppFailure] = []
        self._config, self._log_dir, self._vision = config, log_dir, vision
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
        self.pictures = np.zeros((n, len(vision.channels), vision.height, vision.width), np.uint8)
        self._logs: list[Mapping[str, float]] = [{} for _ in range(n)]

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        """See :class:`AppGroup`."""
        for k, i in enumerate(ids.tolist()):
            self._take(i, self._reset_app(i, int(seeds[k]), _of_user(poses, k), options))

    def _reset_app(
        self,
        i: int,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> AppReply:
        """Starts a round, in a new app where the one before has failed."""
        for _ in range(RESET_ATTEMPTS):
            with self._noting_failure(i, 0):
                chosen = options
                if i in self.failed:
                    self.apps[i] = self._make_app(self._config, i, self._log_dir)
                    del self.failed[i]
                    chosen = {**self._options[i], **(options or {})}
                reply = self.apps[i].reset(seed, poses, chosen)
                self._options[i] |= options or {}
                return reply
        raise AppDied(
            f"user {i}: {RESET_ATTEMPTS} apps in a row failed at the start of a round; the last "
            f"one: {self.failed[i]}"
        )

    def step(
        self, ids: IntArray, times_ns: IntArray, poses: DevicePoses, steps: IntArray, last: int
    ) -> IntArray:
        """See :class:`AppGroup`."""
        users = ids.tolist()
        for k, i in enumerate(users):
            if i in self.failed:  # found out while the state was saved
                continue
            with self._noting_failure(i, int(steps[k])):
                ending = bool(steps[k] >= last)
                self.apps[i].start_step(times_ns[k], _of_user(poses, k), last=ending)
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
        self.pictures[i] = self._vision.pick(self.apps[i].image)
        self._logs[i] = reply.log

    @contextmanager
    def _noting_failure(self, i: int, step: int) -> Iterator[None]:
        """Ends the app of user ``i``, and remembers why, when the block finds it failed."""
        try:
            yield
        except APP_FAILURES as error:
            self.failed[i] = str(error)
            self.failures.append(AppFailure(i, step, str(error)))
            self.apps[i].close()

    def logs(self) -> Logs:
        """See :class:`AppGroup`."""
        return _LogList(self._logs)

    def save(self, i: int, step: int) -> bytes | None:
        """See :class:`AppGroup`."""
        if i in self.failed or "save" not in self.apps[i].capabilities:
            return None
        state: bytes | None = None
        with self._noting_failure(i, step):
            state = self.apps[i].save()
        return state

    def close(self) -> None:
        """See :class:`AppGroup`."""
        with ExitStack() as stack:  # each one, whatever happens to the others
            for app in self.apps:
                stack.callback(app.close)


def _of_user(poses: DevicePoses, k: int) -> DevicePoses:
    def row(rows: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        return None if rows is None else rows[k]

    return DevicePoses(poses.head[k], row(poses.right_controller), row(poses.left_controller))
