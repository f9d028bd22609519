"""The bytes of protocol 2's messages; docs/reference/protocol.md describes every one."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.answers import json_in, object_in
from sim2vr_harness.client.base import AppReply, Int64Array, numbers_of_log
from sim2vr_harness.client.devices import (
    HANDS,
    INPUT_COUNT,
    DevicePoses,
    HapticPulse,
    SoundEvent,
)
from sim2vr_harness.client.errors import AppError, AppRefused, AppUnsupported, ProtocolError
from sim2vr_harness.client.poses import input_rows, pose_rows, tracked_devices
from sim2vr_harness.client.scene import AppScene, SceneMesh, SceneObject

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
    """How a request, or one record of it, went."""

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


@dataclass
class Names:
    """What the numbers of log names and sounds in the replies mean, as far as they were told."""

    logs: dict[int, list[str]] = field(default_factory=dict)
    sounds: dict[int, str] = field(default_factory=dict)

    def add(self, text: bytes) -> None:
        """Take the frame with the new ones."""
        if text:
            new = object_in("names", text)
            self.logs |= {int(number): list(names) for number, names in new["logs"].items()}
            self.sounds |= {int(number): str(name) for number, name in new["sounds"].items()}


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
    if not frame:
        return ()
    rows = np.frombuffer(frame, HAPTIC_DTYPE)
    if not (np.isfinite(rows["amplitude"]).all() and np.isfinite(rows["frequency_hz"]).all()):
        raise ValueError("a vibration whose amplitude or frequency is not finite")
    return tuple(
        HapticPulse(HANDS[hand], amplitude, frequency_hz, duration_ns * 1e-9)
        for hand, amplitude, frequency_hz, _, duration_ns in rows.tolist()
    )


def _sounds(frame: bytes, names: Names) -> tuple[SoundEvent, ...]:
    if not frame:
        return ()
    rows = np.frombuffer(frame, SOUND_DTYPE)
    if not (np.isfinite(rows["gain"]).all() and np.isfinite(rows["position_m"]).all()):
        raise ValueError("a sound whose gain or place is not finite")
    places = rows["position_m"].tolist()
    return tuple(
        SoundEvent(names.sounds[name], (x, y, z), gain)
        for name, gain, (x, y, z) in zip(
            rows["name"].tolist(), rows["gain"].tolist(), places, strict=True
        )
    )


def decode_scene(frames: Sequence[bytes], meshes: list[SceneMesh]) -> AppScene:
    """Read the reply to a question for an app's scene.

    Args:
        frames: of the message, after the header.
        meshes: known of the app; those that are new are added.

    Raises:
        Exception: one of ``UNREADABLE``; it is no such reply.
    """
    told, numbers = object_in("a scene", frames[0]), frames[1]
    at, new = 0, []
    for mesh in told["meshes"]:
        corners, triangles = int(mesh["vertices"]), int(mesh["triangles"])
        vertices = np.frombuffer(numbers, "<f4", 3 * corners, at).reshape(-1, 3)
        at += vertices.nbytes
        faces = np.frombuffer(numbers, "<u4", 3 * triangles, at).reshape(-1, 3)
        at += faces.nbytes
        if triangles and faces.max() >= corners:
            raise ValueError(f"a mesh whose triangles go past its {corners} vertices")
        new.append(SceneMesh(str(mesh["name"]), vertices, faces.astype(np.int64)))
    known = [*meshes, *new]
    objects = tuple(_scene_object(one, len(known)) for one in told["objects"])
    meshes += new
    return AppScene(objects, tuple(meshes))


def _scene_object(told: dict[str, Any], meshes: int) -> SceneObject:
    number = int(told["mesh"])
    if number >= meshes:
        raise ValueError(f"mesh {number} of {meshes}")
    rows = {"pose": 7, "scale": 3, "color": 4}
    arrays = {name: np.array(told[name], dtype=np.float64) for name in rows}
    for name, length in rows.items():
        if arrays[name].shape != (length,) or not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} {told[name]}, expected {length} numbers")
    return SceneObject(
        int(told["id"]),
        str(told["path"]),
        int(told["layer"]),
        None if number < 0 else number,
        arrays["pose"],
        arrays["scale"],
        arrays["color"].astype(np.float32),
        bool(told["unlit"]),
    )
