"""Protocol 2: binary messages, several apps in one, images raw or in shared memory.

docs/protocol.md describes every byte.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.base import (
    AppReply,
    ClockSettings,
    DevicePoses,
    Float64Array,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.client.channel import Channel
from sim2vr_harness.client.errors import AppError, AppRefused, ProtocolError
from sim2vr_harness.client.poses import frame_times, pose_rows, tracked_devices

__all__ = ["Protocol2App", "Protocol2Connection"]

MAGIC = b"S2VR"
VERSION = 2
HEADER = struct.Struct("<4sHHIIII")
"""Magic, version, type, sequence, count of records, status, flags."""
REPLY = 0x8000
IN_SHARED_MEMORY = 1
MAX_EDGE = 8192
_CAPABILITIES = frozenset({"save", "views", "frames", "left_controller"})
QUIT_S = 2.0
"""How long the server may take to acknowledge the end of the session."""

RESET_RECORD = struct.Struct("<IIqII")
"""App, seed, time (ns), tracked devices, 0; a pose block follows."""
STEP_RECORD = struct.Struct("<II")
"""App, number of frames."""
FRAME_DTYPE = np.dtype(
    [("time_ns", "<i8"), ("tracked", "<u4"), ("pad", "<u4"), ("poses", "<f8", (3, 7))]
)
RESULT_DTYPE = np.dtype(
    [
        ("app", "<u4"),
        ("finished", "<u4"),
        ("reward", "<f4"),
        ("time_feature", "<f4"),
        ("status", "<u4"),
        ("log_count", "<u4"),
        ("log_names", "<u4"),
        ("pad", "<u4"),
    ]
)
_APP = struct.Struct("<I")
_HASH = struct.Struct("<Q")


class Type(IntEnum):
    """Kinds of requests."""

    HELLO = 1
    RESET = 2
    STEP = 3
    RENDER = 4
    SAVE = 5
    LOAD = 6
    HASH = 7
    QUIT = 8


_DOING = {
    Type.HELLO: "the hello",
    Type.RESET: "a reset",
    Type.STEP: "a step",
    Type.RENDER: "drawing",
    Type.SAVE: "saving",
    Type.LOAD: "loading",
    Type.HASH: "the hash",
    Type.QUIT: "the end",
}


class Status(IntEnum):
    """How a request, or one record of it, went."""

    OK = 0
    INVALID_ARGUMENT = 1
    STATE_ERROR = 2
    ENGINE_ERROR = 3
    MALFORMED = 4
    BUSY = 5
    VERSION = 6


class Protocol2Connection:
    """A session with a server that plays N apps.

    The steps of several apps that were started before the first of them is finished travel in one
    message; it is sent as soon as every app of the connection has one, or else when the first is
    asked for its reply.

    Args:
        channel: to the server; owned by this object from now on, its process too.
        apps: N.
        game: name of the game; None takes the server's.
        options: the game's options.
        width: of the headset image, pixels.
        height: of the headset image, pixels.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``.
        log_dir: root of the apps' episode logs, or None.
        clock: fixed step and tolerances of the apps' clocks.
        shared_memory: whether to read images from memory shared with a server on this machine.
        start_timeout_s: how long the server may take to start and to make the apps.

    Raises:
        AppRefused: a setting that the server does not take.
        AppTimeout, AppDied, ProtocolError: there is no such server.
    """

    def __init__(
        self,
        channel: Channel,
        *,
        apps: int = 1,
        game: str | None = None,
        options: Mapping[str, OptionValue] | None = None,
        width: int = 120,
        height: int = 80,
        renderer: str | None = None,
        log_dir: Path | None = None,
        clock: ClockSettings | None = None,
        shared_memory: bool = True,
        start_timeout_s: float = 60.0,
    ) -> None:
        self.channel = channel
        self.apps = apps
        self.shape = (height, width, 4)
        if not (1 <= width <= MAX_EDGE and 1 <= height <= MAX_EDGE):
            self._abandon()
            raise ValueError(
                f"image size: got {width} x {height}, expected 1 to {MAX_EDGE} pixels each"
            )
        self._sequence = 0
        self._names: dict[int, list[str]] = {}
        self._queued: dict[int, NDArray] = {}
        self._sent: list[int] = []
        self._results: dict[int, AppReply | Exception] = {}
        self.taken: set[int] = set()
        self._open_apps = apps
        self.images: list[UInt8Array] = [np.zeros(self.shape, np.uint8) for _ in range(apps)]
        self._shared: UInt8Array | None = None
        wanted = {
            "client": f"sim2vr-harness, Python {sys.version_info.major}.{sys.version_info.minor}",
            "apps": apps,
            "game": game,
            "options": dict(options or {}),
            "width": width,
            "height": height,
            "renderer": renderer,
            "log_dir": None if log_dir is None else str(log_dir),
            **asdict(clock or ClockSettings()),
            "shared_memory": shared_memory,
        }
        try:
            self._hello({k: v for k, v in wanted.items() if v is not None}, start_timeout_s)
        except BaseException:
            self._abandon()
            raise

    def _hello(self, wanted: dict[str, Any], timeout_s: float) -> None:
        reply, _, _ = self._request(Type.HELLO, [json.dumps(wanted).encode()], timeout_s=timeout_s)
        try:
            about = json.loads(reply[0])
            self.game = str(about["game"])
            self.renderer_description = str(about["renderer_description"])
            shape = (int(about["height"]), int(about["width"]), 4)
            name = about["shared_memory"]
        except (IndexError, KeyError, TypeError, ValueError) as error:
            raise self._malformed(f"hello: {error!r}") from error
        if shape != self.shape:
            raise self._malformed(f"hello: images of {shape}, expected {self.shape}")
        if name and not self._map(str(name)):
            self._hello(wanted | {"shared_memory": False}, timeout_s)

    def _map(self, name: str) -> bool:
        """Maps the server's shared memory; False where it cannot be reached from here."""
        size = self.apps * int(np.prod(self.shape))
        try:
            descriptor = os.open(f"/dev/shm/{name.lstrip('/')}", os.O_RDONLY)
        except OSError:
            return False
        try:
            if os.fstat(descriptor).st_size < size:
                return False
            memory = mmap.mmap(descriptor, size, prot=mmap.PROT_READ)
        finally:
            os.close(descriptor)
        self._shared = np.frombuffer(memory, np.uint8).reshape(self.apps, *self.shape)
        self.images = list(self._shared)
        return True

    # --- rounds ------------------------------------------------------------------------------

    def reset(
        self,
        app: int,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
        time_ns: int,
    ) -> AppReply:
        """Starts a round of one app; see :class:`AppClient`."""
        record = RESET_RECORD.pack(app, seed, time_ns, tracked_devices(poses), 0)
        body = [record + pose_rows(poses).tobytes(), json.dumps([dict(options or {})]).encode()]
        self._settle()
        frames, count, flags = self._request(Type.RESET, body, count=1)
        self._take_results(frames, count, flags, [app])
        return self._result(app)

    def start_step(self, app: int, times_ns: Int64Array, tracked: int, rows: Float64Array) -> None:
        """Queues one app's frames; sends the batch when it is complete.

        Args:
            app: index of the app.
            times_ns: (K,) game times.
            tracked: bits of the tracked devices.
            rows: (K, 3, 7) poses.
        """
        if app in self._queued or app in self._sent or app in self._results:
            raise AppError("start_step: the step before has not been finished")
        frames = np.zeros(len(times_ns), FRAME_DTYPE)
        frames["time_ns"] = times_ns
        frames["tracked"] = tracked
        frames["poses"] = rows
        self._queued[app] = frames
        if len(self._queued) == self._open_apps:
            self._flush()

    def finish_step(self, app: int) -> AppReply:
        """The reply to one app's frames; waits for the batch's."""
        if app in self._queued:
            self._flush()
        if app in self._sent:
            self._settle()
        return self._result(app)

    def _flush(self) -> None:
        """Sends the queued frames; what goes wrong is raised by each app's :meth:`finish_step`."""
        self._settle()
        apps = list(self._queued)
        counts = b"".join(STEP_RECORD.pack(app, len(self._queued[app])) for app in apps)
        frames = b"".join(self._queued[app].tobytes() for app in apps)
        self._queued.clear()
        try:
            self._send(Type.STEP, [counts, frames], count=len(apps))
            self._sent = apps
        except AppError as error:
            self._results |= dict.fromkeys(apps, error)

    def _settle(self) -> None:
        """Takes the replies of frames on their way, so that another request can be sent."""
        if self._sent:
            apps, self._sent = self._sent, []
            try:
                frames, count, flags = self._receive(Type.STEP)
                self._take_results(frames, count, flags, apps)
            except (AppError, AppRefused) as error:
                self._results |= dict.fromkeys(apps, error)

    def _result(self, app: int) -> AppReply:
        result = self._results.pop(app, None)
        if result is None:
            raise AppError("finish_step: no step was started; call start_step first")
        if isinstance(result, Exception):
            raise result
        return result

    def _take_results(
        self, frames: Sequence[bytes], count: int, flags: int, apps: Sequence[int]
    ) -> None:
        try:
            records = np.frombuffer(frames[0], RESULT_DTYPE)
            values = np.frombuffer(frames[1], "<f8").tolist()
            if frames[2]:
                new = json.loads(frames[2])
                self._names |= {int(number): list(names) for number, names in new.items()}
            if count != len(apps) or records["app"].tolist() != list(apps):
                raise ValueError(f"records of apps {records['app'].tolist()}, expected {apps}")
            errors = json.loads(frames[4]) if frames[4] else []
            self._take_images(frames[3], flags, apps)
            at = 0
            for record in records.tolist():
                app, finished, reward, time_feature, status, log_count, names, _ = record
                numbers = values[at : at + log_count]
                log = dict(zip(self._names[names], numbers, strict=True)) if log_count else {}
                at += log_count
                if status == Status.OK:
                    self._results[app] = AppReply(reward, bool(finished), time_feature, log)
                else:
                    self._results[app] = _error(status, str(errors.pop(0)))
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise self._malformed(f"a reply to frames: {error!r}") from error

    def _take_images(self, data: bytes, flags: int, apps: Sequence[int]) -> None:
        if flags & IN_SHARED_MEMORY:
            if self._shared is None:
                raise ValueError("images in shared memory that was not asked for")
            return
        images = np.frombuffer(data, np.uint8).reshape(len(apps), *self.shape)
        for app, image in zip(apps, images, strict=True):
            self.images[app] = image

    # --- state and views ---------------------------------------------------------------------

    def render(self, app: int, view: str, width: int, height: int) -> UInt8Array:
        """A view of one app's last frame, (height, width, 4)."""
        wanted = {"app": app, "view": view, "width": width, "height": height}
        data = self._ask(Type.RENDER, [json.dumps(wanted).encode()])
        try:
            return np.frombuffer(data, np.uint8).reshape(height, width, 4)
        except ValueError as error:
            raise self._malformed(f"a view: {error}") from error

    def save(self, app: int) -> bytes:
        """The state of one app."""
        return self._ask(Type.SAVE, [_APP.pack(app)])

    def load(self, app: int, state: bytes) -> None:
        """Brings one app to a saved state."""
        image = self._ask(Type.LOAD, [_APP.pack(app), state])
        if self._shared is None:
            try:
                self.images[app] = np.frombuffer(image, np.uint8).reshape(self.shape)
            except ValueError as error:
                raise self._malformed(f"an image: {error}") from error

    def state_hash(self, app: int) -> int:
        """The hash of one app's state."""
        data = self._ask(Type.HASH, [_APP.pack(app)])
        if len(data) != _HASH.size:
            raise self._malformed(f"a hash of {len(data)} bytes, expected {_HASH.size}")
        return int(_HASH.unpack(data)[0])

    def _ask(self, kind: Type, body: Sequence[bytes]) -> bytes:
        self._settle()
        frames, _, _ = self._request(kind, body)
        return frames[0] if frames else b""

    # --- messages ----------------------------------------------------------------------------

    def _request(
        self,
        kind: Type,
        body: Sequence[bytes],
        *,
        count: int = 0,
        timeout_s: float | None = None,
    ) -> tuple[list[bytes], int, int]:
        self._send(kind, body, count)
        return self._receive(kind, timeout_s)

    def _send(self, kind: Type, body: Sequence[bytes], count: int = 0) -> None:
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        header = HEADER.pack(MAGIC, VERSION, kind, self._sequence, count, 0, 0)
        self.channel.send([header, *body], _DOING[kind])

    def _receive(self, kind: Type, timeout_s: float | None = None) -> tuple[list[bytes], int, int]:
        """The frames after the header, count and flags; raises the server's errors."""
        frames = self.channel.receive(_DOING[kind], timeout_s)
        if len(frames[0]) != HEADER.size or frames[0][:4] != MAGIC:
            raise self._malformed(
                f"{frames[0][:40]!r}, expected a header of protocol 2 (an app that only speaks "
                "protocol 1 is used with --protocol 1)"
            )
        _, version, type_, sequence, count, status, flags = HEADER.unpack(frames[0])
        if status != Status.OK:
            text = frames[1].decode(errors="replace") if len(frames) > 1 else f"status {status}"
            raise _error(status, text)
        if version != VERSION or type_ != kind | REPLY or sequence != self._sequence:
            raise self._malformed(
                f"version {version}, type {type_:#x}, sequence {sequence}; expected "
                f"{VERSION}, {kind | REPLY:#x}, {self._sequence}"
            )
        return frames[1:], count, flags

    def _malformed(self, what: str) -> Exception:
        return self.channel.give_up(
            ProtocolError(f"{self.channel.app} answered with another thing: {what}")
        )

    # --- the end -----------------------------------------------------------------------------

    def app(self, index: int) -> Protocol2App:
        """The client of app ``index``, from 0 to N - 1; each can be taken once."""
        if index in self.taken:
            raise ValueError(f"index: got {index}, which is taken, expected another app")
        self.taken.add(index)
        return Protocol2App(self, index)

    @property
    def usable(self) -> bool:
        """Whether the session goes on."""
        return self.channel.failure is None

    def release(self) -> None:
        """One app is no longer needed; the last one ends the session."""
        self._open_apps -= 1
        if self._open_apps <= 0 or not self.usable:
            self.close()

    def close(self) -> None:
        """Ends the session and the process that the server runs in; idempotent."""
        if self.channel.usable:
            with suppress(AppError, AppRefused):
                self._request(Type.QUIT, [], timeout_s=QUIT_S)
            self.channel.close()
            if self.channel.process is not None:
                self.channel.process.stop()
        self._abandon()

    def _abandon(self) -> None:
        self.channel.close()
        if self.channel.process is not None:
            self.channel.process.kill()


class Protocol2App:
    """:class:`~sim2vr_harness.client.base.AppClient` for one app of a connection.

    Args:
        connection: shared with the connection's other apps.
        index: which of them, from 0.
    """

    def __init__(self, connection: Protocol2Connection, index: int = 0) -> None:
        if not 0 <= index < connection.apps:
            raise ValueError(f"index: got {index}, expected 0 to {connection.apps - 1}")
        self._connection: Protocol2Connection | None = connection
        self._index = index
        self._last_image: UInt8Array | None = None

    def _open(self) -> Protocol2Connection:
        if self._connection is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._connection

    @property
    def renderer_description(self) -> str:
        """See :class:`AppClient`."""
        connection = self._open()
        return f"{connection.renderer_description} (protocol 2, {connection.channel.app})"

    @property
    def capabilities(self) -> frozenset[str]:
        """See :class:`AppClient`."""
        return _CAPABILITIES

    @property
    def image(self) -> UInt8Array:
        """See :class:`AppClient`; read-only, in shared memory where the connection has it."""
        return self._open().images[self._index]

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """See :class:`AppClient`."""
        if not 0 <= seed < 2**32:
            raise ValueError(f"seed: got {seed}, expected an integer from 0 to 2**32 - 1")
        return self._open().reset(self._index, seed, poses, options, time_ns)

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        rows, times = pose_rows(poses), np.array([time_ns], dtype=np.int64)
        self._open().start_step(self._index, times, tracked_devices(poses), rows)
        return self.finish_step()

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        self.start_step(times_ns, poses)
        return self.finish_step()

    def start_step(self, times_ns: Int64Array, poses: DevicePoses, *, last: bool = False) -> None:
        """See :class:`AppClient`; the last app of the connection to start sends them all."""
        times = frame_times(times_ns)
        rows = pose_rows(poses, len(times))
        self._open().start_step(self._index, times, tracked_devices(poses), rows)

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`."""
        return self._open().finish_step(self._index)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        """See :class:`AppClient`."""
        return self._open().render(self._index, "headset", width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        """See :class:`AppClient`."""
        return self._open().render(self._index, view, width, height)

    def save(self) -> bytes:
        """See :class:`AppClient`."""
        return self._open().save(self._index)

    def load(self, state: bytes) -> None:
        """See :class:`AppClient`."""
        self._open().load(self._index, state)

    def state_hash(self) -> int:
        """See :class:`AppClient`."""
        return self._open().state_hash(self._index)

    def close(self) -> None:
        """See :class:`AppClient`; the last open app of a connection ends the session."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.release()

    def __enter__(self) -> Protocol2App:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _error(status: int, text: str) -> Exception:
    if status == Status.INVALID_ARGUMENT:
        return AppRefused(text)
    if status in (Status.MALFORMED, Status.VERSION):
        return ProtocolError(text)
    return AppError(text)
