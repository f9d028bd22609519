"""Messages between harness and OpenXR runtime: lengths, kinds, frames and answers.

A message is its length (u32, of what follows), its kind (u8) and a body, little-endian.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from sim2vr_harness.client.answers import (
    BadReply,
    bad_reply,
    list_in,
    number_in,
    object_in,
    pulse_in,
    text_in,
    truth_in,
)
from sim2vr_harness.client.base import Float64Array, Int64Array
from sim2vr_harness.client.devices import INPUT_COUNT, HapticPulse

PROTOCOL = 2
MOST_BYTES = 1 << 20
"""Of a message, its kind included."""
MOST_EVENTS = 10_000
HEADER = struct.Struct("<IB")
_ANSWER = struct.Struct("<IBBI")
_FRAME = np.dtype(
    [
        ("time_ns", "<i8"),
        ("head", "<f8", 7),
        ("tracked", "u1", 2),
        ("controllers", "<f8", (2, 7)),
        ("inputs", "<f8", (2, INPUT_COUNT)),
    ]
)


class Kind(IntEnum):
    """What a message is."""

    HELLO = 1
    CONFIG = 2
    SESSION = 3
    ACCEPTED = 4
    STEP = 5
    ANSWER = 6
    QUIT = 7
    ENDED = 8
    ERROR = 9


@dataclass(frozen=True)
class About:
    """What a program says of itself in xrCreateInstance."""

    application: str
    engine: str
    extensions: tuple[str, ...]


@dataclass(frozen=True)
class SessionFacts:
    """What a program draws with; the memory of its images comes with the message.

    Attributes:
        graphics: ``egl``, ``opengl``, ``vulkan``, ``vulkan2`` or ``headless``.
        depth_layers: whether it enabled layers with depth.
    """

    graphics: str
    depth_layers: bool


@dataclass(frozen=True)
class StepAnswer:
    """What the frames of a step brought.

    Attributes:
        has_image: whether the shared memory has another image.
        has_depth: whether that has depth.
        layers: of the last frame.
        haptics: vibrations, in order.
        labels: of XR_EXT_debug_utils, in order.
        note: what the runtime has to say; "" for nothing.
    """

    has_image: bool
    has_depth: bool
    layers: int
    haptics: tuple[HapticPulse, ...] = ()
    labels: tuple[str, ...] = ()
    note: str = ""


def step_body(
    times_ns: Int64Array,
    rows: Float64Array,
    inputs: Float64Array,
    tracked: tuple[bool, bool],
    *,
    image: bool,
) -> bytes:
    """Return the body of a step.

    Args:
        times_ns: (K,) XrTime at which each frame is displayed.
        rows: (K, 3, 7) head, left, right; see :func:`~sim2vr_harness.client.poses.pose_rows`.
        inputs: (K, 2, INPUT_COUNT) left, right.
        tracked: left, right.
        image: whether the last frame's image is needed.
    """
    frames = np.zeros(len(times_ns), _FRAME)
    frames["time_ns"] = times_ns
    frames["head"], frames["controllers"] = rows[:, 0], rows[:, 1:]
    frames["tracked"], frames["inputs"] = tracked, inputs
    return struct.pack("<I", len(frames)) + frames.tobytes() + bytes([image])


def about_in(body: bytes) -> About:
    """Return what a hello says; raises :class:`BadReply`."""
    told = object_in("hello", body)
    if told.get("protocol") != PROTOCOL:
        raise bad_reply("hello, protocol", told.get("protocol"), f"{PROTOCOL}; rebuild the runtime")
    extensions = list_in("hello, extensions", told.get("extensions", []), 1000)
    return About(
        application=text_in("hello, application", told.get("application", "")),
        engine=text_in("hello, engine", told.get("engine", "")),
        extensions=tuple(text_in("hello, extensions", one) for one in extensions),
    )


def session_in(body: bytes) -> SessionFacts:
    """Return what a session says; raises :class:`BadReply`."""
    told = object_in("session", body)
    return SessionFacts(
        graphics=text_in("session, graphics", told.get("graphics")),
        depth_layers=truth_in("session, depth_layers", told.get("depth_layers")),
    )


def ended_in(body: bytes) -> tuple[str, str]:
    """Return call and reason of an end; raises :class:`BadReply`."""
    told = object_in("ended", body)
    return (
        text_in("ended, call", told.get("call", "")),
        text_in("ended, reason", told.get("reason", "")),
    )


def answer_in(body: bytes) -> StepAnswer:
    """Return the answer to a step; raises :class:`BadReply`."""
    if len(body) < _ANSWER.size:
        raise bad_reply("answer", f"{len(body)} bytes", f"at least {_ANSWER.size}")
    _, has_image, has_depth, length = _ANSWER.unpack_from(body)
    text = body[_ANSWER.size :]
    if len(text) != length:
        raise bad_reply("answer", f"{len(text)} bytes of JSON", f"{length}")
    told = object_in("answer", text)
    haptics, labels = [], []
    for event in list_in("answer, events", told.get("events", []), MOST_EVENTS):
        if not isinstance(event, dict):
            raise bad_reply("answer, events", event, "objects")
        if event.get("kind") == "haptic":
            haptics.append(_pulse_in(event))
        elif event.get("kind") == "label":
            labels.append(text_in("label", event.get("text")))
    return StepAnswer(
        has_image=bool(has_image),
        has_depth=bool(has_depth),
        layers=int(number_in("answer, layers", told.get("layers", 0), 1e6)),
        haptics=tuple(haptics),
        labels=tuple(labels),
        note=text_in("answer, note", told.get("note") or ""),
    )


def _pulse_in(event: dict[str, Any]) -> HapticPulse:
    duration_ns = number_in("haptics, duration in ns", event.get("duration_ns"))
    try:
        return pulse_in(
            event.get("hand"),
            event.get("amplitude"),
            duration_ns * 1e-9,
            event.get("frequency_hz", 0.0),
        )
    except OverflowError as error:
        raise BadReply(str(error)) from error
