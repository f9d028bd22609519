"""One request, one answer, before a deadline: the harness's end of the conversation with an app."""

import math
import time
from collections.abc import Sequence
from contextlib import suppress

import zmq
from zmq.utils.monitor import recv_monitor_message

from sim2vr_harness.client.errors import AppDied, AppError, AppRefused, AppTimeout
from sim2vr_harness.client.process import AppProcess, Conversation

MAX_MESSAGE_BYTES = 256 * 2**20
"""A longer answer is not read; the connection counts as lost then."""
LONGEST_S = 1e9
"""Longest time that is taken as one to wait for something, as of sim2vr-app: some 30 years."""
_SOON_MS = 50
"""Most answers come within this; only after it the connection and the process are looked at."""
_SLICE_S = 0.25
"""Interval at which a process is checked whose end wakes no waiting call, s."""
_CONNECT_S = 5.0
"""Deadline for accepting a connection if no app is known to be starting, s."""
_QUIT_S = 2.0
"""Deadline for an app to acknowledge the end of the session, s."""


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


class Channel(Conversation):
    """A REQ socket that never waits for ever and is given up after the first failure.

    While it waits for an answer it watches the connection and, where it knows it, the app's
    process, so that a death is reported at once and only silence takes the whole time. After a lost
    answer no one knows which answer comes next, so a channel that failed once does not go on.

    Args:
        endpoint: ZeroMQ address, for example ``tcp://127.0.0.1:5555`` or ``ipc:///tmp/app``.
        timeout_s: how long to wait for an answer.
        process: the app's process where this side has started it. Without one someone must
            listen already: that no one does is reported after five seconds.

    Raises:
        ValueError: ``timeout_s`` is no time to wait.
    """

    def __init__(
        self, endpoint: str, *, timeout_s: float = 60.0, process: AppProcess | None = None
    ) -> None:
        self.endpoint = endpoint
        self.timeout_s = checked_duration_s("timeout_s", timeout_s)
        super().__init__(process)
        self.awaiting = False
        self._connected = False
        self._connect_by = time.monotonic() + _CONNECT_S
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        self._socket: zmq.Socket[bytes] = context.socket(zmq.REQ)
        self._socket.linger = 0
        self._socket.maxmsgsize = MAX_MESSAGE_BYTES
        self._socket.rcvtimeo = _SOON_MS
        self._monitor = self._socket.get_monitor_socket(
            zmq.Event.CONNECTED | zmq.Event.DISCONNECTED
        )
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)
        if self._ended is not None:
            self._poller.register(self._ended, zmq.POLLIN)
        self._socket.connect(endpoint)

    @property
    def app(self) -> str:
        return f"the app at {self.endpoint}" if self.process is None else str(self.process)

    @property
    def usable(self) -> bool:
        """True if another request can be sent."""
        return self.failure is None and not self.awaiting

    def request(
        self, frames: Sequence[bytes], doing: str, timeout_s: float | None = None
    ) -> list[bytes]:
        """:meth:`send` and :meth:`receive`."""
        self.send(frames, doing)
        return self.receive(doing, timeout_s)

    def send(self, frames: Sequence[bytes], doing: str) -> None:
        """Send a request, without waiting.

        Args:
            frames: of the message.
            doing: the request in words, for messages.

        Raises:
            AppDied: the app is known to be gone.
            AppError: the answer before was not received.
        """
        self.require_open()
        if self.awaiting:
            raise AppError(f"{self.app} has not answered the request before")
        if self.process is not None and not self.process.running:
            raise self._lost(doing)
        self.awaiting = True  # set before sending: a signal must not cause a second send
        try:
            self._socket.send_multipart(frames, flags=zmq.NOBLOCK)
        except Exception:
            self.awaiting = False
            raise

    def receive(self, doing: str, timeout_s: float | None = None) -> list[bytes]:
        """Wait for the answer to the last request.

        Raises:
            AppDied: the process ended or the connection was closed.
            AppTimeout: no answer came in time, or no one listens there.
        """
        self.require_open()
        if not self.awaiting:
            raise AppError(f"{doing}: nothing was sent that could be answered")
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + limit_s
        while True:
            left_s = max(0.0, deadline - time.monotonic())
            frames = self._wait(min(left_s, _SLICE_S), doing)
            if frames is not None:
                self.awaiting = False
                return frames
            if self.process is not None and not self.process.running:
                raise self._lost(doing)
            if left_s == 0.0:
                hint = (
                    ". Is it running, does it listen there, and is no other client connected? "
                    "An app that needs longer: raise timeout_s"
                    if self.process is None
                    else ", though its process is there (it hangs, is stopped, or needs a longer "
                    f"timeout_s){self.process.log_words()}"
                )
                raise self.silent(f"answer to {doing}", limit_s, hint)
            late = self.process is None and time.monotonic() > self._connect_by
            if late and not self._connected:
                raise self.give_up(
                    AppTimeout(
                        f"app.connect: got {self.endpoint}, where no one listens (no connection "
                        f"within {_CONNECT_S:g} s), expected the address of an app that runs: "
                        "start it first"
                    )
                )

    def _wait(self, timeout_s: float, doing: str) -> list[bytes] | None:
        """Return the next message's frames, None if none has come in time."""
        try:
            return self._socket.recv_multipart()
        except zmq.Again:
            pass
        events = dict(self._poller.poll(math.ceil(1000.0 * timeout_s)))
        if self._socket in events or (events and self._socket.poll(0)):
            return self._socket.recv_multipart()
        gone = events.keys() - {self._monitor}
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor)["event"]
            self._connected |= event == zmq.Event.CONNECTED
            if event == zmq.Event.DISCONNECTED:
                gone |= {self._monitor}
        if gone:
            raise self._lost(doing)
        return None

    def _lost(self, doing: str) -> Exception:
        if self.process is not None:
            return self.died(f"during {doing}")
        return self.give_up(
            AppDied(
                f"{self.app} closed the connection during {doing}. If it ended, its own log says "
                "why; start it again"
            )
        )

    def give_up(self, error: Exception) -> Exception:
        super().give_up(error)
        self.close()
        return error

    def close(self) -> None:
        if not self._socket.closed:
            self._socket.disable_monitor()
            self._monitor.close(linger=0)
            self._socket.close(linger=0)
        super().close()

    def end(self, message: Sequence[bytes]) -> None:
        """Ask the app to quit, and end the process that it came from; idempotent."""
        if self.usable:
            with suppress(AppError, AppRefused):
                self.request(message, "the end", _QUIT_S)
            self.close()
            if self.process is not None:
                self.process.stop()
        self.abandon()

    def abandon(self) -> None:
        """Close the channel and kill the process at once; idempotent."""
        self.close()
        if self.process is not None:
            self.process.kill()
