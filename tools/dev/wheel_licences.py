"""Puts into a wheel the licences of what it carries: shared libraries, and headers compiled in.

    python tools/dev/wheel_licences.py WHEEL FOLDER

auditwheel copies the libraries of Debian's or Ubuntu's packages into ``*.libs``. Each package says
in ``/usr/share/doc/PACKAGE/copyright`` who wrote it and what one may do with it; that page, and the
licences of ``/usr/share/common-licenses`` that it refers to, go to
``*.dist-info/licenses/carried``, with a list of what is there.
"""

import re
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

from auditwheel.wheeltools import InWheelCtx

DOCS, COMMON = Path("/usr/share/doc"), Path("/usr/share/common-licenses")
HEADERS = (
    "libeigen3-dev",
    "libcli11-dev",
    "libfmt-dev",
    "libspdlog-dev",
    "nlohmann-json3-dev",
    "cppzmq-dev",
    "libopenxr-dev",
)
"""Packages whose headers become part of the app and of the extension module."""


def original_name(library: str) -> str:
    """What a library was called before auditwheel put part of its hash into its name."""
    return re.sub(r"-[0-9a-f]{8}(?=\.)", "", library, count=1)


def package_of(library: str) -> str:
    """The package that a library comes from.

    Raises:
        ValueError: No package has it.
    """
    name = original_name(library)
    found = subprocess.run(
        ["dpkg", "-S", f"*/{name}"], capture_output=True, text=True, check=False
    ).stdout.splitlines()
    if not found:
        raise ValueError(f"{library}: got no package with {name}, expected one of Debian or Ubuntu")
    return found[0].partition(":")[0]


def version_of(package: str) -> str:
    """Which version of a package is installed."""
    asked = ["dpkg-query", "-W", "-f", "${Version}", package]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout


def copyright_of(package: str) -> str:
    """The page of a package that says its licence."""
    return (DOCS / package / "copyright").read_text(encoding="utf-8", errors="replace")


def pybind11_licence() -> tuple[str, str]:
    """Version and licence of pybind11, which is no Debian package here."""
    found = distribution("pybind11")
    files = [file for file in found.files or () if file.name.upper().startswith("LICENSE")]
    return found.version, files[0].read_text()


def carried(libraries: list[str]) -> dict[str, str]:
    """Return the files to add, name -> text.

    Args:
        libraries: Names of those in the wheel.
    """
    by_package: dict[str, list[str]] = {package: ["headers"] for package in HEADERS}
    for library in sorted(libraries):
        by_package.setdefault(package_of(library), []).append(library)
    files: dict[str, str] = {}
    rows = []
    for package, parts in sorted(by_package.items()):
        files[f"{package}.txt"] = copyright_of(package)
        rows.append(f"| {package} | {version_of(package)} | {', '.join(parts)} |")
    version, text = pybind11_licence()
    files["pybind11.txt"] = text
    rows.append(f"| pybind11 (PyPI) | {version} | headers |")
    for name in sorted({name for text in files.values() for name in common_licences(text)}):
        licence = (COMMON / name).read_text(encoding="utf-8", errors="replace")
        files[f"common-licenses/{name}"] = licence
    files["README.md"] = "\n".join(
        [
            "# What this wheel carries",
            "",
            "Shared libraries of Debian's or Ubuntu's packages, unchanged but for where they look",
            "for each other, and headers that are compiled in. A page here for each package;",
            "licences that the pages refer to are in common-licenses. The packages' sources:",
            "packages.debian.org.",
            "",
            "| package | version | what |",
            "|---|---|---|",
            *rows,
            "",
        ]
    )
    return files


def common_licences(text: str) -> set[str]:
    """Names of the licences in ``/usr/share/common-licenses`` that a page refers to."""
    named = re.findall(r"/usr/share/common-licenses/([A-Za-z0-9.+-]+)", text)
    return {name for name in (one.rstrip(".") for one in named) if (COMMON / name).is_file()}


def add_licences(wheel: Path, folder: Path) -> Path:
    """Write a copy of a wheel with the licences in it, and return it.

    Raises:
        ValueError: A library is of no package.
    """
    # auditwheel writes its wheel whatever happened; only a whole one gets its name.
    made, part = folder / wheel.name, folder / f".{wheel.name}.part"
    try:
        _write(wheel, part)
        part.rename(made)
    finally:
        part.unlink(missing_ok=True)
    return made


def _write(wheel: Path, made: Path) -> None:
    with InWheelCtx(wheel, made) as inside:
        root = Path(inside.name)
        files = carried([file.name for file in root.glob("*.libs/*.so*")])
        (info,) = root.glob("*.dist-info")
        for name, text in files.items():
            place = info / "licenses" / "carried" / name
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text, encoding="utf-8")
        metadata = (info / "METADATA").read_text(encoding="utf-8")
        headers, blank, rest = metadata.partition("\n\n")
        told = "".join(f"\nLicense-File: carried/{name}" for name in sorted(files))
        (info / "METADATA").write_text(headers + told + blank + rest, encoding="utf-8")


if __name__ == "__main__":
    print(add_licences(Path(sys.argv[1]), Path(sys.argv[2])))
