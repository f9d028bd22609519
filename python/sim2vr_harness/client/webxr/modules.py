"""npm packages as the JavaScript modules that some hosts make of them, with imports by address."""

import os
import posixpath
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from sim2vr_harness.base.files import read_json, read_text
from sim2vr_harness.client.webxr.files import file_inside
from sim2vr_harness.client.webxr.packages import NPM_NAME, PackageAddress

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
    """What the copies of a package's modules have in common."""

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
                    (one for end in ends if (one := _file_of(job.place, path + end))), None
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
        if isinstance(name, str) and (plain := _file_of(place, name)):
            return plain
    return None


def _file_of(place: Path, name: str) -> str | None:
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
