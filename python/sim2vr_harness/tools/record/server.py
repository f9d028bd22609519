"""Serve a page's folder with the recorder in the page, and receive its session."""

import hashlib
import hmac
import math
import secrets
import shutil
import socket
import ssl
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote, urlsplit

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.webxr.files import HOST, PageFiles
from sim2vr_harness.sessions import Session
from sim2vr_harness.tools.gate import HEADERS, Gate, Refused
from sim2vr_harness.tools.record.parts import MAX_PART_BYTES, Parts, RefusedPart
from sim2vr_harness.tools.record.script import recorder_script, with_script

_DAYS = 2
_TIMEOUT_S = 30.0
_ELSEWHERE = ("192.0.2.1", 9)
"""An address for documentation (RFC 5737): nothing is sent there."""


def local_address() -> str:
    """Return this machine's address on the local network.

    Raises:
        InputError: It has none.
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(_ELSEWHERE)
            address = str(probe.getsockname()[0])
    except OSError:
        address = "127.0.0.1"
    if address.startswith("127."):
        raise InputError("--lan", "a machine without a network", "an address on the local network")
    return address


def self_signed(host: str) -> tuple[ssl.SSLContext, str]:
    """Return settings of a server with a certificate for an address, and its fingerprint.

    The private key is in no file when the function has returned.

    Raises:
        InputError: There is no ``openssl``, or it fails.
    """
    program = shutil.which("openssl")
    if program is None:
        raise InputError("--lan", "no openssl on the PATH", "it (apt-get install openssl)")
    with tempfile.TemporaryDirectory() as folder:
        key, certificate = Path(folder) / "key.pem", Path(folder) / "certificate.pem"
        # fmt: off
        command = [
            program, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
            "-nodes", "-days", str(_DAYS), "-subj", "/CN=sim2vr", "-keyout", str(key),
            "-out", str(certificate), "-addext", f"subjectAltName=IP:{host}",
        ]
        # fmt: on
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=_TIMEOUT_S)
        except (subprocess.SubprocessError, OSError) as error:
            raise InputError("--lan", f"openssl, which fails: {error}", "openssl 1.1.1") from error
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, key)
        content = ssl.PEM_cert_to_DER_cert(certificate.read_text())
    return context, hashlib.sha256(content).digest().hex(":").upper()


MAX_CONNECTIONS = 64
MAX_PER_ADDRESS = 16
"""Connections from one address; a browser opens six."""
HEAD_S = 5.0
"""Time for the handshake and the head of a request, up to the first one with the token."""
TIMEOUT_S = 30.0
"""Longest silence of a connection that has shown the token."""
_OWN = "/__sim2vr/"
_SECRET_BYTES = 16


class RecordingServer:
    """A server of one page for one session.

    Args:
        page: A file in HTML, or a folder with an ``index.html``.
        seed: Of the page's random numbers.
        out: The file to write; must not exist.
        port: To listen on; 0: one that is free.
        lan: Listen on the local network over HTTPS, instead of loopback over HTTP.

    Attributes:
        address: To open in the headset's browser; holds the token.
        fingerprint: SHA-256 of the certificate; empty over HTTP.

    Raises:
        AppRefused: There is no such page.
        InputError: The port is taken, ``lan`` cannot be had, or ``out`` exists or is being written.
    """

    def __init__(
        self, page: Path, seed: int, out: Path, *, port: int = 0, lan: bool = False
    ) -> None:
        self.files = PageFiles(str(page), {})
        self.name = unquote(self.files.url.removeprefix(HOST))
        self.seed = seed
        host, context, self.fingerprint = "127.0.0.1", None, ""
        if lan:
            host = local_address()
            context, self.fingerprint = self_signed(host)
        self.gate = Gate(host)
        self.cookie = secrets.token_urlsafe(_SECRET_BYTES)
        self.lock = threading.Lock()
        self.parts = Parts(out)
        try:
            self._server = _Server((host, port), self, context)
        except OSError as error:
            self.parts.close()
            got = f"{port}, which cannot be listened on ({error.strerror})"
            raise InputError("--port", got, "a free port") from error
        self.port = int(self._server.server_address[1])
        scheme = "https" if lan else "http"
        names = ("localhost", host) if host == "127.0.0.1" else (host,)
        self.origins = {f"{scheme}://{name}:{self.port}" for name in names}
        shown = Gate.address(self.gate, self.port, scheme)
        if not lan:
            shown = shown.replace("127.0.0.1", "localhost", 1)
        self.address = shown + quote(self.name)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Serve within the block."""
        runner = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        runner.start()
        try:
            yield
        finally:
            self._server.shutdown()
            self._server.server_close()
            runner.join()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end of the session; False: it has not come in time."""
        return self.parts.complete.wait(timeout_s)

    def session(self) -> Session | None:
        """Return the recording so far; None: there is none.

        Raises:
            InputError: The page has sent something else than a session.
        """
        return self.parts.session()

    def close(self) -> None:
        """Release the folder of the parts."""
        self.parts.close()


@dataclass(eq=False)
class _Connection:
    """An open connection; one without the token has a deadline, and makes room for a newer one."""

    socket: socket.socket
    deadline_s: float
    admitted: bool = False


class _Server(ThreadingHTTPServer):
    """A thread for each connection, and few connections of those without the token."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = MAX_CONNECTIONS

    def __init__(
        self, place: tuple[str, int], owner: RecordingServer, context: ssl.SSLContext | None
    ) -> None:
        self.owner, self._context = owner, context
        self._open: dict[tuple[str, int], _Connection] = {}  # by address and port, oldest first
        self._guard = threading.Lock()
        super().__init__(place, _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        new = _Connection(request, time.monotonic() + HEAD_S)
        with self._guard:
            same = [key for key in self._open if key[0] == client_address[0]]
            why, among = "", list(self._open)
            if len(same) >= MAX_PER_ADDRESS:
                why, among = f"more than {MAX_PER_ADDRESS} from one address", same
            elif len(among) >= MAX_CONNECTIONS:
                why = f"more than {MAX_CONNECTIONS}"
            if why:
                oldest = next((key for key in among if not self._open[key].admitted), None)
                closed = new if oldest is None else self._open.pop(oldest)
                self._end(closed, "503 Service Unavailable", f"Connections: got {why}.")
            if not why or closed is not new:
                self._open[client_address] = new
        if self._open.get(client_address) is new:
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        mine = self._open.get(client_address)
        try:
            if self._context is not None and mine is not None:
                # Here, so that a slow handshake delays no other.
                request.settimeout(HEAD_S)
                request = self._context.wrap_socket(
                    request, server_side=True, do_handshake_on_connect=False
                )
                mine.socket = request
                request.do_handshake()
            super().process_request_thread(request, client_address)
        except (OSError, ssl.SSLError):
            self.shutdown_request(request)
        finally:
            with self._guard:
                if self._open.get(client_address) is mine:
                    self._open.pop(client_address, None)

    def admit(self, client_address: Any) -> None:
        """Note that a connection has shown the token."""
        with self._guard:
            if (mine := self._open.get(client_address)) is not None:
                mine.admitted, mine.deadline_s = True, math.inf

    def service_actions(self) -> None:
        """Close connections that have timed out; the loop calls this ten times a second."""
        now_s = time.monotonic()
        with self._guard:
            for key in [key for key, each in self._open.items() if each.deadline_s < now_s]:
                why = f"Request: got no whole head with the token within {HEAD_S:g} s."
                self._end(self._open.pop(key), "408 Request Timeout", why)

    def _end(self, connection: _Connection, status: str, why: str) -> None:
        """Wake the thread of a connection, which then closes it."""
        with suppress(OSError):
            if self._context is None:
                head = f"HTTP/1.1 {status}\r\nConnection: close\r\nContent-Length: {len(why) + 1}"
                connection.socket.send(f"{head}\r\n\r\n{why}\n".encode())
            # Not TLS's own shutdown, which another thread must not call.
            socket.socket.shutdown(connection.socket, socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing, so that strangers cannot fill the terminal."""


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "sim2vr", ""
    timeout = TIMEOUT_S
    server: _Server

    def do_GET(self) -> None:
        """Answer with a file of the page's folder, or the recorder."""
        owner = self.server.owner
        try:
            path = self._admitted()
        except Refused as refused:
            self._refuse(403, str(refused))
            return
        plain = unquote(urlsplit(path).path)
        if plain == f"{_OWN}recorder.js":
            # A session of its own for each document: a page that is loaded again is another one.
            url = f"/{owner.gate.token}{_OWN}part?session={secrets.token_hex(_SECRET_BYTES)}"
            script = recorder_script(owner.name, url, owner.seed)
            self._answer(200, script.encode(), "text/javascript")
            return
        self._answer(*_content(owner, plain))

    do_HEAD = do_GET

    def do_POST(self) -> None:
        """Receive a part of the session."""
        owner = self.server.owner
        length = self.headers.get("Content-Length", "")
        try:
            path = self._admitted(reads=False)
            origins = self.headers.get_all("Origin") or []
            if len(origins) != 1 or origins[0].lower() not in self.server.owner.origins:
                raise Refused(f"Origin: got {origins!r:.200}, expected the page's own.")
            if urlsplit(path).path != f"{_OWN}part":
                raise RefusedPart(404, "Path: expected the recorder's.")
            if not (length.isascii() and length.isdigit() and int(length) <= MAX_PART_BYTES):
                raise RefusedPart(413, f"Size: expected at most {MAX_PART_BYTES:,} bytes.")
            content = self.rfile.read(int(length))
            if len(content) < int(length):
                raise RefusedPart(400, "Body: got less than its length.")
            owner.parts.take(urlsplit(path).query, content)
        except Refused as refused:
            self._refuse(403, str(refused))
        except RefusedPart as refused:
            self._refuse(refused.status, str(refused))
        else:
            self._answer(204, b"", "")

    def _admitted(self, *, reads: bool = True) -> str:
        """Return the path behind the token; the cookie may stand in for it where files are read.

        Addresses that begin with a slash lack the token; the browser sends the cookie, which
        stands for reading only.
        """
        owner, path = self.server.owner, self.path
        if reads and not path.startswith(f"/{owner.gate.token}/") and self._has_cookie():
            path = f"/{owner.gate.token}{path}"
        hosts = self.headers.get_all("Host") or []
        origins = self.headers.get_all("Origin") or []
        reached = str(self.connection.getsockname()[0])
        behind = owner.gate.admit(path, hosts, origins, reached)
        self.server.admit(self.client_address)
        return behind

    @property
    def _cookie_name(self) -> str:
        return f"sim2vr_{self.server.owner.port}"

    def _has_cookie(self) -> bool:
        try:
            found = SimpleCookie(self.headers.get("Cookie", "")).get(self._cookie_name)
        except CookieError:
            return False
        given = "" if found is None else found.value
        return hmac.compare_digest(given.encode(), self.server.owner.cookie.encode())

    def _refuse(self, status: int, why: str) -> None:
        self.close_connection = True  # what follows may be a body
        self._answer(status, f"{why}\n".encode(), "text/plain; charset=utf-8")

    def _answer(self, status: int, content: bytes, mime: str) -> None:
        owner = self.server.owner
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if status == 200:
            self.send_header("Content-Type", mime)
            self.send_header(
                "Set-Cookie",
                f"{self._cookie_name}={owner.cookie}; Path=/; HttpOnly; SameSite=Strict",
            )
        elif content:
            self.send_header("Content-Type", mime)
        if self.close_connection:
            self.send_header("Connection", "close")
        if status != 204:
            self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: addresses hold the token."""


def _content(owner: RecordingServer, plain: str) -> tuple[int, bytes, str]:
    """Status, content and type of a file of the page's folder; hidden ones are not served."""
    path = plain.lstrip("/")
    if any(part.startswith(".") for part in path.split("/")):
        return 404, b"no such file\n", "text/plain"
    with owner.lock:
        found = owner.files.answer(HOST + quote(path))
    if found.status != 200:
        return 404, b"no such file\n", "text/plain"
    content = found.content
    if path in (owner.name, owner.name.removesuffix("index.html")):
        content = with_script(content, f"/{owner.gate.token}{_OWN}recorder.js")
    return 200, content, found.mime
