"""Protocol 2: binary messages, several apps in one, images raw or in shared memory.

docs/reference/protocol.md describes every byte.
"""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.paths import uri_unless_utf8
from sim2vr_harness.client import protocol2_wire as wire
from sim2vr_harness.client.answers import UNREADABLE, number_in, object_in
from sim2vr_harness.client.base import (
    CAPABILITIES,
    AppClient,
    AppReply,
    ClockSettings,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
    plain_options,
)
from sim2vr_harness.client.channel import Channel, checked_duration_s
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import AppError, AppRefused, ProtocolError
from sim2vr_harness.client.poses import frame_times, require_devices
from sim2vr_harness.client.protocol2_wire import (
    HEADER,
    IN_SHARED_MEMORY,
    MAGIC,
    REPLY,
    VERSION,
    Names,
    Status,
    StepResults,
    Type,
    error_of,
)
from sim2vr_harness.client.runtime import checked_seed
from sim2vr_harness.client.scene import AppScene, SceneMesh
from sim2vr_harness.client.shared_images import map_images

MAX_EDGE = 8192
_CLIENT = f"sim2vr-harness, Python {sys.version_info.major}.{sys.version_info.minor}"
QUIT_S = 2.0
"""How long the server may take to acknowledge the end of the session."""

_DOING = {
    Type.HELLO: "the hello",
    Type.RESET: "a reset",
    Type.STEP: "a step",
    Type.RENDER: "drawing",
    Type.SAVE: "saving",
    Type.LOAD: "loading",
    Type.HASH: "the hash",
    Type.QUIT: "the end",
    Type.HEAD_REQUEST: "the head's pitch",
    Type.SCENE: "its scene",
}


class Protocol2App(AppClient):
    """One app of a connection.

    Args:
        connection: shared with the connection's other apps.
        index: which of them, from 0.
    """

    def __init__(self, connection: Protocol2Connection, index: int = 0) -> None:
        if not 0 <= index < connection.apps:
            raise ValueError(f"index: got {index}, expected 0 to {connection.apps - 1}")
        self._connection: Protocol2Connection | None = connection
        self._index = index
        self.kind = connection.channel.app
        self._meshes: list[SceneMesh] = []

    def _open(self) -> Protocol2Connection:
        if self._connection is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._connection

    @property
    def renderer_description(self) -> str:
        connection = self._open()
        return f"{connection.renderer_description} (protocol 2, {connection.channel.app})"

    @property
    def capabilities(self) -> frozenset[str]:
        """See :class:`AppClient`; as the server has said."""
        return self._open().capabilities

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
        checked_seed(seed)
        return self._open().reset(self._index, seed, poses, options, time_ns)

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """See :class:`AppClient`; the last app of the connection to start sends them all."""
        times = frame_times(times_ns)
        if len(times) > 1:
            self.require("frames")
        self._open().start_step(self._index, times, poses, drawn)

    def finish_step(self) -> AppReply:
        return self._open().finish_step(self._index)

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        self.require("head_request")
        wanted = {"app": self._index, "seed": seed, "options": plain_options(options)}
        text = self._ask(Type.HEAD_REQUEST, json.dumps(wanted).encode())
        with self._reading("a head request"):
            pitch_deg = object_in("a head request", text)["pitch_deg"]
            return None if pitch_deg is None else number_in("pitch_deg", pitch_deg)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        return self._render("headset", width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        return self._render(view, width, height)

    def _render(self, view: str, width: int, height: int) -> UInt8Array:
        self.require("views")
        wanted = {"app": self._index, "view": view, "width": width, "height": height}
        data = self._ask(Type.RENDER, json.dumps(wanted).encode())
        with self._reading("a view"):
            return np.frombuffer(data, np.uint8).reshape(height, width, 4)

    def scene(self) -> AppScene:
        """See :class:`AppClient`; meshes that the server has sent before do not come again."""
        self.require("scene")
        wanted = {"app": self._index, "meshes": len(self._meshes)}
        frames = self._open().ask(Type.SCENE, json.dumps(wanted).encode())
        with self._reading("a scene"):
            return wire.decode_scene(frames, self._meshes)

    def save(self) -> bytes:
        self.require("save")
        return self._ask(Type.SAVE, wire.APP.pack(self._index))

    def load(self, state: bytes) -> None:
        self.require("save")
        image = self._ask(Type.LOAD, wire.APP.pack(self._index), state)
        connection = self._open()
        if not connection.in_shared_memory:
            with self._reading("an image"):
                pixels = np.frombuffer(image, np.uint8)
                connection.images[self._index] = pixels.reshape(connection.shape)

    def state_hash(self) -> int:
        self.require("save")
        data = self._ask(Type.HASH, wire.APP.pack(self._index))
        with self._reading("a hash"):
            (value,) = wire.HASH.unpack(data)
            return int(value)

    def _ask(self, kind: Type, *body: bytes) -> bytes:
        frames = self._open().ask(kind, *body)
        return frames[0] if frames else b""

    @contextmanager
    def _reading(self, what: str) -> Iterator[None]:
        try:
            yield
        except (struct.error, *UNREADABLE) as error:
            raise self._open().malformed(f"{what}: {error!r}") from error

    def close(self) -> None:
        """See :class:`AppClient`; the last open app of a connection ends the session."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.release()


class Protocol2Connection:
    """A session with a server that plays N apps.

    The steps of several apps that were started before the first of them is finished travel in one
    message; it is sent as soon as every app of the connection has one, or else when the reply
    of the first is requested.

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
        eyes: 1, or 2 for a picture of each.
        ipd_m: distance between the pupils, metres; None takes the server's.
        shared_memory: whether to read images from memory shared with a server on this machine.
        start_timeout_s: how long the server may take to start and to make the apps.

    Attributes:
        game: its name.
        facts: what the game publishes (docs/reference/protocol.md, hello), or None.
        capabilities: of the apps, see :attr:`AppClient.capabilities`.
        images: of each app, (H, W, 4), with two eyes (2, H, W, 4).

    Raises:
        AppRefused: a setting that the server does not take.
        AppUnsupported: two eyes of an app that has one.
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
        eyes: int = 1,
        ipd_m: float | None = None,
        shared_memory: bool = True,
        start_timeout_s: float = 60.0,
    ) -> None:
        self.channel, self.apps = channel, apps
        self.shape = (height, width, 4) if eyes == 1 else (eyes, height, width, 4)
        if not (1 <= width <= MAX_EDGE and 1 <= height <= MAX_EDGE):
            self._abandon()
            raise ValueError(
                f"image size: got {width} x {height}, expected 1 to {MAX_EDGE} pixels each"
            )
        self._sequence, self._open_apps = 0, apps
        self._names = Names()
        self._queued: dict[int, tuple[NDArray[Any], int]] = {}
        self._sent: list[int] = []
        self._results: dict[int, AppReply | Exception] = {}
        self.taken: set[int] = set()
        self.images: list[UInt8Array] = [np.zeros(self.shape, np.uint8) for _ in range(apps)]
        self._shared: UInt8Array | None = None
        wanted = {
            "client": _CLIENT,
            "apps": apps,
            "game": game,
            "options": plain_options(options),
            "width": width,
            "height": height,
            "renderer": renderer,
            "log_dir": None if log_dir is None else uri_unless_utf8(str(log_dir)),
            **asdict(clock or ClockSettings()),
            "eyes": eyes,
            "ipd_m": ipd_m,
            "capabilities": sorted(CAPABILITIES),
            "shared_memory": shared_memory,
        }
        try:
            checked_duration_s("start_timeout_s", start_timeout_s)
            self._hello({k: v for k, v in wanted.items() if v is not None}, start_timeout_s)
        except BaseException:
            self._abandon()
            raise

    def _hello(self, wanted: dict[str, Any], timeout_s: float) -> None:
        reply, _ = self._request(Type.HELLO, [json.dumps(wanted).encode()], timeout_s=timeout_s)
        try:
            about = object_in("hello", reply[0])
            self.game = str(about["game"])
            self.facts: dict[str, Any] | None = about["facts"]
            self.capabilities = frozenset(map(str, about["capabilities"])) & CAPABILITIES.keys()
            self.renderer_description = str(about["renderer_description"])
            size = (int(about["height"]), int(about["width"]), 4)
            shape = size if about["eyes"] == 1 else (int(about["eyes"]), *size)
            memory = about["shared_memory"]
            place = None if memory is None else (str(memory["path"]), str(memory["link"]))
        except UNREADABLE as error:
            raise self.malformed(f"hello: {error!r}") from error
        if shape != self.shape:
            raise self.malformed(f"hello: images of {shape}, expected {self.shape}")
        if place is not None and not self._map(*place):
            self._hello(wanted | {"shared_memory": False}, timeout_s)

    def _map(self, path: str, link: str) -> bool:
        """Map the server's memory; False where it cannot be reached from here."""
        shared = map_images(path, link, (self.apps, *self.shape))
        if shared is None:
            return False
        self._shared = shared
        self.images = list(shared)
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
        require_devices(poses, self.capabilities, self.channel.app)
        record = wire.reset_record(app, seed, time_ns, poses)
        self._settle()
        frames, flags = self._request(
            Type.RESET, [record, json.dumps([plain_options(options)]).encode()], count=1
        )
        self._take_results(frames, flags, [app])
        return self._result(app)

    def start_step(self, app: int, times_ns: Int64Array, poses: DevicePoses, drawn: int) -> None:
        """Queue one app's frames; the batch is sent when it is complete.

        Args:
            app: index of the app.
            times_ns: (K,) game times.
            poses: of K frames, (K, ...).
            drawn: which of them is drawn; -1: the last.
        """
        if app in self._queued or app in self._sent or app in self._results:
            raise AppError("start_step: the step before has not been finished")
        require_devices(poses, self.capabilities, self.channel.app)
        self._queued[app] = wire.step_frames(times_ns, poses), drawn
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
        records = b"".join(
            wire.STEP_RECORD.pack(app, len(frames), drawn, 0)
            for app, (frames, drawn) in self._queued.items()
        )
        frames = b"".join(frames.tobytes() for frames, _ in self._queued.values())
        self._queued.clear()
        try:
            self._send(Type.STEP, [records, frames], count=len(apps))
            self._sent = apps
        except AppError as error:
            self._results |= dict.fromkeys(apps, error)

    def _settle(self) -> None:
        """Takes the replies of frames on their way, so that another request can be sent."""
        if self._sent:
            apps, self._sent = self._sent, []
            try:
                self._take_results(*self._receive(Type.STEP), apps)
            except (AppError, AppRefused) as error:
                self._results |= dict.fromkeys(apps, error)

    def _result(self, app: int) -> AppReply:
        result = self._results.pop(app, None)
        if result is None:
            raise AppError("finish_step: no step was started; call start_step first")
        if isinstance(result, Exception):
            raise result
        return result

    def _take_results(self, frames: Sequence[bytes], flags: int, apps: Sequence[int]) -> None:
        try:
            results = StepResults.decode(frames, apps, self._names)
            self._take_images(results.images, flags, apps)
        except UNREADABLE as error:
            raise self.malformed(f"a reply to frames: {error!r}") from error
        self._results |= results.replies

    def _take_images(self, data: bytes, flags: int, apps: Sequence[int]) -> None:
        if flags & IN_SHARED_MEMORY:
            if self._shared is None:
                raise ValueError("images in shared memory that was not requested")
            return
        images = np.frombuffer(data, np.uint8).reshape(len(apps), *self.shape)
        for app, image in zip(apps, images, strict=True):
            self.images[app] = image

    # --- messages ----------------------------------------------------------------------------

    def ask(self, kind: Type, *body: bytes) -> list[bytes]:
        """The frames of the answer to a request that moves nothing on."""
        self._settle()
        return self._request(kind, body)[0]

    def _request(
        self,
        kind: Type,
        body: Sequence[bytes],
        *,
        count: int = 0,
        timeout_s: float | None = None,
    ) -> tuple[list[bytes], int]:
        self._send(kind, body, count)
        return self._receive(kind, timeout_s)

    def _send(self, kind: Type, body: Sequence[bytes], count: int = 0) -> None:
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        header = HEADER.pack(MAGIC, VERSION, kind, self._sequence, count, 0, 0)
        self.channel.send([header, *body], _DOING[kind])

    def _receive(self, kind: Type, timeout_s: float | None = None) -> tuple[list[bytes], int]:
        """The frames after the header, and flags; raises the server's errors."""
        frames = self.channel.receive(_DOING[kind], timeout_s)
        if len(frames[0]) != HEADER.size or frames[0][:4] != MAGIC:
            raise self.malformed(
                f"{frames[0][:40]!r}, expected a header of protocol 2 (an app that only speaks "
                "protocol 1 is used with --protocol 1)"
            )
        _, version, type_, sequence, _, status, flags = HEADER.unpack(frames[0])
        if version != VERSION:
            raise self.malformed(
                f"messages of version {version} of protocol 2, expected {VERSION}: take app and "
                "harness from the same release"
            )
        if status >= len(Status):
            raise self.malformed(f"status {status}, expected 0 to {len(Status) - 1}")
        if status != Status.OK:
            text = frames[1].decode(errors="replace") if len(frames) > 1 else f"status {status}"
            raise error_of(status, text)
        if type_ != kind | REPLY or sequence != self._sequence:
            raise self.malformed(
                f"type {type_:#x}, sequence {sequence}; expected {kind | REPLY:#x}, "
                f"{self._sequence}"
            )
        return frames[1:], flags

    def malformed(self, what: str) -> Exception:
        """The error for an answer that cannot be read; the session ends."""
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
    def in_shared_memory(self) -> bool:
        """Whether the server draws where :attr:`images` are."""
        return self._shared is not None

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
