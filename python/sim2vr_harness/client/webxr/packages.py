"""Find the npm package behind an address, by the rules of the host."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import unquote


@dataclass(frozen=True)
class PackageAddress:
    """What an address asks for.

    Attributes:
        name: of the npm package.
        wanted: its version, range or tag; "latest" without one.
        prefix: the beginning of the address that means the package's folder, with a final slash;
            or the whole address where only this file is meant.
        path: of the file within the package; "": the package's own main file.
        loose: whether the file may lie elsewhere in the package, under the same name.
        module: whether the host converts the package to a JavaScript module.
    """

    name: str
    wanted: str
    prefix: str
    path: str
    loose: bool = False
    module: bool = False

    @property
    def spec(self) -> str:
        """Name and version as npm takes them."""
        return f"{self.name}@{self.wanted}"


NPM_NAME = re.compile(r"(?:@[\w~-][\w.~-]*/)?[\w~][\w.~-]*", re.ASCII)
"""A package of the registry; what npm would take for an option, a folder or an address is none."""
_NPM_VERSION = re.compile(r"[\w.^~<>=*+| -]+", re.ASCII)

_NAME = r"(?P<name>(?:@[\w.~-]+/)?[a-zA-Z0-9][\w.~-]*?)"
_VERSION = r"(?:@(?P<version>[\w.^~<>=*+% -]+))?"
_PATH = r"(?P<path>/[^?#]*)?"
_HOSTED = re.compile(
    r"https?://(?:cdn\.jsdelivr\.net/npm|(?:www\.)?unpkg\.com|esm\.run)/"
    rf"{_NAME}{_VERSION}{_PATH}(?P<query>\?[^#]*)?"
)
_CONVERTED = re.compile(
    r"https?://(?:cdn\.skypack\.dev|(?:cdn\.)?esm\.sh)/(?:stable/|v\d+/)?(?:pin/)?"
    rf"{_NAME}{_VERSION}{_PATH}(?P<query>\?[^#]*)?"
)
_LIBRARIES = re.compile(
    r"https?://(?:cdnjs\.cloudflare\.com|ajax\.googleapis\.com)/ajax/libs/"
    r"(?P<name>[\w.@-]+)/(?P<version>[\w.-]+)/(?P<path>[^?#]+)"
)
_AFRAME = re.compile(
    r"https?://(?:www\.)?aframe\.io/releases/(?P<version>\d[\w.-]*|latest)/(?P<file>aframe[^/?#]*\.js)"
)
_THREE = re.compile(r"https?://(?:www\.)?threejs\.org/(?P<path>(?:build|examples/jsm)/[^?#]*)")
_BABYLON = re.compile(
    r"https?://(?:cdn|preview)\.babylonjs\.com/(?:v(?P<version>\d+\.\d+\.\d+)/)?"
    r"(?:(?P<part>\w+)/)?(?P<file>babylon[\w.]*\.js)"
)
_PLAYCANVAS = re.compile(
    r"https?://code\.playcanvas\.com/playcanvas-(?P<version>[\d.]+|stable|latest)(?:\.min)?\.(?P<end>m?js)"
)

_LIBRARY_NAMES = {"three.js": "three", "threejs": "three", "tween.js": "@tweenjs/tween.js"}
"""Names of libraries that are not their npm package's, beside those that only drop ``.js``."""
_BABYLON_PARTS = {
    "loaders": "babylonjs-loaders",
    "gui": "babylonjs-gui",
    "materialsLibrary": "babylonjs-materials",
    "proceduralTexturesLibrary": "babylonjs-procedural-textures",
    "postProcessesLibrary": "babylonjs-post-process",
    "serializers": "babylonjs-serializers",
}
_KEEP_DOT_JS = ("tween.js", "stats.js", "highlight.js", "chart.js", "p5.js")


def package_of(address: str) -> PackageAddress | None:
    """Return the package behind an address; None: no npm package is known to be there."""
    for read in _READERS:
        if found := read(address):
            good = NPM_NAME.fullmatch(found.name) and _NPM_VERSION.fullmatch(found.wanted)
            return found if good else None
    return None


def _hosted(address: str) -> PackageAddress | None:
    found = _HOSTED.fullmatch(address.partition("#")[0])
    if found is None or found["name"] in ("combine", "npm"):
        return None
    path = unquote(found["path"] or "").lstrip("/")
    whole = address[: found.end("version")] if found["version"] else address[: found.end("name")]
    converts = address.startswith(("https://esm.run/", "http://esm.run/"))
    if converts or path.endswith("+esm") or "module" in (found["query"] or ""):
        inner = path.removesuffix("+esm").strip("/")
        plain = address.partition("?")[0]
        return PackageAddress(found["name"], _version(found["version"]), plain, inner, module=True)
    return PackageAddress(
        found["name"], _version(found["version"]), f"{whole}/" if path else whole, path
    )


def _converted(address: str) -> PackageAddress | None:
    found = _CONVERTED.fullmatch(address.partition("#")[0])
    if found is None or found["name"] == "new":
        return None
    path = unquote(found["path"] or "").strip("/")
    plain = address.partition("?")[0]
    return PackageAddress(found["name"], _version(found["version"]), plain, path, module=True)


def _version(text: str | None) -> str:
    """A version of an address; skypack writes pinned ones as ``v1.2.3-HASH``."""
    if not text:
        return "latest"
    pinned = re.fullmatch(r"v(\d+\.\d+\.\d+)-\w{10,}", unquote(text))
    return pinned[1] if pinned else unquote(text)


def _library(address: str) -> PackageAddress | None:
    found = _LIBRARIES.match(address)
    if found is None:
        return None
    name, version = found["name"].lower(), found["version"]
    package = _LIBRARY_NAMES.get(name) or (
        name if name in _KEEP_DOT_JS else name.removesuffix(".js")
    )
    if package == "three" and (release := re.fullmatch(r"r(\d+)", version)):
        version = f"0.{release[1]}"
    whole = address.partition("?")[0]
    return PackageAddress(package, version, whole, found["path"], loose=True)


def _aframe(address: str) -> PackageAddress | None:
    found = _AFRAME.match(address)
    if found is None:
        return None
    file = found["file"].replace("aframe.js", "aframe-master.js")
    file = file.replace("aframe.min.js", "aframe-master.min.js")
    return PackageAddress(
        "aframe", found["version"], address.partition("?")[0], f"dist/{file}", loose=True
    )


def _three(address: str) -> PackageAddress | None:
    found = _THREE.match(address)
    if found is None:
        return None
    folder = address[: found.start("path")]
    return PackageAddress("three", "latest", folder, found["path"])


def _babylon(address: str) -> PackageAddress | None:
    found = _BABYLON.match(address)
    package = "babylonjs" if found and not found["part"] else None
    if found and found["part"]:
        package = _BABYLON_PARTS.get(found["part"])
    if found is None or package is None:
        return None
    whole = address.partition("?")[0]
    return PackageAddress(package, found["version"] or "latest", whole, found["file"], loose=True)


def _playcanvas(address: str) -> PackageAddress | None:
    found = _PLAYCANVAS.match(address)
    if found is None:
        return None
    version = found["version"] if found["version"][0].isdigit() else "latest"
    whole = address.partition("?")[0]
    path = f"build/playcanvas.{found['end']}"
    return PackageAddress("playcanvas", version, whole, path, loose=True)


_READERS: tuple[Callable[[str], PackageAddress | None], ...] = (
    _hosted,
    _converted,
    _library,
    _aframe,
    _three,
    _babylon,
    _playcanvas,
)
