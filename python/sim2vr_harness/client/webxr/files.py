"""Local files for the addresses of a page; other requests are refused and named."""

import mimetypes
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.limits import Kept

HOST = "https://page.invalid/"
"""Address of a page that is a local file: a name that cannot be resolved (RFC 2606), with a scheme
for which browsers allow WebXR."""

MOST_BYTES = 1 << 28
"""A file that is larger is not served."""

MOST_ASKED = 1000
MOST_CHARACTERS = 2000

MOST_LEVELS = 3
"""Number of folders above the page's folder in which a missing file is searched."""

_TYPES = {
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".json": "application/json",
    ".wasm": "application/wasm",
    ".gltf": "model/gltf+json",
    ".glb": "model/gltf-binary",
    ".hdr": "image/vnd.radiance",
    ".ktx2": "image/ktx2",
    ".html": "text/html; charset=utf-8",
    ".htm": "text/html; charset=utf-8",
}

_SOURCES = (".ts", ".tsx", ".jsx", ".vue", ".svelte")
"""Ends of files that a build makes scripts of; no browser runs them."""


@dataclass(frozen=True)
class Answer:
    """Response to a request of the page.

    Attributes:
        status: 200, 404, or 0: refused, no such host.
        content: bytes of the file.
        mime: MIME type of the file.
    """

    status: int
    content: bytes = b""
    mime: str = "text/plain"


class PageFiles:
    """A page and the addresses that it may load from.

    Args:
        page: a file, a folder with an ``index.html``, or an address below one of ``mapped``.
        mapped: beginning of addresses -> local folder; or a whole address -> local file.

    Raises:
        AppRefused: there is no such page or folder; names it.
    """

    def __init__(self, page: str, mapped: Mapping[str, str]) -> None:
        self._folders: dict[str, Path] = {}
        for prefix, place in mapped.items():
            self._folders[_checked_prefix(prefix)] = _checked_place(prefix, place)
        self.name = page
        self.url = page if "://" in page else self._url_of_file(Path(page).expanduser())
        self.origin = "{0.scheme}://{0.netloc}".format(urlsplit(self.url))
        self.missing = Kept()
        """Addresses below a mapped one, without a file."""
        self.refused = Kept()
        """Addresses that are mapped nowhere."""
        self.sources = Kept()
        """Addresses of source code that has to be built."""
        self.asked: dict[str, int] = {}
        """Status of each address of this round; of so many at most that a page cannot fill."""
        self.outside: str | None = None
        """The options that serve a missing file which lies above the page's folder."""
        if self.answer(self.url).status != 200:
            raise AppRefused(
                f"app.page: got {page!r}, which is no file"
                + (" below the addresses of app.map" if "://" in page else "")
                + ", expected a page in HTML"
            )
        self.clear()

    def _url_of_file(self, file: Path) -> str:
        file = file.absolute()
        if file.is_dir():
            file = file / "index.html"
        if not file.is_file():
            raise AppRefused(
                f"app.page: got {self.name!r}, which is no file, expected a page in HTML or a "
                "folder with an index.html"
            )
        self._folders[HOST] = file.parent.resolve()
        return HOST + quote(file.name)

    def answer(self, url: str) -> Answer:
        """Return what a request for an address gets."""
        plain = url.split("#")[0].split("?")[0]
        if plain.startswith(("data:", "blob:", "about:")):
            return Answer(200)
        best = max((one for one in self._folders if plain.startswith(one)), key=len, default=None)
        if best is None:
            self.refused.add(url)
            self._note(plain, 0)
            return Answer(0)
        place, rest = self._folders[best], unquote(plain[len(best) :])
        found = _content(place, rest)
        if found is None:
            if not plain.endswith("/favicon.ico"):  # the browser looks for it by itself
                self.missing.add(url)
                self._note(plain, 404)
                self.outside = self.outside or self._outside(plain)
            return Answer(404, b"no such file")
        file, content = found
        self._note(plain, 200)
        if file.suffix.lower() in _SOURCES and b"\0" not in content[:1000]:  # .ts may be a video
            self.sources.add(plain)
        mime = _TYPES.get(file.suffix.lower()) or mimetypes.guess_type(file.name)[0]
        return Answer(200, content, mime or "application/octet-stream")

    def clear(self) -> None:
        """Forget what was requested."""
        self.missing.clear()
        self.refused.clear()
        self.sources.clear()
        self.asked.clear()

    def _note(self, address: str, status: int) -> None:
        if len(self.asked) < MOST_ASKED:
            self.asked[address[:MOST_CHARACTERS]] = status

    def _outside(self, url: str) -> str | None:
        """Return the options that serve an address from a folder above the page's; None: no such.

        A browser drops the ``..`` of an address that leaves its host's root.
        """
        if "://" in self.name or not url.startswith(HOST):
            return None
        folder, rest = self._folders[HOST], unquote(url[len(HOST) :])
        for above in list(folder.parents)[:MOST_LEVELS]:
            if _content(above, rest):
                page = quote(str(folder.relative_to(above))) + "/" + self.url[len(HOST) :]
                return f"--page {HOST}{page} --map {HOST}={above}"
        return None


def _content(place: Path, rest: str) -> tuple[Path, bytes] | None:
    """Return a file and its bytes; None where the address means none that can be read."""
    try:
        if place.is_dir():
            file = file_inside(place, rest) or file_inside(place, f"{rest}/index.html")
        else:
            file = None if rest else place
        if file is None or file.stat().st_size > MOST_BYTES:
            return None
        return file, file.read_bytes()
    except OSError:  # a name that is too long, a file that may not be read
        return None


def file_inside(folder: Path, path: str) -> Path | None:
    """Return the file at a path within a folder, links followed; None outside or without one."""
    if "\0" in path:
        return None
    file = Path(os.path.realpath(folder / path.lstrip("/")))
    inside = file.is_relative_to(os.path.realpath(folder))
    return file if inside and file.is_file() else None


def _checked_prefix(prefix: str) -> str:
    parts = urlsplit(prefix)
    if parts.scheme not in ("http", "https") or not parts.netloc:
        raise AppRefused(
            f"app.map: got {prefix!r}, expected the beginning of an address, such as "
            "https://cdn.jsdelivr.net/npm/three@0.187.0/"
        )
    return prefix if parts.path else prefix + "/"


def _checked_place(prefix: str, place: str) -> Path:
    found = Path(place).expanduser()
    if not found.exists():
        raise AppRefused(
            f"app.map: got {place!r} for {prefix}, which is not there, expected a folder or a file"
        )
    return found.resolve()
