"""User steps of N apps: after all bodies have moved, or while the bodies of other users move."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import DevicePoses, frame_times_ns
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.actions import Actions
from sim2vr_harness.envs.app_group import AppGroup
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.late_hands import LateHands
from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.bodies import DEVICES

IntArray = NDArray[np.int64]

_SHARES = (0.5, 0.25, 0.25)
"""Parts of the users whose bodies move one after the other, beside a GPU that draws for the part
before: a picture takes it six tenths of the time that sixteen cores take for a body."""


class AppSteps:
    """Takes users' devices to their apps, and lets those play.

    A GPU draws while the processor moves the bodies of other users. What users and apps do is the
    same to the bit.

    Args:
        config: of the users.
        users: the bodies.
        group: the apps.
        actions: what fingers do.
        max_steps: user steps of an episode.
    """

    def __init__(
        self, config: EnvConfig, users: UserBatch, group: AppGroup, actions: Actions, max_steps: int
    ) -> None:
        self._config, self._users, self._group = config, users, group
        self._actions, self._max_steps = actions, max_steps
        self.late_hands = LateHands(config, users.n)
        """To be watched by who saves states, where it has frames."""
        self.shares = _SHARES if group.drawn_by_gpu else (1.0,)
        """Parts of the users to move one after the other."""
        self._beside: ThreadPoolExecutor | None = None

    @contextmanager
    def step(
        self, active: NDArray[np.bool_], steps: IntArray, drawn: int | IntArray, *, whole: bool
    ) -> Iterator[_Step]:
        """Take a user step; when it is left, no app is moving any more.

        Args:
            active: (N,) users who take it.
            steps: (N,) which user step of the round this is.
            drawn: which frame is drawn, -1 the last; (N,) where users differ.
            whole: all bodies have to move before the first app does.
        """
        one = _Step(self, active, steps, drawn, (1.0,) if whole else self.shares)
        try:
            yield one
        finally:
            wait(one.running)

    def beside(self) -> ThreadPoolExecutor:
        """Return the thread that apps play in while bodies move."""
        if self._beside is None:
            self._beside = ThreadPoolExecutor(1, "apps")
        return self._beside

    def close(self) -> None:
        """End the thread."""
        if self._beside is not None:
            self._beside.shutdown()

    def play(self, ids: IntArray, steps: IntArray, drawn: int | IntArray) -> IntArray:
        """Step the apps of these users; return those whose apps have answered."""
        frames = self._config.frames_per_step
        # From the step count, so that rounding never accumulates.
        numbers = ((steps - 1) * frames + 1)[:, None] + np.arange(frames)
        times_ns = frame_times_ns(numbers, self._config.action_frequency_hz * frames)
        poses = self.step_poses(ids)
        return self._group.step(ids, times_ns, poses, steps, self._max_steps, drawn=drawn)

    def poses(self, ids: IntArray, sample: int) -> DevicePoses:
        """Where these users' devices are, (K, 7); see :meth:`UserBatch.device_poses`."""
        head, right, left = (
            pose_to_app(*(part[ids] for part in self._users.device_poses(name, sample)))
            if name in self._users.body.devices
            else None
            for name in DEVICES
        )
        assert head is not None  # every body wears a headset
        return DevicePoses(head, right, left)

    def step_poses(self, ids: IntArray) -> DevicePoses:
        """Where these users' devices were in the F frames of the last step, (K, F, 7)."""
        frames = self._config.frames_per_step
        samples = [self.poses(ids, k) for k in range(frames)]
        parts = ("head", "right_controller", "left_controller")
        stacked = {
            name: np.stack([getattr(poses, name) for poses in samples], axis=1)
            for name in parts
            if getattr(samples[0], name) is not None
        }
        poses = DevicePoses(**stacked, **self._actions.input_rows(ids, frames))
        return self.late_hands.late(poses, ids)


class _Step:
    """A user step that is being taken.

    Attributes:
        shares: parts of the users whose bodies are to move one after the other.
        running: steps of apps beside.
    """

    def __init__(
        self,
        apps: AppSteps,
        active: NDArray[np.bool_],
        steps: IntArray,
        drawn: int | IntArray,
        shares: tuple[float, ...],
    ) -> None:
        self._apps, self._active = apps, active
        self._steps, self._drawn, self.shares = steps, drawn, shares
        self._ids = np.zeros(0, dtype=np.int64)
        self.running: list[Future[IntArray]] = []

    def moved(self, ids: IntArray) -> None:
        """Let the apps of users play whose bodies have moved; in one part, only when wanted."""
        ids = ids[self._active[ids]]
        if len(self.shares) == 1:
            self._ids = ids
        elif len(ids):
            self.running.append(self._apps.beside().submit(self._play, ids))

    def answered(self) -> IntArray:
        """Return the users whose apps have answered."""
        if len(self.shares) == 1:
            return self._play(self._ids)
        wait(self.running)
        return np.concatenate([self._ids, *(each.result() for each in self.running)])

    def _play(self, ids: IntArray) -> IntArray:
        drawn = self._drawn if isinstance(self._drawn, int) else self._drawn[ids]
        return self._apps.play(ids, self._steps[ids], drawn)
