"""How messages travel to an app: through ZeroMQ, or through a Unix socket on the same machine."""

from __future__ import annotations

import math
import os
import select
import socket
import struct
import time
from collections.abc import Sequence
from typing import Protocol

import zmq

__all__ = ["Carrier", "LocalCarrier", "ZmqCarrier"]

MAX_MESSAGE_BYTES = 256 * 2**20
"""A longer answer is not read; the connection counts as lost then."""


class Carrier(Protocol):
    """One connection to an app."""

    def send(self, frames: Sequence[bytes], timeout_s: float) -> None:
        """Sends a message.

        Raises:
            ConnectionError: the other side is known to be gone.
            TimeoutError: it takes nothing.
        """

    def wait(self, timeout_s: float) -> list[bytes] | None:
        """The next message's frames, or None if none has come in time.

        Raises:
            ConnectionError: the other side has closed the connection, or its process has ended.
        """

    def close(self) -> None:
        """Closes the connection; idempotent."""


class ZmqCarrier:
    """A REQ socket, its connection and the app's process watched.

    Args:
        endpoint: ZeroMQ address, for example ``tcp://127.0.0.1:5555``.
        pidfd: descriptor that becomes readable when the process ends, or None; closed with this.
    """

    def __init__(self, endpoint: str, pidfd: int | None) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        self._socket: zmq.Socket[bytes] = context.socket(zmq.REQ)
        self._socket.linger = 0
        self._socket.maxmsgsize = MAX_MESSAGE_BYTES
        self._monitor = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._pidfd = pidfd
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)
        if pidfd is not None:
            self._poller.register(pidfd, zmq.POLLIN)
        self._socket.connect(endpoint)

    def send(self, frames: Sequence[bytes], timeout_s: float) -> None:
        """See :class:`Carrier`; never waits."""
        if self._monitor.poll(0):
            raise ConnectionResetError
        self._socket.send_multipart(frames, flags=zmq.NOBLOCK)

    def wait(self, timeout_s: float) -> list[bytes] | None:
        """See :class:`Carrier`."""
        events = dict(self._poller.poll(math.ceil(1000.0 * timeout_s)))
        if self._socket in events or (events and self._socket.poll(0)):
            return self._socket.recv_multipart()
        if events:
            raise ConnectionResetError
        return None

    def close(self) -> None:
        """See :class:`Carrier`."""
        if not self._socket.closed:
            self._socket.disable_monitor()
            self._monitor.close(linger=0)
            self._socket.close(linger=0)
        if self._pidfd is not None:
            os.close(self._pidfd)
            self._pidfd = None


class LocalCarrier:
    """A Unix stream socket: per message u32 number of frames, u32 size of each, then the frames.

    Args:
        name: path of the socket, or ``@`` and a name without a file.
        timeout_s: how long the server may take to accept.

    Raises:
        ConnectionError: nobody listens there.
    """

    def __init__(self, name: str, timeout_s: float) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(timeout_s)
        self._socket.connect("\0" + name[1:] if name.startswith("@") else name)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        self._received = b""

    def send(self, frames: Sequence[bytes], timeout_s: float) -> None:
        """See :class:`Carrier`."""
        sizes = [len(frame) for frame in frames]
        self._socket.settimeout(timeout_s)
        self._socket.sendall(
            struct.pack(f"<{1 + len(sizes)}I", len(sizes), *sizes) + b"".join(frames)
        )

    def wait(self, timeout_s: float) -> list[bytes] | None:
        """See :class:`Carrier`."""
        deadline = time.monotonic() + timeout_s
        while True:
            frames = self._take()
            if frames is not None:
                return frames
            left = deadline - time.monotonic()
            if not self._poll.poll(math.ceil(1000.0 * max(0.0, left))):
                return None
            data = self._socket.recv(1 << 20)
            if not data or len(self._received) > MAX_MESSAGE_BYTES:
                raise ConnectionResetError
            self._received += data

    def _take(self) -> list[bytes] | None:
        data = self._received
        if len(data) < 4:
            return None
        count = int.from_bytes(data[:4], "little")
        at = 4 + 4 * count
        if len(data) < at:
            return None
        sizes = struct.unpack_from(f"<{count}I", data, 4)
        if len(data) < at + sum(sizes):
            return None
        frames = []
        for size in sizes:
            frames.append(data[at : at + size])
            at += size
        self._received = data[at:]
        return frames

    def close(self) -> None:
        """See :class:`Carrier`."""
        self._socket.close()
