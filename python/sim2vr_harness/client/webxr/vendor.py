"""npm packages of a page, fetched into a folder beside a map of addresses.

npm itself fetches: from its cache where it can, without running any script of a package.
"""

import base64
import gzip
import hashlib
import io
import json
import os
import re
import shutil
import subprocess
import tarfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from sim2vr_harness.base.errors import InputError, printable, shown
from sim2vr_harness.base.files import read_bytes, read_json
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.temporary import TemporaryFolder
from sim2vr_harness.client.webxr.files import file_inside
from sim2vr_harness.client.webxr.modules import convert
from sim2vr_harness.client.webxr.packages import PackageAddress, package_of

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
