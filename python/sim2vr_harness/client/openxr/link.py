"""The conversation with the runtime inside a program, over a pair of sockets.

Nothing waits for ever: the end of the process is seen at once, silence after a deadline, and after
a failure nothing more is asked.
"""

import os
import select
import socket
import struct
import time

from sim2vr_harness.client.answers import BadReply
from sim2vr_harness.client.errors import AppDied, AppTimeout, ProtocolError
from sim2vr_harness.client.openxr.wire import HEADER, MOST_BYTES, Kind, ended_in
from sim2vr_harness.client.process import AppProcess

_FILE = struct.Struct("i")
_ROOM = socket.CMSG_LEN(_FILE.size)
"""For one descriptor with each message; the kernel closes those that find none."""
_ORDERLY = ("xrEndSession", "xrDestroySession", "xrDestroyInstance", "xrRequestExitSession")
"""Calls by which a program ends its session itself."""


class SessionEnded(Exception):
    """The program ended its session; the text says by which call."""


class Link:
    """One conversation, given up after the first failure.

    Args:
        process: of the program.
        end: this side's socket, owned by this object from now on.
    """

    def __init__(self, process: AppProcess, end: socket.socket) -> None:
        self.process = process
        self._socket = end
        end.settimeout(None)
        self._ended = process.open_pidfd()
        self._buffer = bytearray()
        self.file: int | None = None
        """Descriptor that came with the latest message that had one; closed with this object."""
        self._poll = select.poll()
        self._poll.register(end, select.POLLIN)
        if self._ended is not None:
            self._poll.register(self._ended, select.POLLIN)
        self._failure: str | None = None

    @property
    def usable(self) -> bool:
        """Whether the conversation goes on."""
        return self._failure is None

    def send(self, kind: Kind, body: bytes = b"") -> None:
        """Send a message.

        Raises:
            AppDied: the conversation is over.
        """
        self._require_open()
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
                words = f"{self.process} gave no {doing} within {timeout_s:g} s"
                raise self.give_up(AppTimeout(f"{words}{hint}{self.process.log_words()}"))
            self._poll.poll(min(left_s, 1.0) * 1000.0)

    def next_message(self, doing: str) -> tuple[Kind, bytes] | None:
        """Return a message that is there, None if there is none; raises as :meth:`receive`."""
        self._require_open()
        while (message := self._taken()) is None:
            try:
                got = self._read()
            except BlockingIOError:
                if self.process.running:
                    return None
                got = self._rest()
            except OSError:
                got = b""
            if not got:
                self.process.wait(1.0)
                raise self.give_up(self.process.death(f"before its {doing}"))
            self._buffer += got
        kind, body = message
        if kind == Kind.ENDED:
            raise self._end(body)
        return kind, body

    def _rest(self) -> bytes:
        """What an ended process had still sent."""
        try:
            return self._read()
        except OSError:
            return b""

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
            raise self.give_up(
                ProtocolError(
                    f"{self.process}: got a message of kind {kind} with {length} bytes, expected "
                    f"a kind of this version and at most {MOST_BYTES} bytes"
                )
            )
        end = HEADER.size + length - 1
        if len(self._buffer) < end:
            return None
        body = bytes(self._buffer[HEADER.size : end])
        del self._buffer[:end]
        return Kind(kind), body

    def _end(self, body: bytes) -> Exception:
        try:
            call, reason = ended_in(body)
        except BadReply as error:
            return self.malformed(error)
        if call in _ORDERLY:
            return SessionEnded(call)
        words = f"{call}: {reason}" if call and call not in reason else reason
        return self.give_up(AppDied(f"{self.process}: {words}{self.process.log_words()}"))

    def malformed(self, error: Exception) -> Exception:
        """Return the error for a message whose parts cannot be used; gives up."""
        return self.give_up(ProtocolError(f"{self.process}: answered with another thing: {error}"))

    def give_up(self, error: Exception) -> Exception:
        """End the conversation because of ``error``, which later calls repeat; returns it."""
        if self._failure is None:
            self._failure = str(error)
        return error

    def _require_open(self) -> None:
        if self._failure is not None:
            raise AppDied(f"{self.process} was given up: {self._failure}")

    def close(self) -> None:
        """Close the socket; idempotent."""
        if self._failure is None:
            self._failure = "it is closed; make a new one"
        self._socket.close()
        self._close_file()
        if self._ended is not None:
            os.close(self._ended)
            self._ended = None
