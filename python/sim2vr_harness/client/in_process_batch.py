"""Many apps inside this process, stepped together on native threads."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.base import (
    AppReply,
    DevicePoses,
    Float32Array,
    Float64Array,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.client.in_process import checked_seed, load_runtime

__all__ = ["InProcessBatch", "InProcessBatchApp"]


class InProcessBatch:
    """N apps of one game in the C++ runtime; each is an app as any other (:meth:`app`).

    Steps that were started run together, on all threads, when the first of them is finished. What
    an app does depends on its own input only, to the bit: not on N, its place or the threads.

    Args:
        n: number of apps N.
        game: name of the game.
        options: the game's options.
        width: of the headset images, pixels.
        height: of the headset images, pixels.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``; one per thread.
        log_dir: app 7 logs to ``user007`` below it; None for no logs.
        threads: 1 or more.
        vision_channels: which channels of the images (0 red, 1 green, 2 blue, 3 depth)
            :attr:`vision` holds.

    Raises:
        ValueError: unknown game or option, unusable size; names the field, got and expected.
        RuntimeError: no renderer can be started.
    """

    def __init__(
        self,
        n: int,
        game: str,
        options: Mapping[str, OptionValue] | None = None,
        *,
        width: int = 120,
        height: int = 80,
        renderer: str = "automatic",
        log_dir: Path | None = None,
        threads: int = 1,
        vision_channels: Sequence[int] = (),
    ) -> None:
        self._batch: Any = load_runtime().AppBatch(
            game=game,
            options=json.dumps(dict(options or {})),
            apps=n,
            threads=threads,
            width=width,
            height=height,
            renderer=renderer,
            log_dir="" if log_dir is None else str(log_dir),
            vision_channels=list(vision_channels),
        )
        self.images: UInt8Array = self._batch.images
        """(N, H, W, 4) the apps' headset images, overwritten by their steps; no copy."""
        self.vision: UInt8Array = self._batch.vision
        """(N, C, H, W) the chosen channels of the images; overwritten like them."""
        self.rewards: NDArray[np.float32] = self._batch.rewards
        """(N,) of every app's last step or reset; overwritten, as all results."""
        self.finished: UInt8Array = self._batch.finished
        """(N,) 1 where the round is over."""
        self.time_features: NDArray[np.float32] = self._batch.time_features
        """(N,)"""
        self.privileged_names: tuple[str, ...] = tuple(self._batch.privileged_names)
        """Names of the numbers behind the picture, for teachers; none for a game without."""
        self.privileged: Float32Array = self._batch.privileged
        """(N, len(privileged_names)) after the last frames, overwritten by the apps' steps; no
        copy. Those named ``aid.*`` are not to be observed."""
        self.log_names: list[str] = []
        """Names of the columns of :attr:`logs`, from the first reset on."""
        self.logs: Float64Array = np.zeros((n, 0))
        """(N, L) the games' named numbers."""
        self._started: dict[int, tuple[Int64Array, DevicePoses]] = {}
        self._left = set(range(n))

    def app(self, index: int) -> InProcessBatchApp:
        """App ``index``, 0 to N - 1."""
        return InProcessBatchApp(self, index)

    @property
    def native(self) -> Any:
        """The extension's object.

        Raises:
            RuntimeError: the apps were closed.
        """
        if self._batch is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._batch

    def reset(
        self,
        index: int,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
        time_ns: int,
    ) -> AppReply:
        """See :meth:`AppClient.reset`."""
        one = DevicePoses(
            _row(poses.head), _row(poses.right_controller), _row(poses.left_controller)
        )
        self.reset_rounds([index], [checked_seed(seed)], one, options, time_ns=time_ns)
        return self._reply(index)

    def reset_rounds(
        self,
        indices: Sequence[int] | Int64Array,
        seeds: Sequence[int] | Int64Array,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> None:
        """Starts rounds in M apps and draws their first frames; see :meth:`AppClient.reset`.

        Args:
            indices: (M,) which apps.
            seeds: (M,) 32-bit seeds.
            poses: (M, 7) per device.
            options: of these apps from this round on.
            time_ns: game time of the first frames.
        """
        self.native.reset(
            np.asarray(indices, dtype=np.int32),
            np.asarray(seeds, dtype=np.uint32),
            json.dumps(dict(options or {})),
            poses.head,
            poses.left_controller,
            poses.right_controller,
            time_ns,
        )
        for index in indices:
            self._started.pop(int(index), None)
        self.find_logs()

    def step_frames(
        self, indices: Sequence[int] | Int64Array, times_ns: Int64Array, poses: DevicePoses
    ) -> None:
        """One user step of K frames in M apps; see :meth:`AppClient.step_frames`.

        Args:
            indices: (M,) which apps.
            times_ns: (M, K) game times.
            poses: (M, K, 7) per device.
        """
        self.native.step(
            np.asarray(indices, dtype=np.int32),
            times_ns,
            poses.head,
            poses.left_controller,
            poses.right_controller,
        )
        self.find_logs()

    def find_logs(self) -> None:
        """Looks at the rounds' logs, which have names from the first round on, begun or loaded."""
        if not self.log_names:
            self.log_names, self.logs = self.native.log_names, self.native.logs

    def start(self, index: int, times_ns: Int64Array, poses: DevicePoses) -> None:
        """Keeps a step until :meth:`finish`."""
        self._started[index] = (np.asarray(times_ns, dtype=np.int64), poses)

    def finish(self, index: int) -> AppReply:
        """Runs the started steps unless another app's finish has, and replies for this app."""
        if index in self._started:
            self._run_started()
        return self._reply(index)

    def _run_started(self) -> None:
        started, self._started = self._started, {}
        # Apps that differ in frames or devices go one group after the other.
        groups: dict[tuple[int, bool, bool], list[int]] = {}
        for index, (times, poses) in started.items():
            key = (len(times), poses.left_controller is None, poses.right_controller is None)
            groups.setdefault(key, []).append(index)
        for indices in groups.values():
            self._run(indices, [started[index] for index in indices])

    def _run(self, indices: list[int], steps: list[tuple[Int64Array, DevicePoses]]) -> None:
        times = np.stack([times for times, _ in steps])
        first = steps[0][1]
        head = np.stack([poses.head for _, poses in steps])
        left = right = None
        if first.left_controller is not None:
            left = np.stack([poses.left_controller for _, poses in steps])  # type: ignore[misc]
        if first.right_controller is not None:
            right = np.stack([poses.right_controller for _, poses in steps])  # type: ignore[misc]
        self.step_frames(indices, times, DevicePoses(head, right, left))

    def _reply(self, index: int) -> AppReply:
        return AppReply(
            float(self.rewards[index]),
            bool(self.finished[index]),
            float(self.time_features[index]),
            dict(zip(self.log_names, self.logs[index].tolist(), strict=True)),
        )

    def let_go(self, index: int) -> None:
        """The batch closes with its last app."""
        self._left.discard(index)
        self._started.pop(index, None)
        if not self._left and self._batch is not None:
            self._batch.close()
            self._batch = None


def _row(pose: Any) -> Any:
    return None if pose is None else np.asarray(pose, dtype=np.float64)[None]


class InProcessBatchApp:
    """One app of an :class:`InProcessBatch`; an :class:`~sim2vr_harness.client.base.AppClient`."""

    def __init__(self, batch: InProcessBatch, index: int) -> None:
        self._batch: InProcessBatch | None = batch
        self._index = index

    @property
    def batch(self) -> InProcessBatch:
        """The apps that this one is stepped with; RuntimeError when it was closed."""
        return self._open()

    @property
    def index(self) -> int:
        """Its place in the batch, and its row in the batch's arrays."""
        return self._index

    def _open(self) -> InProcessBatch:
        if self._batch is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._batch

    @property
    def renderer_description(self) -> str:
        """See :class:`AppClient`."""
        return str(self._open().native.renderer_description)

    @property
    def image(self) -> UInt8Array:
        """See :class:`AppClient`."""
        image: UInt8Array = self._open().images[self._index]
        return image

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """See :class:`AppClient`."""
        return self._open().reset(self._index, seed, poses, options, time_ns)

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        frames = DevicePoses(
            _row(poses.head), _row(poses.right_controller), _row(poses.left_controller)
        )
        return self.step_frames(np.array([time_ns]), frames)

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        self.start_step(times_ns, poses)
        return self.finish_step()

    def start_step(self, times_ns: Int64Array, poses: DevicePoses, *, last: bool = False) -> None:
        """See :class:`AppClient`; the frames run when the first app of the batch finishes."""
        self._open().start(self._index, times_ns, poses)

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`."""
        return self._open().finish(self._index)

    @property
    def capabilities(self) -> frozenset[str]:
        """See :class:`AppClient`; all that the game has."""
        return frozenset(self._open().native.capabilities)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        """See :class:`AppClient`."""
        image: UInt8Array = self._open().native.render_view(self._index, "headset", width, height)
        return image

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        """See :class:`AppClient`."""
        image: UInt8Array = self._open().native.render_view(self._index, view, width, height)
        return image

    def save(self) -> bytes:
        """See :class:`AppClient`."""
        return bytes(self._open().native.save(self._index))

    def load(self, state: bytes) -> None:
        """See :class:`AppClient`."""
        batch = self._open()
        batch.native.load(self._index, state)
        batch.find_logs()

    def state_hash(self) -> int:
        """See :class:`AppClient`."""
        return int(self._open().native.state_hash(self._index))

    def close(self) -> None:
        """See :class:`AppClient`."""
        if self._batch is not None:
            self._batch.let_go(self._index)
            self._batch = None

    def __enter__(self) -> InProcessBatchApp:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
