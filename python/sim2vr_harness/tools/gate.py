"""Checks that every request to a local server must pass: host, origin and token.

Browsers let any page send requests to servers of the same machine. ``Origin`` names the page that
sends a request, ``Host`` the name under which it reached the server: a page that points its own
domain at this machine (DNS rebinding) sends a foreign ``Host``. The token stops all others.
"""

import hmac
import re
import secrets
from collections.abc import Sequence

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
}
"""Headers of every answer: no other page may frame it, and no link may pass the token on."""
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_HOST = re.compile(r"(?:\[(?P<v6>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(?::[0-9]{1,5})?")
_TOKEN_BYTES = 24


class Refused(Exception):
    """A request that may not pass, and the reason in one sentence."""


class Gate:
    """Decide whether a request may reach a server.

    Args:
        host: Address that the server listens on.

    Attributes:
        token: First part of every path that the server answers; random.
    """

    def __init__(self, host: str) -> None:
        self.token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._host = host.lower()
        self._names = {*_LOOPBACK, self._host}

    def address(self, port: int, scheme: str = "http") -> str:
        """Return the address to open in a browser; it holds the token."""
        host = "localhost" if self._host in ("", "0.0.0.0", "::") else self._host
        name = f"[{host}]" if ":" in host else host
        return f"{scheme}://{name}:{port}/{self.token}/"

    def accept_name(self, name: str) -> None:
        """Accept one more host name, such as that of a tunnel."""
        self._names.add(name.lower())

    def admit(
        self, path: str, hosts: Sequence[str], origins: Sequence[str], reached: str = ""
    ) -> str:
        """Return the path behind the token.

        Args:
            path: Path and query of the request.
            hosts: Values of its ``Host`` headers.
            origins: Values of its ``Origin`` headers; programs and plain links send none.
            reached: Address of this machine at which the connection arrived.

        Raises:
            Refused: The request has a foreign host or origin, or not the token.
        """
        host = hosts[0].lower() if len(hosts) == 1 else ""
        match = _HOST.fullmatch(host)
        name = (match["v6"] or match["name"]) if match else None
        if name not in self._names | {reached.lower().removeprefix("::ffff:")}:
            raise Refused(f"Host: got {list(hosts)!r:.200}, expected the address of this server.")
        if origins and [each.lower() for each in origins] not in (
            [f"http://{host}"],
            [f"https://{host}"],
        ):
            raise Refused(f"Origin: got {list(origins)!r:.200}, expected a page of this server.")
        plain, mark, query = path.partition("?")
        given, _, rest = plain.removeprefix("/").partition("/")
        if not hmac.compare_digest(given.encode(errors="surrogateescape"), self.token.encode()):
            raise Refused("Token: the address lacks it; open the address that the command printed.")
        return "/" + rest + mark + query
