"""Start viser's server behind a gate: who may look, and what pages may send."""

from __future__ import annotations

import contextlib
import functools
import io
import logging
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.tools.gate import HEADERS, Gate, Refused
from sim2vr_harness.tools.watch.offers import MAX_BYTES, Malformed, Offers

MAX_CLIENTS = 16
_FULL = f"{MAX_CLIENTS} pages are open, expected fewer: close one of them, then try again."
_QUIET = logging.getLogger(__name__)
_QUIET.setLevel(logging.CRITICAL)  # strangers must not fill the terminal with failed handshakes


class _Guard:
    """Checks of one server, around those that viser gives to ``websockets``."""

    def __init__(self, gate: Gate, offers: Offers) -> None:
        self._gate, self.offers = gate, offers
        self.clients: set[ServerConnection] = set()
        self.used = False

    def serve(self, handler: Any, *place: Any, process_request: Any, **settings: Any) -> Any:
        """Take the place of ``websockets.asyncio.server.serve``."""
        self.used = True
        settings |= {
            "process_request": functools.partial(self._answer, process_request),
            "create_connection": functools.partial(_Client, self),
            "max_size": MAX_BYTES,
            "logger": _QUIET,
        }
        return _serve(handler, *place, **settings)

    def _answer(self, page: Any, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request for a file; return None for a WebSocket that may open."""
        given = request.headers
        hosts, origins = given.get_all("Host"), given.get_all("Origin")
        try:
            reached = str(connection.local_address[0])
            request.path = self._gate.admit(request.path, hosts, origins, reached)
        except Refused as refused:
            return connection.respond(403, f"{refused}\n")
        response: Response | None = page(connection, request)
        if response is not None:
            response.headers.update(HEADERS)
        elif len(self.clients) >= MAX_CLIENTS:
            return connection.respond(503, f"{_FULL}\n")
        else:
            self.clients.add(connection)
        return response


class _Client(ServerConnection):
    """A page; hands on only messages that keep to what the page offers."""

    def __init__(self, guard: _Guard, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self._guard = guard

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that may be handled."""
        while True:
            raw = await super().recv(decode)
            try:
                message = self._guard.offers.take(raw)
            except Malformed:
                await self.close(1007, "malformed message")
                continue
            if message is not None:
                return message

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place of this page to another."""
        self._guard.clients.discard(self)
        super().connection_lost(exc)


_serve = websockets_server.serve


def open_server(viser: Any, gate: Gate, offers: Offers, host: str, port: int) -> Any:
    """Start a viser server that answers only requests that pass a gate.

    viser has no hook before its handlers: while it starts, ``websockets.asyncio.server.serve``,
    which it calls, is the guard's.

    Args:
        viser: The package.
        gate: Requests that may pass.
        offers: Messages that may pass.
        host: Address to listen on.
        port: Port to listen on, or the next one that is free.

    Raises:
        InputError: This version of viser starts its server in another way.
    """
    guard = _Guard(gate, offers)
    with (
        mock.patch.object(websockets_server, "serve", guard.serve),
        contextlib.redirect_stdout(io.StringIO()),  # viser prints an address without the token
    ):
        server = viser.ViserServer(host=host, port=port, label="sim2vr", verbose=False)
    if not guard.used:
        server.stop()
        raise InputError("watch", f"viser {viser.__version__}", "viser 1.1")
    # Only `share` may open a tunnel, never a page.
    for message in (viser._messages.ShareUrlRequest, viser._messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)
    return server


def share(server: Any, gate: Gate) -> str:
    """Open a public tunnel to a server, and return its address with the token.

    Raises:
        InputError: No tunnel could be opened.
    """
    url = server.request_share_url(verbose=False)
    if url is None:
        raise InputError("--share", "no tunnel from viser's share server", "a network connection")
    gate.accept_name(urlsplit(url).hostname or "")
    return f"{url.rstrip('/')}/{gate.token}/"
