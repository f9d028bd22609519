"""One request, one answer, before a deadline: the ZeroMQ end of the app's conversation."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from typing import Any

import zmq

from sim2vr_harness.client.errors import AppDied, AppError, AppTimeout
from sim2vr_harness.client.process import AppProcess

__all__ = ["Channel"]

MAX_MESSAGE_BYTES = 256 * 2**20
"""A longer answer is not read; the connection counts as lost then."""

_SLICE_S = 0.25
"""How often a process without a pollable descriptor is looked at."""


class Channel:
    """A REQ socket that never waits for ever and is given up after the first failure.

    While it waits for an answer it watches the connection and, where it knows it, the app's
    process, so that a death is told at once and only silence takes the whole time. A REQ socket
    cannot go on after a lost answer; neither does a channel: every later call repeats the failure.

    Args:
        endpoint: ZeroMQ address, for example ``tcp://127.0.0.1:5555``.
        timeout_s: how long to wait for an answer.
        process: the app's process where this side has started it.
    """

    def __init__(
        self,
        endpoint: str,
        *,
        timeout_s: float = 60.0,
        process: AppProcess | None = None,
    ) -> None:
        self.endpoint = endpoint
        self.timeout_s = timeout_s
        self.process = process
        self.awaiting = False
        self._failure: str | None = None
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        self._socket: zmq.Socket[bytes] = context.socket(zmq.REQ)
        self._socket.linger = 0
        self._socket.maxmsgsize = MAX_MESSAGE_BYTES
        self._monitor = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._pidfd = None if process is None else process.open_pidfd()
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)
        if self._pidfd is not None:
            self._poller.register(self._pidfd, zmq.POLLIN)
        self._socket.connect(endpoint)

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
        self, frames: Sequence[Any], doing: str, timeout_s: float | None = None
    ) -> list[bytes]:
        """:meth:`send` and :meth:`receive`."""
        self.send(frames, doing)
        return self.receive(doing, timeout_s)

    def send(self, frames: Sequence[Any], doing: str) -> None:
        """Sends a request; never blocks.

        Args:
            frames: bytes-like objects.
            doing: the request in words, for messages.

        Raises:
            AppDied: the app is known to be gone.
            AppError: the channel was given up before.
        """
        self._require_open()
        if self.awaiting:
            raise AppError(f"{self.app} has not answered the request before")
        if self._monitor.poll(0) or (self.process is not None and not self.process.running):
            raise self.give_up(self._death(doing))
        self._socket.send_multipart(frames, flags=zmq.NOBLOCK)
        self.awaiting = True

    def receive(self, doing: str, timeout_s: float | None = None) -> list[bytes]:
        """Waits for the answer to the last request.

        Raises:
            AppDied: the process ended or the connection was closed.
            AppTimeout: no answer came in time.
        """
        self._require_open()
        if not self.awaiting:
            raise AppError(f"{doing}: nothing was sent that could be answered")
        limit = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + limit
        while True:
            left = max(0.0, deadline - time.monotonic())
            events = dict(self._poller.poll(math.ceil(1000.0 * min(left, _SLICE_S))))
            if self._socket in events or self._socket.poll(0):
                frames = self._socket.recv_multipart()
                self.awaiting = False
                return frames
            if events or (self.process is not None and not self.process.running):
                raise self.give_up(self._death(doing))
            if left == 0.0:
                raise self.give_up(self._silence(doing, limit))

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
        """Closes the socket because of ``error``, which later calls repeat; returns it."""
        if self._failure is None:
            self._failure = str(error)
        self.close()
        return error

    def close(self) -> None:
        """Closes the socket; idempotent."""
        if self._failure is None:
            self._failure = "it is closed; make a new one"
        if not self._socket.closed:
            self._socket.disable_monitor()
            self._monitor.close(linger=0)
            self._socket.close(linger=0)
        if self._pidfd is not None:
            os.close(self._pidfd)
            self._pidfd = None
