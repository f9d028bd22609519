"""The conversation with the runtime inside a program: messages over a pair of sockets.

A message is its length (u32, of what follows), its kind (u8) and a body, little-endian. Nothing
waits for ever: the end of the process is seen at once, silence after a deadline, and after a
failure nothing more is asked.
"""

import os
import select
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, TypeAdapter

from sim2vr_harness.client.answers import (
    Amplitude,
    BadReply,
    Frequency,
    Number,
    Text,
    bad_reply,
    lasting,
    read,
)
from sim2vr_harness.client.base import Float64Array, Int64Array
from sim2vr_harness.client.devices import INPUT_COUNT, Hand, HapticPulse
from sim2vr_harness.client.errors import AppDied
from sim2vr_harness.client.process import AppProcess, Conversation

PROTOCOL = 2
MOST_BYTES = 1 << 20
"""Of a message, its kind included."""
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
    """Kind of a message."""

    HELLO = 1
    CONFIG = 2
    SESSION = 3
    ACCEPTED = 4
    STEP = 5
    ANSWER = 6
    QUIT = 7
    ENDED = 8
    ERROR = 9


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


def _ours(protocol: object) -> object:
    if protocol != PROTOCOL:
        raise ValueError(f"{PROTOCOL}; rebuild the runtime")
    return protocol


class _Told(BaseModel):
    """Message of a program or of the runtime in it; unknown keys are ignored."""

    model_config = ConfigDict(frozen=True)


class About(_Told):
    """Description that a program gives of itself in xrCreateInstance."""

    protocol: Annotated[Any, AfterValidator(_ours)]
    application: Text = ""
    engine: Text = ""


class SessionFacts(_Told):
    """Graphics of a program's session; the memory of its images comes with the message."""

    graphics: Text
    """``egl``, ``opengl``, ``vulkan``, ``vulkan2`` or ``headless``."""
    depth_layers: StrictBool
    """True if the program enabled layers with depth."""


class _Ended(_Told):
    call: Text = ""
    reason: Text = ""


class _Vibration(_Told):
    kind: Literal["haptic"]
    hand: Hand
    amplitude: Amplitude
    duration_s: Annotated[
        Number, AfterValidator(lambda time_ns: lasting(time_ns * 1e-9)), Field(alias="duration_ns")
    ]
    frequency_hz: Frequency = 0.0


class _Label(_Told):
    """Of XR_EXT_debug_utils."""

    kind: Literal["label"]
    text: Text


class _State(_Told):
    """Of the session, which the harness does not read."""

    kind: Literal["state"]


_Event = Annotated[_Vibration | _Label | _State, Field(discriminator="kind")]


class _Happened(_Told):
    events: Annotated[tuple[_Event, ...], Field(max_length=10_000)] = ()
    layers: int = 0


ABOUT, SESSION = TypeAdapter(About), TypeAdapter(SessionFacts)
_ENDED, _HAPPENED = TypeAdapter(_Ended), TypeAdapter(_Happened)


@dataclass(frozen=True)
class StepAnswer:
    """Result of the frames of a step.

    Attributes:
        has_image: true if the shared memory has a new image.
        has_depth: true if that image has depth.
        layers: number of layers of the last frame.
        haptics: vibrations, in order.
        labels: labels of XR_EXT_debug_utils, in order.
    """

    has_image: bool
    has_depth: bool
    layers: int
    haptics: tuple[HapticPulse, ...]
    labels: tuple[str, ...]


def answer_in(body: bytes) -> StepAnswer:
    """Return the answer to a step; raises :class:`BadReply`."""
    if len(body) < _ANSWER.size:
        raise bad_reply("answer", f"{len(body)} bytes", f"at least {_ANSWER.size}")
    _, has_image, has_depth, length = _ANSWER.unpack_from(body)
    text = body[_ANSWER.size :]
    if len(text) != length:
        raise bad_reply("answer", f"{len(text)} bytes of JSON", f"{length}")
    told = read("answer", _HAPPENED, text)
    return StepAnswer(
        bool(has_image),
        bool(has_depth),
        told.layers,
        tuple(
            HapticPulse(one.hand, one.amplitude, one.frequency_hz, one.duration_s)
            for one in told.events
            if isinstance(one, _Vibration)
        ),
        tuple(one.text for one in told.events if isinstance(one, _Label)),
    )


_FILE = struct.Struct("i")
_ROOM = socket.CMSG_LEN(_FILE.size)
"""For one descriptor with each message; the kernel closes those that find none."""
_ORDERLY = ("xrEndSession", "xrDestroySession", "xrDestroyInstance", "xrRequestExitSession")
"""Calls by which a program ends its session itself."""


class SessionEnded(Exception):
    """The program ended its session; the text says by which call."""


class Link(Conversation):
    """One conversation with a program.

    Args:
        process: of the program.
        end: this side's socket, owned by this object from now on.
    """

    process: AppProcess

    def __init__(self, process: AppProcess, end: socket.socket) -> None:
        super().__init__(process)
        self._socket = end
        end.settimeout(None)
        self._buffer = bytearray()
        self.file: int | None = None
        """Descriptor that came with the latest message that had one; closed with this object."""
        self._poll = select.poll()
        self._poll.register(end, select.POLLIN)
        if self._ended is not None:
            self._poll.register(self._ended, select.POLLIN)

    def send(self, kind: Kind, body: bytes = b"") -> None:
        """Send a message.

        Raises:
            AppDied: the conversation is over.
        """
        self.require_open()
        message = HEADER.pack(len(body) + 1, kind) + body
        try:
            self._socket.sendall(message)
        except OSError:  # its end is gone; receiving finds out why
            return

    def receive(
        self, doing: str, timeout_s: float, hint: str = "", *, deadline: float | None = None
    ) -> tuple[Kind, bytes]:
        """Wait for the next message.

        Args:
            doing: what is waited for, for messages.
            timeout_s: how long.
            hint: what to do if nothing comes.
            deadline: when that time is over, of the monotonic clock; None: it begins now.

        Raises:
            SessionEnded: the program ended its session in an orderly way.
            AppDied: the process ended, or the runtime gave up; names the call.
            AppTimeout: nothing came in time.
            ProtocolError: it is no message.
        """
        end = time.monotonic() + timeout_s if deadline is None else deadline
        while True:
            message = self.next_message(doing)
            left_s = end - time.monotonic()
            if message is not None and (left_s > 0.0 or deadline is None):
                return message
            if left_s <= 0.0:
                raise self.silent(doing, timeout_s, hint + self.process.log_words())
            self._poll.poll(min(left_s, 1.0) * 1000.0)

    def next_message(self, doing: str) -> tuple[Kind, bytes] | None:
        """Return a message that is there, None if there is none; raises as :meth:`receive`."""
        self.require_open()
        while (message := self._taken()) is None:
            got = b""
            try:
                got = self._read()
            except BlockingIOError:
                if self.process.running:
                    return None
                with suppress(OSError):  # what an ended process had still sent
                    got = self._read()
            except OSError:
                pass
            if not got:
                raise self.died(f"before its {doing}")
            self._buffer += got
        kind, body = message
        if kind != Kind.ENDED:
            return kind, body
        try:
            end = read("ended", _ENDED, body)
        except BadReply as error:
            raise self.malformed(error) from error
        if end.call in _ORDERLY:
            raise SessionEnded(end.call)
        named = end.call and end.call not in end.reason
        words = f"{end.call}: {end.reason}" if named else end.reason
        raise self.give_up(AppDied(f"{self.app}: {words}{self.process.log_words()}"))

    def _read(self) -> bytes:
        # Not socket.recv_fds: Python 3.11 ignores its flags, and it would wait.
        flags = socket.MSG_DONTWAIT | socket.MSG_CMSG_CLOEXEC
        got, control, *_ = self._socket.recvmsg(1 << 16, _ROOM, flags)
        for level, kind, data in control:
            if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
                self._close_file()
                (self.file,) = _FILE.unpack_from(data)
        return got

    def _close_file(self) -> None:
        if self.file is not None:
            os.close(self.file)
            self.file = None

    def _taken(self) -> tuple[Kind, bytes] | None:
        """The first message of the buffer, once it is whole."""
        if len(self._buffer) < HEADER.size:
            return None
        length, kind = HEADER.unpack_from(self._buffer)
        if not 1 <= length <= MOST_BYTES or kind not in Kind.__members__.values():
            raise self.malformed(
                f"got a message of kind {kind} with {length} bytes, expected a kind of this "
                f"version and at most {MOST_BYTES} bytes"
            )
        end = HEADER.size + length - 1
        if len(self._buffer) < end:
            return None
        body = bytes(self._buffer[HEADER.size : end])
        del self._buffer[:end]
        return Kind(kind), body

    def close(self) -> None:
        self._socket.close()
        self._close_file()
        super().close()
