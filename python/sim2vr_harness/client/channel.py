"""One request, one answer, before a deadline: the harness's end of the conversation with an app."""

import math
import os
import time
from collections.abc import Sequence

import zmq
from zmq.utils.monitor import recv_monitor_message

from sim2vr_harness.client.errors import AppDied, AppError, AppTimeout
from sim2vr_harness.client.process import AppProcess

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


LONGEST_S = 1e9
"""Longest time that is taken as one to wait for something, as of sim2vr-app: some 30 years."""

_SLICE_S = 0.25
"""How often a process is looked at whose end does not wake anyone."""

_CONNECT_S = 5.0
"""How long someone may take to accept the connection where nothing is known to be starting."""


def checked_duration_s(field: str, value_s: float) -> float:
    """Return ``value_s``, a time to wait for something.

    Raises:
        ValueError: it is not above 0, not finite or above 1e9 s, some 30 years; names ``field``.
    """
    if not 0.0 < value_s <= LONGEST_S:
        raise ValueError(
            f"{field}: got {value_s}, expected a number above 0, at most {LONGEST_S:g} s"
        )
    return value_s


class Channel:
    """A connection that never waits for ever and is given up after the first failure.

    While it waits for an answer it watches the connection and, where it knows it, the app's
    process, so that a death is reported at once and only silence takes the whole time. After a lost
    answer no one knows which answer comes next, so a channel that failed once does not go on: every
    later call repeats the failure.

    Args:
        endpoint: ZeroMQ address, for example ``tcp://127.0.0.1:5555``.
        timeout_s: how long to wait for an answer.
        process: the app's process where this side has started it. Without one someone must
            listen already: that no one does is reported after five seconds.

    Raises:
        ValueError: ``timeout_s`` is no time to wait.
    """

    def __init__(
        self,
        endpoint: str,
        *,
        timeout_s: float = 60.0,
        process: AppProcess | None = None,
    ) -> None:
        self.endpoint = endpoint
        self.timeout_s = checked_duration_s("timeout_s", timeout_s)
        self.process = process
        self.awaiting = False
        self._failure: str | None = None
        self._connect_by = time.monotonic() + _CONNECT_S
        self._connection = Connection(endpoint, None if process is None else process.open_pidfd())

    @property
    def app(self) -> str:
        """The app in words, for messages."""
        return f"the app at {self.endpoint}" if self.process is None else str(self.process)

    @property
    def failure(self) -> str | None:
        """Why the channel cannot be used any more; None while it can."""
        return self._failure

    @property
    def usable(self) -> bool:
        """Whether another request can be sent."""
        return self._failure is None and not self.awaiting

    def request(
        self, frames: Sequence[bytes], doing: str, timeout_s: float | None = None
    ) -> list[bytes]:
        """:meth:`send` and :meth:`receive`."""
        self.send(frames, doing)
        return self.receive(doing, timeout_s)

    def send(self, frames: Sequence[bytes], doing: str) -> None:
        """Sends a request.

        Args:
            frames: of the message.
            doing: the request in words, for messages.

        Raises:
            AppDied: the app is known to be gone.
            AppError: the answer before was not received.
        """
        self._require_open()
        if self.awaiting:
            raise AppError(f"{self.app} has not answered the request before")
        if self.process is not None and not self.process.running:
            raise self.give_up(self._death(doing))
        self.awaiting = True  # first: who is interrupted in between must not send once more
        try:
            self._connection.send(frames)
        except Exception:
            self.awaiting = False
            raise

    def receive(self, doing: str, timeout_s: float | None = None) -> list[bytes]:
        """Waits for the answer to the last request.

        Raises:
            AppDied: the process ended or the connection was closed.
            AppTimeout: no answer came in time, or no one listens there.
        """
        self._require_open()
        if not self.awaiting:
            raise AppError(f"{doing}: nothing was sent that could be answered")
        limit = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + limit
        while True:
            left = max(0.0, deadline - time.monotonic())
            try:
                frames = self._connection.wait(min(left, _SLICE_S))
            except ConnectionError:
                raise self.give_up(self._death(doing)) from None
            if frames is not None:
                self.awaiting = False
                return frames
            if self.process is not None and not self.process.running:
                raise self.give_up(self._death(doing))
            if left == 0.0:
                raise self.give_up(self._silence(doing, limit))
            late = self.process is None and time.monotonic() > self._connect_by
            unanswered = late and not self._connection.connected
            if unanswered:
                raise self.give_up(
                    AppTimeout(
                        f"app.connect: got {self.endpoint}, where no one listens (no connection "
                        f"within {_CONNECT_S:g} s), expected the address of an app that runs: "
                        "start it first"
                    )
                )

    def _death(self, doing: str) -> Exception:
        if self.process is None:
            return AppDied(
                f"{self.app} closed the connection during {doing}. If it ended, its own log says "
                "why; start it again"
            )
        # A closed connection comes a moment before the end of the process that closed it.
        self.process.wait(0.5)
        return self.process.death(f"during {doing}")

    def _silence(self, doing: str, limit_s: float) -> AppTimeout:
        words = f"{self.app} gave no answer to {doing} within {limit_s:g} s"
        if self.process is None:
            return AppTimeout(
                f"{words}. Is it running, does it listen there, and is no other client connected? "
                "An app that needs longer: raise timeout_s"
            )
        return AppTimeout(
            f"{words}, though its process is there (it hangs, is stopped, or needs a longer "
            f"timeout_s){self.process.log_words()}"
        )

    def _require_open(self) -> None:
        if self._failure is not None:
            raise AppDied(f"{self.app} was given up: {self._failure}")

    def give_up(self, error: Exception) -> Exception:
        """Closes the connection because of ``error``, which later calls repeat; returns it."""
        if self._failure is None:
            self._failure = str(error)
        self.close()
        return error

    def close(self) -> None:
        """Closes the connection; idempotent."""
        if self._failure is None:
            self._failure = "it is closed; make a new one"
        self._connection.close()
