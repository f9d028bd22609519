"""The browser's developer tools over a pair of pipes: requests, replies and events, in JSON.

``--remote-debugging-pipe``: no port that others could connect to, no library. Messages end with a
zero byte. While a reply is waited for, events are handled and the process is watched.
"""

import json
import os
import select
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from sim2vr_harness.client.answers import OBJECT, BadReply, read
from sim2vr_harness.client.errors import AppError
from sim2vr_harness.client.process import AppProcess, Conversation

_CHUNK_BYTES = 1 << 18
_SLICE_S, _WATCH_S = 0.25, 1.0
"""Intervals at which a process is checked whose end wakes no waiting call, and at which what
watches it is called, s."""
_MOST_BYTES = 1 << 28
"""Of a message."""

Handler = Callable[[Mapping[str, Any]], None]


class RefusedRequest(AppError):
    """The browser answered that it cannot do what was asked."""


class DevTools(Conversation):
    """One conversation with a browser.

    Args:
        process: the browser's.
        to_browser: descriptor to write to, owned by this object from now on.
        from_browser: descriptor to read from, likewise.
    """

    process: AppProcess

    def __init__(self, process: AppProcess, to_browser: int, from_browser: int) -> None:
        super().__init__(process)
        self._out, self._in = to_browser, from_browser
        for descriptor in (to_browser, from_browser):
            os.set_blocking(descriptor, False)
        self._buffer = bytearray()
        self._searched = 0
        self._unsent = bytearray()
        self._last = 0
        self._replies: dict[int, Mapping[str, Any]] = {}
        self._awaited: set[int] = set()
        self._handlers: dict[str, Handler] = {}
        self._watch: Callable[[], None] | None = None
        self._watched_s = 0.0

    def on(self, event: str, handler: Handler) -> None:
        """Have ``handler`` called with the parameters of every event of that name."""
        self._handlers[event] = handler

    def watch(self, look: Callable[[], None]) -> None:
        """Have ``look`` called now and then while replies are waited for; it may raise."""
        self._watch = look

    def send(
        self,
        method: str,
        parameters: Mapping[str, Any] | None = None,
        session: str | None = None,
        *,
        answered: bool = True,
    ) -> int:
        """Send a request; returns its number.

        Args:
            method: such as ``Page.navigate``.
            parameters: of the request.
            session: the page that it is for; None: the browser.
            answered: whether someone will ask for the reply.

        Raises:
            AppDied: the conversation is over.
        """
        self.require_open()
        self._last += 1
        message: dict[str, Any] = {"id": self._last, "method": method, "params": parameters or {}}
        if session is not None:
            message["sessionId"] = session
        if answered:
            self._awaited.add(self._last)
        self._unsent += json.dumps(message, separators=(",", ":")).encode() + b"\0"
        self._flush()
        return self._last

    def receive(self, number: int, doing: str, timeout_s: float) -> Mapping[str, Any]:
        """Wait for the reply to a request, handling what else comes.

        Args:
            number: of the request.
            doing: the request in words, for messages.
            timeout_s: how long to wait.

        Raises:
            AppDied: the browser ended.
            AppTimeout: no reply in time.
            RefusedRequest: the browser says no.
        """
        deadline = time.monotonic() + timeout_s
        while number not in self._replies:
            self._wait(deadline, doing, timeout_s)
        self._awaited.discard(number)
        reply = self._replies.pop(number)
        if "error" in reply:
            raise RefusedRequest(f"{doing}: {reply['error'].get('message', reply['error'])}")
        result: Mapping[str, Any] = reply.get("result", {})
        return result

    def request(
        self,
        method: str,
        parameters: Mapping[str, Any] | None = None,
        session: str | None = None,
        *,
        timeout_s: float,
    ) -> Mapping[str, Any]:
        """:meth:`send` and :meth:`receive`."""
        return self.receive(self.send(method, parameters, session), method, timeout_s)

    def wait_until(self, done: Callable[[], bool], doing: str, timeout_s: float) -> None:
        """Handle what comes until ``done`` says so; raises as :meth:`receive`."""
        deadline = time.monotonic() + timeout_s
        while not done():
            self._wait(deadline, doing, timeout_s)

    def _wait(self, deadline: float, doing: str, timeout_s: float) -> None:
        """Take in what is there, or wait for it a little."""
        self.require_open()
        now = time.monotonic()
        if self._watch is not None and now - self._watched_s >= _WATCH_S:
            self._watched_s = now
            self._watch()
        left = deadline - now
        if left <= 0.0:
            raise self.silent(f"answer to {doing}", timeout_s)
        reading = [self._in, *([] if self._ended is None else [self._ended])]
        writing = [self._out] if self._unsent else []
        ready, writable, _ = select.select(reading, writing, [], min(left, _SLICE_S))
        if writable:
            self._flush()
        if self._in in ready:
            self._take(doing)
        elif not self.process.running:
            raise self.died(f"during {doing}")

    def _flush(self) -> None:
        while self._unsent:
            try:
                sent = os.write(self._out, self._unsent[:_CHUNK_BYTES])
            except BlockingIOError:
                return
            except OSError:  # its end is gone; reading will find out why
                self._unsent.clear()
                return
            del self._unsent[:sent]

    def _take(self, doing: str) -> None:
        try:
            got = os.read(self._in, _CHUNK_BYTES)
        except BlockingIOError:
            return
        if not got:
            raise self.died(f"during {doing}")
        self._buffer += got
        while (end := self._buffer.find(b"\0", self._searched)) >= 0:
            message = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            self._searched = 0
            try:
                content = read("a message", OBJECT, message)
            except BadReply as error:
                raise self.malformed(error) from error
            if "id" in content:
                if content["id"] in self._awaited:
                    self._replies[content["id"]] = content
            elif (handler := self._handlers.get(content.get("method", ""))) is not None:
                handler(content.get("params", {}))
        self._searched = len(self._buffer)
        if len(self._buffer) > _MOST_BYTES:
            raise self.malformed(f"a message of more than {_MOST_BYTES} bytes")

    def close(self) -> None:
        """Close the pipes, at which a browser ends by itself; idempotent."""
        for descriptor in (self._out, self._in):
            with suppress(OSError):
                os.close(descriptor)
        self._out = self._in = -1
        super().close()
