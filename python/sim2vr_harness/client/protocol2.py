"""Protocol 2: binary messages, several apps in one, images raw or in shared memory.

app_runtime/server/protocol2.md describes every byte.
"""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, TypeAdapter

from sim2vr_harness.base.paths import uri_unless_utf8
from sim2vr_harness.client.answers import (
    PITCH,
    UNREADABLE,
    BadReply,
    Number,
    Place,
    Rotation,
    json_in,
    read,
)
from sim2vr_harness.client.base import (
    CAPABILITIES,
    AppClient,
    AppReply,
    ClockSettings,
    Float32Array,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
    numbers_of_log,
    plain_options,
)
from sim2vr_harness.client.channel import Channel, checked_duration_s
from sim2vr_harness.client.devices import (
    HANDS,
    INPUT_COUNT,
    DevicePoses,
    HapticPulse,
    SoundEvent,
)
from sim2vr_harness.client.errors import AppError, AppRefused, AppUnsupported, ProtocolError
from sim2vr_harness.client.poses import (
    frame_times,
    input_rows,
    pose_rows,
    require_devices,
    tracked_devices,
)
from sim2vr_harness.client.runtime import checked_seed
from sim2vr_harness.client.scene import AppScene, Observer, SceneMesh, SceneObject
from sim2vr_harness.client.shared_images import map_images

# --- bytes ---------------------------------------------------------------------------------------

MAGIC = b"S2VR"
VERSION = 3
"""Of the messages."""
HEADER = struct.Struct("<4sHHIIII")
"""Magic, version, type, sequence, count of records, status, flags."""
REPLY = 0x8000
IN_SHARED_MEMORY = 1
APP = struct.Struct("<I")
HASH = struct.Struct("<Q")
STEP_RECORD = struct.Struct("<IIiI")
"""App, number of frames, which one is drawn (-1: the last), 0."""

_DEVICES = [
    ("tracked", "<u4"),
    ("pad", "<u4"),
    ("poses", "<f8", (3, 7)),
    ("inputs", "<f8", (2, INPUT_COUNT)),
]
RESET_DTYPE = np.dtype([("app", "<u4"), ("seed", "<u4"), ("time_ns", "<i8"), *_DEVICES])
FRAME_DTYPE = np.dtype([("time_ns", "<i8"), *_DEVICES])
RESULT_DTYPE = np.dtype(
    [
        ("app", "<u4"),
        ("finished", "<u4"),
        ("reward", "<f4"),
        ("time_feature", "<f4"),
        ("status", "<u4"),
        ("log_count", "<u4"),
        ("log_names", "<u4"),
        ("haptic_count", "<u4"),
        ("sound_count", "<u4"),
        ("pad", "<u4"),
    ]
)
HAPTIC_DTYPE = np.dtype(
    [
        ("hand", "<u4"),
        ("amplitude", "<f4"),
        ("frequency_hz", "<f4"),
        ("pad", "<u4"),
        ("duration_ns", "<i8"),
    ]
)
SOUND_DTYPE = np.dtype([("name", "<u4"), ("gain", "<f4"), ("position_m", "<f8", (3,))])
RESULT_FRAMES = 7
"""Frames of the reply to a reset or step, after the header."""


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
    HEAD_REQUEST = 9
    SCENE = 10


class Status(IntEnum):
    """Result code of a request, or of one record of it."""

    OK = 0
    INVALID_ARGUMENT = 1
    STATE_ERROR = 2
    ENGINE_ERROR = 3
    MALFORMED = 4
    BUSY = 5
    VERSION = 6
    UNSUPPORTED = 7


def error_of(status: int, text: str) -> Exception:
    """Return the exception for a status that is not OK, with the server's words."""
    if status == Status.INVALID_ARGUMENT:
        return AppRefused(text)
    if status in (Status.MALFORMED, Status.VERSION):
        return ProtocolError(text)
    return AppUnsupported(text) if status == Status.UNSUPPORTED else AppError(text)


def reset_record(app: int, seed: int, time_ns: int, poses: DevicePoses) -> bytes:
    """Return the record that starts a round; ValueError for devices of another shape."""
    record = np.zeros(1, RESET_DTYPE)
    record["app"], record["seed"], record["time_ns"] = app, seed, time_ns
    record["tracked"] = tracked_devices(poses)
    record["poses"], record["inputs"] = pose_rows(poses), input_rows(poses)
    return record.tobytes()


def step_frames(times_ns: Int64Array, poses: DevicePoses) -> NDArray[Any]:
    """Return the frames of one app's step, (K,) FRAME_DTYPE.

    Args:
        times_ns: (K,) game times.
        poses: of K frames, (K, ...).

    Raises:
        ValueError: devices of another shape.
    """
    frames = np.zeros(len(times_ns), FRAME_DTYPE)
    frames["time_ns"] = times_ns
    frames["tracked"] = tracked_devices(poses)
    frames["poses"] = pose_rows(poses, len(times_ns))
    if poses.left_inputs is not None or poses.right_inputs is not None:
        frames["inputs"] = input_rows(poses, len(times_ns))
    return frames


# --- clients -------------------------------------------------------------------------------------

MAX_EDGE = 8192
_CLIENT = f"sim2vr-harness, Python {sys.version_info.major}.{sys.version_info.minor}"
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
        """Capabilities that the server has reported."""
        return self._open().capabilities

    @property
    def image(self) -> UInt8Array:
        """Headset image, read-only; in shared memory if the connection has it."""
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
        """Queue a step; the last app of the connection to start sends the steps of all."""
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
            return read("a head request", PITCH, text).pitch_deg

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

    def _render_from(self, observer: Observer) -> tuple[UInt8Array, Float32Array]:
        width, height = observer.width, observer.height
        wanted = {"app": self._index, "width": width, "height": height}
        assert observer.pose is not None
        place = np.array([*observer.pose, observer.vertical_fov_deg], "<f8").tobytes()
        data = self._ask(Type.RENDER, json.dumps(wanted).encode(), place)
        with self._reading("a view"):
            rgba = np.frombuffer(data, np.uint8, 4 * width * height).reshape(height, width, 4)
            depth_m = np.frombuffer(data, "<f4", offset=rgba.size).reshape(height, width)
            return rgba, depth_m

    def scene(self) -> AppScene:
        """Return the scene of the last frame; the server sends each mesh only once."""
        self.require("scene")
        wanted = {"app": self._index, "meshes": len(self._meshes)}
        frames = self._open().ask(Type.SCENE, json.dumps(wanted).encode())
        with self._reading("a scene"):
            return decode_scene(frames, self._meshes)

    def save(self) -> bytes:
        self.require("save")
        return self._ask(Type.SAVE, APP.pack(self._index))

    def load(self, state: bytes) -> None:
        self.require("save")
        image = self._ask(Type.LOAD, APP.pack(self._index), state)
        connection = self._open()
        if not connection.in_shared_memory:
            with self._reading("an image"):
                pixels = np.frombuffer(image, np.uint8)
                connection.images[self._index] = pixels.reshape(connection.shape)

    def state_hash(self) -> int:
        self.require("save")
        data = self._ask(Type.HASH, APP.pack(self._index))
        with self._reading("a hash"):
            (value,) = HASH.unpack(data)
            return int(value)

    def _ask(self, kind: Type, *body: bytes) -> bytes:
        frames = self._open().ask(kind, *body)
        return frames[0] if frames else b""

    @contextmanager
    def _reading(self, what: str) -> Iterator[None]:
        try:
            yield
        except (struct.error, *UNREADABLE) as error:
            raise self._open().unreadable(what, error) from error

    def close(self) -> None:
        """Close the app; the last open app of a connection ends the session."""
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
        game: its name; None takes the server's.
        width, height: of the headset image, pixels.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``.
        log_dir: root of the apps' episode logs, or None.
        clock: fixed step and tolerances of the apps' clocks.
        ipd_m: distance between the pupils, metres; None takes the server's.
        shared_memory: whether to read images from memory shared with a server on this machine.
        start_timeout_s: how long the server may take to start and to make the apps.

    Attributes:
        facts: what the game publishes (app_runtime/server/protocol2.md, hello), or None.
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
            channel.abandon()
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
            "capabilities": sorted(CAPABILITIES.keys() - {"fovea"}),
            "shared_memory": shared_memory,
        }
        try:
            checked_duration_s("start_timeout_s", start_timeout_s)
            self._hello({k: v for k, v in wanted.items() if v is not None}, start_timeout_s)
        except BaseException:
            channel.abandon()
            raise

    def _hello(self, wanted: dict[str, Any], timeout_s: float) -> None:
        reply, _ = self._request(Type.HELLO, [json.dumps(wanted).encode()], timeout_s=timeout_s)
        try:
            about = read("hello", _HELLO, reply[0])
        except UNREADABLE as error:
            raise self.unreadable("hello", error) from error
        self.game, self.facts = about.game, about.facts
        self.capabilities = frozenset(about.capabilities) & CAPABILITIES.keys()
        self.renderer_description = about.renderer_description
        size = (about.height, about.width, 4)
        shape = size if about.eyes == 1 else (about.eyes, *size)
        if shape != self.shape:
            raise self.channel.malformed(f"hello: images of {shape}, expected {self.shape}")
        if about.shared_memory is None:
            return
        place = about.shared_memory
        self._shared = map_images(place.path, place.link, (self.apps, *self.shape))
        if self._shared is None:  # cannot be reached from here
            self._hello(wanted | {"shared_memory": False}, timeout_s)
        else:
            self.images = list(self._shared)

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
        record = reset_record(app, seed, time_ns, poses)
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
        self._queued[app] = step_frames(times_ns, poses), drawn
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
            STEP_RECORD.pack(app, len(frames), drawn, 0)
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
            if not flags & IN_SHARED_MEMORY:
                images = np.frombuffer(results.images, np.uint8).reshape(len(apps), *self.shape)
                for app, image in zip(apps, images, strict=True):
                    self.images[app] = image
            elif self._shared is None:
                raise ValueError("images in shared memory that was not requested")
        except UNREADABLE as error:
            raise self.unreadable("a reply to frames", error) from error
        self._results |= results.replies

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
            raise self.channel.malformed(
                f"{frames[0][:40]!r}, expected a header of protocol 2 (an app that only speaks "
                "protocol 1 is used with --protocol 1)"
            )
        _, version, type_, sequence, _, status, flags = HEADER.unpack(frames[0])
        if version != VERSION:
            raise self.channel.malformed(
                f"messages of version {version} of protocol 2, expected {VERSION}: take app and "
                "harness from the same release"
            )
        if status >= len(Status):
            raise self.channel.malformed(f"status {status}, expected 0 to {len(Status) - 1}")
        if status != Status.OK:
            text = frames[1].decode(errors="replace") if len(frames) > 1 else f"status {status}"
            raise error_of(status, text)
        if type_ != kind | REPLY or sequence != self._sequence:
            raise self.channel.malformed(
                f"type {type_:#x}, sequence {sequence}; expected {kind | REPLY:#x}, "
                f"{self._sequence}"
            )
        return frames[1:], flags

    def unreadable(self, what: str, error: Exception) -> Exception:
        """Give up because of an answer that was none: of the error that reading it raised."""
        words = str(error) if isinstance(error, BadReply) else f"{what}: {error!r}"
        return self.channel.malformed(words)

    # --- the end -----------------------------------------------------------------------------

    def app(self, index: int) -> Protocol2App:
        """The client of app ``index``, from 0 to N - 1; each can be taken once."""
        if index in self.taken:
            raise ValueError(f"index: got {index}, which is taken, expected another app")
        self.taken.add(index)
        return Protocol2App(self, index)

    @property
    def in_shared_memory(self) -> bool:
        """True if the server draws into the shared memory of :attr:`images`."""
        return self._shared is not None

    @property
    def usable(self) -> bool:
        """True if the session continues."""
        return self.channel.failure is None

    def release(self) -> None:
        """One app is no longer needed; the last one ends the session."""
        self._open_apps -= 1
        if self._open_apps <= 0 or not self.usable:
            self.close()

    def close(self) -> None:
        """Ends the session and the process that the server runs in; idempotent."""
        header = HEADER.pack(MAGIC, VERSION, Type.QUIT, self._sequence + 1 & 0xFFFFFFFF, 0, 0, 0)
        self.channel.end([header])


# --- replies -------------------------------------------------------------------------------------


@dataclass
class Names:
    """Names of the numbered logs and sounds in the replies, as far as they were received."""

    logs: dict[int, list[str]] = field(default_factory=dict)
    sounds: dict[int, str] = field(default_factory=dict)

    def add(self, text: bytes) -> None:
        """Take the frame with the new ones."""
        if text:
            new = read("names", _NAMES, text)
            self.logs |= new.logs
            self.sounds |= new.sounds


@dataclass(frozen=True)
class StepResults:
    """The reply to a reset or step.

    Attributes:
        replies: of each app of the message, or why its record was refused.
        images: bytes of their images; none when they are in shared memory.
    """

    replies: dict[int, AppReply | Exception]
    images: bytes

    @classmethod
    def decode(cls, frames: Sequence[bytes], apps: Sequence[int], names: Names) -> StepResults:
        """Read the frames after the header.

        Args:
            frames: of the message.
            apps: whose records were sent, in order.
            names: the session's; those that are new are added.

        Raises:
            Exception: one of ``UNREADABLE``; it is no such reply.
        """
        if len(frames) != RESULT_FRAMES:
            raise ValueError(f"{len(frames)} frames after the header, expected {RESULT_FRAMES}")
        records, values, new_names, images, errors, haptics, sounds = frames
        names.add(new_names)
        rows = np.frombuffer(records, RESULT_DTYPE)
        if rows["app"].tolist() != list(apps):
            raise ValueError(f"records of apps {rows['app'].tolist()}, expected {list(apps)}")
        if not (np.isfinite(rows["reward"]).all() and np.isfinite(rows["time_feature"]).all()):
            raise ValueError("a reward or time feature that is not finite")
        texts = iter(json_in("errors", errors) if errors else [])
        numbers = np.frombuffer(values, "<f8").tolist()
        pulses, heard = _pulses(haptics), _sounds(sounds, names)
        at = pulse = sound = 0
        replies: dict[int, AppReply | Exception] = {}
        for row in rows.tolist():
            app, finished, reward, time_feature, status, log_count, log_names, p, s, _ = row
            log = numbers[at : at + log_count]
            at, pulse, sound = at + log_count, pulse + p, sound + s
            if status >= len(Status):
                raise ValueError(f"status {status}, expected 0 to {len(Status) - 1}")
            if status == Status.OK:
                replies[app] = AppReply(
                    reward,
                    bool(finished),
                    time_feature,
                    numbers_of_log(names.logs[log_names], log) if log_count else {},
                    pulses[pulse - p : pulse],
                    heard[sound - s : sound],
                )
            else:
                replies[app] = error_of(status, str(next(texts, "no reason given")))
        if (at, pulse, sound) != (len(numbers), len(pulses), len(heard)):
            raise ValueError("log values or events of another number than the records say")
        return cls(replies, images)


def _pulses(frame: bytes) -> tuple[HapticPulse, ...]:
    rows = np.frombuffer(frame, HAPTIC_DTYPE)
    if not (np.isfinite(rows["amplitude"]).all() and np.isfinite(rows["frequency_hz"]).all()):
        raise ValueError("a vibration whose amplitude or frequency is not finite")
    return tuple(
        HapticPulse(HANDS[hand], amplitude, frequency_hz, duration_ns * 1e-9)
        for hand, amplitude, frequency_hz, _, duration_ns in rows.tolist()
    )


def _sounds(frame: bytes, names: Names) -> tuple[SoundEvent, ...]:
    rows = np.frombuffer(frame, SOUND_DTYPE)
    if not (np.isfinite(rows["gain"]).all() and np.isfinite(rows["position_m"]).all()):
        raise ValueError("a sound whose gain or place is not finite")
    return tuple(
        SoundEvent(names.sounds[name], tuple(place.tolist()), gain)
        for name, gain, place in rows.tolist()
    )


def decode_scene(frames: Sequence[bytes], meshes: list[SceneMesh]) -> AppScene:
    """Read the reply to a question for an app's scene.

    Args:
        frames: of the message, after the header.
        meshes: known of the app; those that are new are added.

    Raises:
        Exception: one of ``UNREADABLE``; it is no such reply.
    """
    told, numbers = read("a scene", _SCENE, frames[0]), frames[1]
    at, new = 0, []
    for mesh in told.meshes:
        vertices = np.frombuffer(numbers, "<f4", 3 * mesh.vertices, at).reshape(-1, 3)
        at += vertices.nbytes
        faces = np.frombuffer(numbers, "<u4", 3 * mesh.triangles, at).reshape(-1, 3)
        at += faces.nbytes
        if mesh.triangles and faces.max() >= mesh.vertices:
            raise ValueError(f"a mesh whose triangles go past its {mesh.vertices} vertices")
        new.append(SceneMesh(mesh.name, vertices, faces.astype(np.int64)))
    known = [*meshes, *new]
    for one in told.objects:
        if one.mesh >= len(known):
            raise ValueError(f"mesh {one.mesh} of {len(known)}")
    meshes += new
    objects = (
        SceneObject(
            one.id,
            one.path,
            one.layer,
            None if one.mesh < 0 else one.mesh,
            np.array(one.pose),
            np.array(one.scale),
            np.array(one.color, np.float32),
            one.unlit,
        )
        for one in told.objects
    )
    return AppScene(tuple(objects), tuple(known))


# --- JSON in replies -----------------------------------------------------------------------------


class _Memory(BaseModel):
    path: str
    link: str


class _Hello(BaseModel):
    game: str
    facts: dict[str, Any] | None
    capabilities: list[str]
    renderer_description: str
    width: int
    height: int
    eyes: int
    shared_memory: _Memory | None


class _Names(BaseModel):
    logs: dict[int, list[str]]
    sounds: dict[int, str]


class _Mesh(BaseModel):
    name: str
    vertices: Annotated[int, Field(ge=0)]
    triangles: Annotated[int, Field(ge=0)]


class _Object(BaseModel):
    id: int
    path: str
    layer: int
    mesh: int
    pose: Annotated[tuple[Number, ...], Field(min_length=7, max_length=7)]
    scale: Place
    color: Rotation
    unlit: bool


class _Scene(BaseModel):
    meshes: list[_Mesh]
    objects: list[_Object]


_HELLO, _NAMES, _SCENE = TypeAdapter(_Hello), TypeAdapter(_Names), TypeAdapter(_Scene)
