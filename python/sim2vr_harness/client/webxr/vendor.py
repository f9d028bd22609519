"""npm packages of a page, fetched into a folder beside a map of addresses.

Packages that hosts convert become JavaScript modules with imports by address.

npm itself fetches: from its cache where it can, without running any script of a package.
"""

import base64
import gzip
import hashlib
import io
import json
import os
import posixpath
import re
import shutil
import subprocess
import tarfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from sim2vr_harness.base.errors import InputError, printable, shown
from sim2vr_harness.base.files import read_bytes, read_json, read_text
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.temporary import TemporaryFolder
from sim2vr_harness.client.webxr.files import file_inside
from sim2vr_harness.client.webxr.packages import NPM_NAME, PackageAddress, package_of

MAP_FILE = "map.json"
"""Name of the file that says which folder an address means."""
NPM_TIMEOUT_S = 300.0
MOST_PACKED = 1 << 28
"""Bytes of a package's archive."""
MOST_UNPACKED = 1 << 29
"""Bytes of a package; those of the known engines have up to 1 << 27."""
MOST_FILES = 100_000
"""Files of a package."""
_VERSION = re.compile(r"\d[\w.+-]*", re.ASCII)


@dataclass(frozen=True)
class Unvendored:
    """An address that stays without a file.

    Attributes:
        address: that the page asks for.
        why: in words.
    """

    address: str
    why: str


def read_map(file: Path) -> dict[str, str]:
    """Return the addresses of a map file with the folders and files that they mean.

    Args:
        file: JSON: beginning of an address -> folder or file, from the map's own folder.

    Raises:
        InputError: it is another thing.
    """
    content = read_json(file, "a map file")
    if not isinstance(content, dict) or not all(
        isinstance(place, str) and "://" in address for address, place in content.items()
    ):
        raise InputError(
            str(file), "another thing", "an object: beginnings of addresses with their folders"
        )
    return {
        address: str((file.absolute().parent / place).resolve())
        for address, place in content.items()
    }


def packages_behind(addresses: Iterable[str]) -> tuple[list[PackageAddress], list[Unvendored]]:
    """Return the npm packages behind addresses, and the addresses without one."""
    found: dict[str, PackageAddress] = {}
    without = []
    for address in dict.fromkeys(addresses):
        package = package_of(address)
        if package is None:
            without.append(Unvendored(address, "no npm package is known to be there"))
        else:
            found.setdefault(f"{package.prefix} {package.path}", package)
    return [*found.values()], without


def vendor(wanted: Iterable[PackageAddress], folder: Path) -> list[Unvendored]:
    """Fetch packages into a folder and write its map file.

    Args:
        wanted: what to fetch.
        folder: gets ``NAME@VERSION/`` for each package; what it has is kept.

    Returns:
        What could not be had.

    Raises:
        AppRefused: npm is not there, or a package is not what npm says it is.
    """
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    file = folder / MAP_FILE
    mapped: dict[str, str] = read_json(file, "a map file") if file.exists() else {}
    without = []
    fetched: dict[str, Path | str] = {}
    for package in wanted:
        if package.spec not in fetched:
            fetched[package.spec] = _fetch(package, folder)
        place = fetched[package.spec]
        if isinstance(place, str):
            without.append(Unvendored(package.prefix, place))
            continue
        if package.module:
            if why := convert(package, place, folder, mapped):
                without.append(Unvendored(package.prefix, why))
            continue
        target: Path | None = place
        if not package.prefix.endswith("/") or package.loose:
            target = _file_of(package, place)
        if target is None:
            why = f"{package.spec} has no {package.path or 'main file'}"
            without.append(Unvendored(package.prefix, why))
            continue
        mapped[package.prefix] = os.path.relpath(target, folder)
        _map_minified(package, place, folder, mapped)
    file.write_text(json.dumps(dict(sorted(mapped.items())), indent=2) + "\n")
    return without


def _map_minified(
    package: PackageAddress, place: Path, folder: Path, mapped: dict[str, str]
) -> None:
    """Map a file that the host makes by shortening another one to that one."""
    if package.module or package.loose or not package.path.endswith((".min.js", ".min.css")):
        return
    end = package.path.rpartition(".min.")[2]
    longer = file_inside(place, f"{package.path.removesuffix(f'.min.{end}')}.{end}")
    if longer is not None and file_inside(place, package.path) is None:
        mapped[package.prefix + package.path] = os.path.relpath(longer, folder)


def _file_of(package: PackageAddress, place: Path) -> Path | None:
    """Return the one file that an address means within a package."""
    if not package.path:
        # Package's own main file, as the host of the address reads it.
        description_content = read_json(place / "package.json", "a package's description")
        content = description_content if isinstance(description_content, dict) else {}
        host = urlsplit(package.prefix).netloc
        keys = ("jsdelivr", "browser", "main") if "jsdelivr" in host else ("unpkg", "main")
        for key in keys:
            name = content.get(key)
            if not isinstance(name, str):
                continue
            for end in ("", ".js", "/index.js"):
                if file := file_inside(place, f"{name}{end}"):
                    return file
        return file_inside(place, "index.js")
    if file := file_inside(place, package.path):
        return file
    name = Path(package.path).name
    names = [name]
    if ".min." in name:
        names.append(name.replace(".min.", "."))
    for wanted in names:
        found = [
            one
            for one in place.rglob("*")
            if one.name == wanted and one.is_file() and "node_modules" not in one.parts
        ]
        if found:
            return min(found, key=lambda one: (len(one.parts), str(one)))
    return None


def _fetch(package: PackageAddress, folder: Path) -> Path | str:
    """Return a package's folder, fetched where it is missing; or why there is none."""
    home = TemporaryFolder()
    try:
        answer = _npm("pack", package.spec, "--pack-destination", str(home.path))
        if isinstance(answer, str):
            return answer
        match answer:
            case [{"name": package.name, "version": str(version), "filename": str(file)}] if (
                _VERSION.fullmatch(version)
            ):
                archive = file_inside(home.path, file)
            case _:
                archive = None
        if archive is None:
            raise AppRefused(
                f"{package.spec}: got {shown(answer)} of npm, expected the package's name, "
                "version and filename"
            )
        spec = f"{package.name}@{version}"
        place = folder / spec
        if place.exists():
            return place
        content = read_bytes(archive, "an npm package", most=MOST_PACKED)
        _check_integrity(spec, content)
        try:
            _extract(content, place)
        except (tarfile.TarError, OSError, EOFError, ValueError, zlib.error) as error:
            raise AppRefused(f"{spec}: its archive cannot be unpacked: {error}") from error
        return place
    finally:
        home.remove()


def _npm(*arguments: str) -> Any:
    """Return what npm prints, or in words why it fails.

    Raises:
        AppRefused: there is no npm.
    """
    program = shutil.which("npm")
    if program is None:
        raise AppRefused("npm: got none on the PATH, expected it (apt-get install npm)")
    command = [program, *arguments, "--json", "--ignore-scripts", "--prefer-offline", "--silent"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=NPM_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"npm gave no answer within {NPM_TIMEOUT_S:g} s"
    try:
        answer = json.loads(done.stdout or "null")
    except ValueError:
        answer = None
    if done.returncode == 0 and answer is not None:
        return answer
    match answer:
        case {"error": {"code": str(code)}}:
            return f"npm has no {arguments[1]} ({printable(code)})"
    return f"npm has no {arguments[1]} (status {done.returncode})"


def _check_integrity(spec: str, archive: bytes) -> None:
    """Compare a package with the checksum that npm has of it.

    Raises:
        AppRefused: they differ.
    """
    answer = _npm("view", spec, "dist.integrity")
    expected = str(answer).split() if not isinstance(answer, dict) else []
    for one in expected:
        kind, _, digest = one.partition("-")
        if kind in ("sha512", "sha384", "sha256"):
            got = base64.b64encode(hashlib.new(kind, archive).digest()).decode()
            if got == digest:
                return
            break
    raise AppRefused(f"{spec}: its archive has another checksum than npm has of it")


def _extract(archive: bytes, place: Path) -> None:
    """Write the files of a package; its own top folder is left out.

    Only contents of regular files are written: no links, owners or permissions. The filters of
    :mod:`tarfile` would do this, but Python has them from 3.11.4 only.

    Raises:
        OSError: it is no archive, a file would lie outside the folder, or there are too many.
    """
    with gzip.GzipFile(fileobj=io.BytesIO(archive)) as stream:
        plain = stream.read(MOST_UNPACKED + 1)
    too_large = OSError(f"got more than {MOST_UNPACKED:,} bytes, expected at most so many")
    if len(plain) > MOST_UNPACKED:
        raise too_large
    partial = place.with_name(f"{place.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    size = 0
    try:
        with tarfile.open(fileobj=io.BytesIO(plain)) as packed:
            for count, member in enumerate(packed, start=1):
                size += member.size  # of a sparse file: more than the archive has
                if size > MOST_UNPACKED:
                    raise too_large
                if count > MOST_FILES:
                    raise OSError(f"got more than {MOST_FILES:,} files, expected at most so many")
                name = member.name.partition("/")[2]
                content = packed.extractfile(member) if member.isreg() and name else None
                if content is None:
                    continue
                file = partial / name
                if not file.resolve().is_relative_to(partial):
                    raise OSError(f"{shown(name)} lies outside its folder")
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content.read())
        partial.rename(place)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


# --- modules ---------------------------------------------------------------------------------

_FOLDER = "modules"
_IMPORT = re.compile(r"""(\bfrom\s*|\bimport\s*\(?\s*)(["'])([^"'\s]+)\2""")
_DEFAULT = re.compile(r"\bexport\s+default\b|\bas\s+default\b")
_CONDITIONS = ("browser", "import", "module", "default")


def convert(
    package: PackageAddress, place: Path, folder: Path, mapped: dict[str, str]
) -> str | None:
    """Write what a host of modules answers at an address, and map it.

    Args:
        package: the address.
        place: the package's folder.
        folder: that of the map.
        mapped: addresses -> places in the folder, which gets those of the modules.

    Returns:
        Why it cannot be had; None: it is there.
    """
    content = read_json(place / "package.json", "a package's description")
    entry = _entry(content, place, package.path)
    if entry is None:
        return (
            f"{package.spec} has no ES module{' ' + package.path if package.path else ''}; "
            "a bundle of the page (such as vite build) needs none"
        )
    host = _host_of(package)
    own = f"{host}sim2vr/{place.relative_to(folder).as_posix()}/"
    _copy(_Copying(place, folder, package, own, content), entry)
    mapped[own] = f"{_FOLDER}/{place.relative_to(folder).as_posix()}"
    lines = [f'export * from "{own}{entry}";']
    if _DEFAULT.search(read_text(place / entry, "a module")):
        lines.append(f'export {{ default }} from "{own}{entry}";')
    stub = folder / _FOLDER / "addresses" / f"{re.sub(r'[^a-zA-Z0-9]+', '_', package.prefix)}.js"
    stub.parent.mkdir(parents=True, exist_ok=True)
    stub.write_text("\n".join(lines) + "\n")
    mapped[package.prefix] = stub.relative_to(folder).as_posix()
    return None


class _Copying:
    """Shared state of the copies of a package's modules."""

    def __init__(
        self,
        place: Path,
        folder: Path,
        package: PackageAddress,
        own: str,
        content: Mapping[str, Any],
    ) -> None:
        self.place, self.folder, self.own = place, folder, own
        self.content, self.package = content, package
        self.to = folder / _FOLDER / place.relative_to(folder)
        self.done: set[str] = set()


def _copy(job: _Copying, start: str) -> None:
    """Copy a module and all that it imports from its package, imports rewritten to addresses."""
    left = [start]
    while left:
        name = left.pop()
        if name in job.done:
            continue
        job.done.add(name)

        def address(found: re.Match[str], name: str = name) -> str:
            word, quote, target = found.groups()
            if "://" in target or target.startswith(("data:", "/")):
                return found[0]
            if target.startswith("."):
                path = posixpath.normpath(posixpath.join(posixpath.dirname(name), target))
                ends = ("", ".js", ".mjs", "/index.js")
                inner = next(
                    (one for end in ends if (one := _own_file(job.place, path + end))), None
                )
            else:
                own, rest = _split(target)
                if own != job.content.get("name"):
                    inner = None
                else:
                    inner = _entry(job.content, job.place, rest)
            if inner is not None:
                left.append(inner)
                target = job.own + inner
            elif not target.startswith("."):
                target = _address_of(job, target)
            return f"{word}{quote}{target}{quote}"

        text = _IMPORT.sub(address, read_text(job.place / name, "a module"))
        to = job.to / name
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_text(text)


def _address_of(job: _Copying, target: str) -> str:
    """Return where a page finds another package: its version there, or that of the wish."""
    name, rest = _split(target)
    if not NPM_NAME.fullmatch(name):
        return target
    wishes: dict[str, Any] = {}
    for key in ("peerDependencies", "dependencies"):
        wished = job.content.get(key)
        wishes |= wished if isinstance(wished, dict) else {}
    there = sorted((job.folder / _FOLDER).glob(f"{name}@*"))
    version = there[-1].name.rpartition("@")[2] if there else str(wishes.get(name, "latest"))
    version = version if re.fullmatch(r"[\w.^~-]+", version) else "latest"
    end = "/+esm" if "jsdelivr" in job.package.prefix else ""
    return f"{_host_of(job.package)}{name}@{version}{'/' + rest if rest else ''}{end}"


def _host_of(package: PackageAddress) -> str:
    parts = urlsplit(package.prefix)
    folder = "npm/" if parts.netloc == "cdn.jsdelivr.net" else ""
    return f"{parts.scheme}://{parts.netloc}/{folder}"


def _split(target: str) -> tuple[str, str]:
    """Return the package and the path of an import such as ``@a/b/c.js``."""
    parts = target.split("/")
    count = 2 if target.startswith("@") else 1
    return "/".join(parts[:count]), "/".join(parts[count:])


def _entry(content: Mapping[str, Any], place: Path, path: str) -> str | None:
    """Return the file of a package that is the module of a path; None: there is none."""
    exported = _exported(content.get("exports"), f"./{path}" if path else ".")
    names: list[object] = [exported] if exported else []
    if path:
        names += [path, f"{path}.js", f"{path}.mjs", f"{path}/index.js"]
    else:
        names.append(content.get("module"))
        main = content.get("main", "index.js")
        if content.get("type") == "module" or str(main).endswith(".mjs"):
            names.append(main)
    for name in names:
        if isinstance(name, str) and (plain := _own_file(place, name)):
            return plain
    return None


def _own_file(place: Path, name: str) -> str | None:
    """Return the path of a package's own file within the package; None: it has no such file."""
    file = file_inside(place, name)
    return None if file is None else os.path.relpath(file, os.path.realpath(place))


def _exported(exports: Any, wanted: str) -> str | None:
    """Return what the field ``exports`` of a package has for a path, for browsers' modules."""
    if isinstance(exports, str):
        return exports if wanted == "." else None
    if isinstance(exports, list):
        return next((one for each in exports if (one := _exported(each, wanted))), None)
    if not isinstance(exports, dict):
        return None
    if not any(str(key).startswith(".") for key in exports):
        chosen = next((exports[key] for key in _CONDITIONS if key in exports), None)
        return _exported(chosen, wanted)
    for key, value in exports.items():
        start, star, end = key.partition("*")
        if not star and key == wanted:
            return _exported(value, ".")
        if star and wanted.startswith(start) and wanted.endswith(end):
            found = _exported(value, ".")
            middle = wanted[len(start) : len(wanted) - len(end)]
            return found.replace("*", middle) if found else None
    return None
