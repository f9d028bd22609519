"""A ZeroMQ connection to an app, watched: its end, and that of the app's process, are noticed."""

import math
import os
from collections.abc import Sequence

import zmq
from zmq.utils.monitor import recv_monitor_message

MAX_MESSAGE_BYTES = 256 * 2**20
"""A longer answer is not read; the connection counts as lost then."""

_SOON_MS = 50
"""Most answers come within this; only after it the connection and the process are looked at."""


class Connection:
    """A REQ socket.

    Args:
        endpoint: ZeroMQ address, for example ``tcp://127.0.0.1:5555`` or ``ipc:///tmp/app``.
        pidfd: descriptor that becomes readable when the app's process ends, or None; closed with
            this.
    """

    def __init__(self, endpoint: str, pidfd: int | None) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        self._socket: zmq.Socket[bytes] = context.socket(zmq.REQ)
        self._socket.linger = 0
        self._socket.maxmsgsize = MAX_MESSAGE_BYTES
        self._socket.rcvtimeo = _SOON_MS
        self._monitor = self._socket.get_monitor_socket(
            zmq.Event.CONNECTED | zmq.Event.DISCONNECTED
        )
        self._pidfd = pidfd
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)
        if pidfd is not None:
            self._poller.register(pidfd, zmq.POLLIN)
        self.connected = False
        """Whether someone has taken the connection, as far as :meth:`wait` has seen."""
        self._socket.connect(endpoint)

    def send(self, frames: Sequence[bytes]) -> None:
        """Sends a message, without waiting."""
        self._socket.send_multipart(frames, flags=zmq.NOBLOCK)

    def wait(self, timeout_s: float) -> list[bytes] | None:
        """Return the next message's frames, or None if none has come in time.

        Raises:
            ConnectionError: the other side has closed the connection, or its process has ended.
        """
        try:
            return self._socket.recv_multipart()
        except zmq.Again:
            pass
        events = dict(self._poller.poll(math.ceil(1000.0 * timeout_s)))
        if self._socket in events or (events and self._socket.poll(0)):
            return self._socket.recv_multipart()
        if self._monitor in events and not self._gone():
            del events[self._monitor]
        if events:
            raise ConnectionResetError
        return None

    def _gone(self) -> bool:
        """Take what the monitor has to say; whether the connection was closed."""
        gone = False
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor)["event"]
            gone |= event == zmq.Event.DISCONNECTED
            self.connected |= event == zmq.Event.CONNECTED
        return gone

    def close(self) -> None:
        """Close the connection; idempotent."""
        if not self._socket.closed:
            self._socket.disable_monitor()
            self._monitor.close(linger=0)
            self._socket.close(linger=0)
        if self._pidfd is not None:
            os.close(self._pidfd)
            self._pidfd = None
