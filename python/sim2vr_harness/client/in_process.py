"""Many apps inside this process, stepped together on native threads; one app is a batch of one."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.base import (
    AppClient,
    AppReply,
    ClockSettings,
    DevicePoses,
    Float32Array,
    Float64Array,
    HapticPulse,
    Int64Array,
    OptionValue,
    SoundEvent,
    ThirdPersonView,
    UInt8Array,
    numbers_of_log,
    plain_options,
)
from sim2vr_harness.client.runtime import checked_seed, list_games, load_runtime
from sim2vr_harness.client.scene import AppScene, Observer, SceneMesh

_DEVICE_ROWS = ("head", "left_controller", "right_controller", "left_inputs", "right_inputs")
"""Fields of DevicePoses in the order of the extension's arguments."""


class InProcessBatch:
    """N apps of one game in the C++ runtime: arrays there and back, no loop over users.

    Each is an app as any other (:attr:`apps`), and all together are the apps of N users
    (:class:`~sim2vr_harness.envs.app_group.AppGroup`, where results and calls are described).

    What an app does depends on its own input only, to the bit: not on N, its place or the threads.

    Args:
        n: number of apps N.
        width, height: of an eye's headset image, pixels.
        eyes: 1, or 2 for a picture of each eye.
        ipd_m: distance between the pupils, metres.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``; one per thread.
        share_renderer: the first thread draws with the renderer that the process shares: for small
            batches of which there are many.
        log_dirs: N roots of the apps' episode logs; None for no logs.
        threads: 1 or more.
        vision_channels: which channels of the images (0 red, 1 green, 2 blue, 3 depth)
            :attr:`pictures` holds.
        fovea: width and height of the pictures around the gaze, 0: none, and the width of a pixel
            at a depth of 1 m, m.
        clock: fixed step and tolerances of the apps' clocks.

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
        eyes: int = 1,
        ipd_m: float = 0.064,
        renderer: str = "automatic",
        share_renderer: bool = False,
        log_dirs: Sequence[Path] | None = None,
        threads: int = 1,
        vision_channels: Sequence[int] = (),
        fovea: tuple[int, int, float] = (0, 0, 0.0),
        clock: ClockSettings | None = None,
    ) -> None:
        self._batch: Any = load_runtime().AppBatch(
            game=game,
            options=json.dumps(plain_options(options)),
            apps=n,
            threads=threads,
            width=width,
            height=height,
            eyes=eyes,
            ipd_m=ipd_m,
            renderer=renderer,
            share_renderer=share_renderer,
            log_dirs=[os.fsencode(folder) for folder in log_dirs or ()],
            vision_channels=list(vision_channels),
            fovea_width=fovea[0],
            fovea_height=fovea[1],
            fovea_pixel_m=fovea[2],
            **asdict(clock or ClockSettings()),
        )
        self._bind()
        self._log_names: list[str] = []  # from the first reset on
        self._logs: Float64Array = np.zeros((n, 0))
        self._started: dict[int, tuple[Int64Array, DevicePoses, int]] = {}
        self._open = set(range(n))
        self.failed: dict[int, str] = {}
        self.left: dict[int, str] = {}
        self.failures: list[Any] = []
        # Mesa's drivers for the processor say so by name.
        name = str(self.native.renderer_description)
        self.drawn_by_gpu = not any(
            word in name for word in ("llvmpipe", "softpipe", "null renderer")
        )

    def _bind(self) -> None:
        """Take the extension's arrays, which it overwrites, as attributes."""
        self.capabilities: frozenset[str] = frozenset(self._batch.capabilities)
        """Capabilities that all apps have; see :attr:`AppClient.capabilities`."""
        self.images: UInt8Array = self._batch.images
        """(N, H, W, 4), with two eyes (N, 2, H, W, 4), the apps' headset images, overwritten by
        their steps; no copy."""
        self.pictures: UInt8Array = self._batch.vision
        """(N, eyes * C, H, W) the chosen channels of the images, the left eye's first; overwritten
        like them."""
        self.fovea: UInt8Array = self._batch.fovea
        """(N, h, w, 4) pictures around the gaze, and their depths, m; overwritten like them."""
        self.fovea_depth: Float32Array = self._batch.fovea_depth
        self.gaze: Float32Array = self._batch.gaze
        """(N, 2) middles of the next of these pictures, right and up, m at a depth of 1 m."""
        self.reward: NDArray[np.float32] = self._batch.rewards
        """(N,) of every app's last step or reset; overwritten, as all results."""
        self.finished: UInt8Array = self._batch.finished
        """(N,) 1 where the round is over."""
        self.time_feature: NDArray[np.float32] = self._batch.time_features
        """(N,)"""
        self._haptic_counts: NDArray[np.int32] = self._batch.haptic_counts
        self._sound_counts: NDArray[np.int32] = self._batch.sound_counts
        self.privileged_names: tuple[str, ...] = tuple(self._batch.privileged_names)
        """Names of the numbers behind the picture, for teachers; none for a game without."""
        self.privileged: Float32Array = self._batch.privileged
        """(N, len(privileged_names)) after the last frames, overwritten by the apps' steps; no
        copy. Those named ``aid.*`` are not to be observed."""
        self.privileged_drawn: Float32Array = self._batch.privileged_drawn
        """The same after the frames that are drawn: what the pictures show."""

    @cached_property
    def apps(self) -> list[AppClient]:
        """The apps; the batch closes with its last one."""
        return [InProcessBatchApp(self, index) for index in range(len(self.images))]

    @property
    def native(self) -> Any:
        """The extension's object.

        Raises:
            RuntimeError: the apps were closed.
        """
        if self._batch is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._batch

    # --- M apps at a time --------------------------------------------------------------------

    def reset(
        self,
        ids: Sequence[int] | Int64Array,
        seeds: Sequence[int] | Int64Array,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> None:
        self.native.reset(
            np.asarray(ids, dtype=np.int32),
            np.asarray(seeds, dtype=np.uint32),
            json.dumps(plain_options(options)),
            *_arguments(poses),
            time_ns,
        )
        for index in ids:
            self._started.pop(int(index), None)
        self._find_logs()

    def step(
        self,
        ids: Int64Array,
        times_ns: Int64Array,
        poses: DevicePoses,
        steps: Int64Array,
        last: int,
        *,
        drawn: int | Int64Array = -1,
    ) -> Int64Array:
        if isinstance(drawn, int):
            self._run(ids, times_ns, poses, drawn)
            return ids
        for frame in np.unique(drawn).tolist():
            rows = np.flatnonzero(drawn == frame)
            self._run(ids[rows], times_ns[rows], poses[rows], frame)
        return ids

    def _run(
        self,
        ids: Sequence[int] | Int64Array,
        times_ns: Int64Array,
        poses: DevicePoses,
        drawn: int,
    ) -> None:
        self.native.step(np.asarray(ids, dtype=np.int32), times_ns, *_arguments(poses), drawn)
        self._find_logs()

    def head_requests(
        self,
        ids: Sequence[int] | Int64Array,
        seeds: Sequence[int] | Int64Array,
        options: Mapping[str, OptionValue] | None = None,
    ) -> Float64Array:
        requests: Float64Array = self.native.head_requests(
            np.asarray(ids, dtype=np.int32),
            np.asarray(seeds, dtype=np.uint32),
            json.dumps(plain_options(options)),
        )
        return requests

    @property
    def haptics(self) -> dict[int, tuple[HapticPulse, ...]]:
        return {i: self._haptics(i) for i in np.flatnonzero(self._haptic_counts).tolist()}

    @property
    def sounds(self) -> dict[int, tuple[SoundEvent, ...]]:
        return {i: self._sounds(i) for i in np.flatnonzero(self._sound_counts).tolist()}

    def logs(self) -> LogRows:
        return LogRows(self._log_names, self._logs.copy())

    def save(self, i: int, step: int) -> bytes:
        return self.apps[i].save()

    def close(self) -> None:
        for app in self.apps:
            app.close()

    # --- one app -----------------------------------------------------------------------------

    def start(self, index: int, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1) -> None:
        """Keeps a step of one app, K frames, until :meth:`finish`."""
        self._started[index] = (np.asarray(times_ns, dtype=np.int64), poses, drawn)

    def finish(self, index: int) -> AppReply:
        """Runs the started steps unless another app's finish has, and replies for this app."""
        if index in self._started:
            started, self._started = self._started, {}
            # Apps that differ in frames or devices go one group after the other.
            groups: dict[tuple[Any, ...], list[int]] = {}
            for started_index, (times, poses, drawn) in started.items():
                given = tuple(getattr(poses, name) is not None for name in _DEVICE_ROWS)
                groups.setdefault((len(times), drawn, *given), []).append(started_index)
            for (_, drawn, *_given), indices in groups.items():
                steps = [started[started_index] for started_index in indices]
                times = np.stack([times for times, _, _ in steps])
                self._run(
                    indices, times, DevicePoses.stack([poses for _, poses, _ in steps]), drawn
                )
        return self.reply(index)

    def reply(self, index: int) -> AppReply:
        """Return the reply to an app's last step or reset."""
        return AppReply(
            float(self.reward[index]),
            bool(self.finished[index]),
            float(self.time_feature[index]),
            numbers_of_log(self._log_names, self._logs[index].tolist()),
            self._haptics(index),
            self._sounds(index),
        )

    def _haptics(self, index: int) -> tuple[HapticPulse, ...]:
        if self._haptic_counts[index] == 0:
            return ()
        return tuple(
            HapticPulse(hand, amplitude, frequency_hz, duration_ns * 1e-9)
            for hand, amplitude, frequency_hz, duration_ns in self.native.haptics(index)
        )

    def _sounds(self, index: int) -> tuple[SoundEvent, ...]:
        if self._sound_counts[index] == 0:
            return ()
        return tuple(
            SoundEvent(name, tuple(position_m), gain)
            for name, position_m, gain in self.native.sounds(index)
        )

    def load(self, index: int, state: bytes) -> None:
        self.native.load(index, state)
        self._find_logs()

    def let_go(self, index: int) -> None:
        """The batch closes with its last app."""
        self._open.discard(index)
        self._started.pop(index, None)
        if not self._open and self._batch is not None:
            self._batch.close()
            self._batch = None

    def _find_logs(self) -> None:
        """Looks at the rounds' logs, which have names from the first round on, begun or loaded."""
        if not self._log_names:
            self._log_names, self._logs = self.native.log_names, self.native.logs


class LogRows:
    """The games' named numbers at one moment; a user's dictionary is made when someone looks.

    Args:
        names: L of them.
        rows: (N, L), NaN for a number that a user's round does not have.
    """

    def __init__(self, names: Sequence[str], rows: NDArray[np.float64]) -> None:
        self.names, self.rows = names, rows

    @classmethod
    def of(cls, logs: Sequence[Mapping[str, float]]) -> LogRows:
        """Return the numbers of N dictionaries."""
        names = list(dict.fromkeys(name for log in logs for name in log))
        rows = [[log.get(name, np.nan) for name in names] for log in logs]
        return cls(names, np.array(rows, dtype=np.float64).reshape(len(logs), len(names)))

    def __getitem__(self, i: int) -> Mapping[str, float]:
        """Return the numbers of user ``i``."""
        return numbers_of_log(self.names, self.rows[i].tolist())

    def total(self, name: str) -> float:
        """Return the sum of one number over all users; 0 if the game has none of that name."""
        if name not in self.names:
            return 0.0
        return float(np.nansum(self.rows[:, self.names.index(name)]))


class InProcessBatchApp(AppClient):
    """One app of an :class:`InProcessBatch`.

    Steps of several apps that were started run together, on all threads, when the first of them is
    finished.
    """

    def __init__(self, batch: InProcessBatch, index: int) -> None:
        self._batch: InProcessBatch | None = batch
        self._index = index
        self._meshes: list[SceneMesh] = []
        self._indices = np.array([index], dtype=np.int32)
        self._capabilities = batch.capabilities | ({"fovea"} if batch.fovea.size else set())

    @property
    def batch(self) -> InProcessBatch:
        """The apps that this one is stepped with; RuntimeError when it was closed."""
        if self._batch is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._batch

    @property
    def index(self) -> int:
        """Its place in the batch, and its row in the batch's arrays."""
        return self._index

    @property
    def renderer_description(self) -> str:
        return str(self.batch.native.renderer_description)

    @property
    def capabilities(self) -> frozenset[str]:
        """Capabilities of the game."""
        return self._capabilities

    @property
    def image(self) -> UInt8Array:
        """Headset image as of :attr:`AppClient.image`; its memory outlives the app."""
        image: UInt8Array = self.batch.images[self._index]
        return image

    @property
    def fovea(self) -> tuple[UInt8Array, Float32Array]:
        self.require("fovea")
        return self.batch.fovea[self._index], self.batch.fovea_depth[self._index]

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        batch = self.batch
        batch.gaze[self._index] = self.gaze
        batch.reset([self._index], [checked_seed(seed)], _one_app(poses), options, time_ns=time_ns)
        return batch.reply(self._index)

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        rows = [None if row is None else np.asarray(row)[None, None] for row in _arguments(poses)]
        return self._run(np.array([[time_ns]]), rows, -1)

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1) -> AppReply:
        return self._run(np.asarray(times_ns)[None], _arguments(_one_app(poses)), drawn)

    def _run(
        self, times_ns: Int64Array, devices: list[Float64Array | None], drawn: int
    ) -> AppReply:
        """Runs (1, K) frames of this app alone, whatever other apps have started."""
        batch = self.batch
        batch.gaze[self._index] = self.gaze
        batch.native.step(self._indices, times_ns, *devices, drawn)
        return batch.reply(self._index)

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """Queue a step; its frames run when the first app of the batch finishes its own."""
        self.batch.gaze[self._index] = self.gaze
        self.batch.start(self._index, times_ns, poses, drawn)

    def finish_step(self) -> AppReply:
        return self.batch.finish(self._index)

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        self.require("head_request")
        pitch = self.batch.head_requests([self._index], [checked_seed(seed)], options)[0]
        return None if np.isnan(pitch) else float(pitch)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        return self._render("headset", width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        return self._render(view, width, height)

    def _render(self, view: str, width: int, height: int) -> UInt8Array:
        self.require("views")
        image: UInt8Array = self.batch.native.render_view(self._index, view, width, height)
        return image

    def _render_from(self, observer: Observer) -> tuple[UInt8Array, Float32Array]:
        drawn: tuple[UInt8Array, Float32Array] = self.batch.native.render_from(
            self._index,
            observer.pose,
            observer.vertical_fov_deg,
            observer.width,
            observer.height,
        )
        return drawn

    def scene(self) -> AppScene:
        self.require("scene")
        native = self.batch.native
        columns = native.shown(self._index)
        for number in range(len(self._meshes), int(columns[3].max(initial=-1)) + 1):
            name, vertices, triangles = native.shown_mesh(self._index, number)
            self._meshes.append(SceneMesh(name, vertices, triangles.astype(np.int64)))
        return AppScene.of_columns(columns, self._meshes)

    def save(self) -> bytes:
        self.require("save")
        return bytes(self.batch.native.save(self._index))

    def load(self, state: bytes) -> None:
        self.require("save")
        self.batch.load(self._index, state)

    def state_hash(self) -> int:
        self.require("save")
        return int(self.batch.native.state_hash(self._index))

    def close(self) -> None:
        if self._batch is not None:
            self._batch.let_go(self._index)
            self._batch = None


class InProcessApp(InProcessBatchApp):
    """One app by itself: a batch of one, which draws with the renderer that the process shares.

    Args:
        game: name of the game (:func:`list_games`).
        options: the game's options.
        log_dir: folder for ``states.csv`` and ``events.csv`` of every round, or None.
        settings: width, height, eyes, ipd_m, renderer and clock of :class:`InProcessBatch`.

    Raises:
        ValueError: unknown game or option, unusable size; names the field, got and expected.
        RuntimeError: no renderer can be started.
    """

    def __init__(
        self,
        game: str,
        options: Mapping[str, OptionValue] | None = None,
        *,
        log_dir: Path | None = None,
        **settings: Any,
    ) -> None:
        logs = None if log_dir is None else [log_dir]
        batch = InProcessBatch(1, game, options, share_renderer=True, log_dirs=logs, **settings)
        super().__init__(batch, 0)


def _one_app(poses: DevicePoses) -> DevicePoses:
    """The same poses and inputs with an axis of length 1 in front."""
    return poses.map(lambda rows: np.asarray(rows, dtype=np.float64)[None])


def _arguments(poses: DevicePoses) -> list[Float64Array | None]:
    return [getattr(poses, name) for name in _DEVICE_ROWS]


_KINDS: tuple[tuple[str, Literal["truth", "text"]], ...] = (
    ("expected true or false", "truth"),
    ("expected a string", "text"),
)
"""Wording of the runtime for the expected type of an option (``core/options.cpp``)."""


@lru_cache
def option_kind(game: str, option: str) -> Literal["truth", "text", "other"] | None:
    """Return what an option of a game of the runtime takes; None of another game or option.

    The runtime says so when the option has a value of another kind, an empty list.
    """
    if game not in list_games():
        return None
    try:
        InProcessBatch(1, game, {option: []}, renderer="null", width=8, height=8)
    except ValueError as error:
        found = [kind for words, kind in _KINDS if str(error).endswith(words)]
        unknown = f"unknown option '{option}'" in str(error)
        return found[0] if found else None if unknown else "other"
    return "other"
