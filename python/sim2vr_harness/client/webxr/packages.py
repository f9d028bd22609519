"""Find the npm package behind an address, by the rules of the host."""

import re
from dataclasses import dataclass
from urllib.parse import unquote


@dataclass(frozen=True)
class PackageAddress:
    """npm package and file that an address requests.

    Attributes:
        name: name of the npm package.
        wanted: version, range or tag; "latest" without one.
        prefix: the beginning of the address that means the package's folder, with a final slash;
            or the whole address where only this file is meant.
        path: path of the file within the package; "": the package's own main file.
        loose: true if the file may lie elsewhere in the package, under the same name.
        module: true if the host converts the package to a JavaScript module.
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


_HOSTS = {
    "files": _HOSTED,
    "modules": _CONVERTED,
    "libraries": _LIBRARIES,
    "aframe": _AFRAME,
    "three": _THREE,
    "babylon": _BABYLON,
    "playcanvas": _PLAYCANVAS,
}


def package_of(address: str) -> PackageAddress | None:
    """Return the package behind an address; None: no npm package is known to be there."""
    whole = address.partition("#")[0]
    for host, pattern in _HOSTS.items():
        asked = whole if "query" in pattern.groupindex else whole.partition("?")[0]
        if match := pattern.fullmatch(asked):
            package = _package(host, match, asked)
            if package is None or NPM_NAME.fullmatch(package.name) is None:
                return None
            return package if _NPM_VERSION.fullmatch(package.wanted) else None
    return None


def _package(host: str, match: re.Match[str], address: str) -> PackageAddress | None:
    """Return the package of an address by the rules of its host."""
    found = match.groupdict()
    whole = address.partition("?")[0]
    name, path = found.get("name") or host, unquote(found.get("path") or "").strip("/")
    version = unquote(found.get("version") or "latest")
    if pinned := re.fullmatch(r"v(\d+\.\d+\.\d+)-\w{10,}", version):  # skypack's
        version = pinned[1]
    match host:
        case "files":
            if name in ("combine", "npm"):
                return None
            if (
                "//esm.run/" in address
                or path.endswith("+esm")
                or "module" in (found["query"] or "")
            ):
                inner = path.removesuffix("+esm").strip("/")
                return PackageAddress(name, version, whole, inner, module=True)
            end = match.end("version") if found["version"] else match.end("name")
            return PackageAddress(name, version, address[:end] + ("/" if path else ""), path)
        case "modules":
            if name == "new":
                return None
            return PackageAddress(name, version, whole, path, module=True)
        case "libraries":
            name = name.lower()
            own = name if name in _KEEP_DOT_JS else name.removesuffix(".js")
            name = _LIBRARY_NAMES.get(name, own)
            if name == "three" and (release := re.fullmatch(r"r(\d+)", version)):
                version = f"0.{release[1]}"
        case "aframe":
            file = re.sub(r"^aframe((?:\.min)?\.js)$", r"aframe-master\1", found["file"])
            path = f"dist/{file}"
        case "three":
            return PackageAddress("three", "latest", address[: match.start("path")], path)
        case "babylon":
            package = _BABYLON_PARTS.get(found["part"]) if found["part"] else "babylonjs"
            if package is None:
                return None
            name, path = package, found["file"]
        case "playcanvas":
            version = version if version[0].isdigit() else "latest"
            path = f"build/playcanvas.{found['end']}"
    return PackageAddress(name, version, whole, path, loose=True)
