"""An MJCF before MuJoCo reads it: bounds of its numbers, and the files that it names."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

MOST_ELEMENTS = 10_000
MOST_FILE_BYTES = 200_000_000
MOST_PIXELS = 8192

_SAMPLES = 10_000
MOST = {
    "option.iterations": 10_000,
    "option.ls_iterations": 10_000,
    "option.noslip_iterations": 10_000,
    "option.ccd_iterations": 10_000,
    "option.sdf_iterations": 1000,
    "option.sdf_initpoints": 10_000,
    "size.memory": 2**30,
    "size.nstack": 2**27,
    "size.njmax": 1_000_000,
    "size.nconmax": 1_000_000,
    "size.nkey": 10_000,
    "size.nuserdata": 1_000_000,
    "size.nuser_*": 1000,
    "lengthrange.inttotal": 1000,
    "numeric.size": 100_000,
    "mesh.params": 1000,
    "global.offwidth": MOST_PIXELS,
    "global.offheight": MOST_PIXELS,
    "quality.shadowsize": 16_384,
    "quality.offsamples": 64,
    "quality.num*": 1000,
    "hfield.nrow": 4096,
    "hfield.ncol": 4096,
    "texture.width": MOST_PIXELS,
    "texture.height": MOST_PIXELS,
    "texture.gridsize": 16,
    "camera.resolution": MOST_PIXELS,
    "*.nsample": _SAMPLES,
    "*.actdim": 1000,
    "replicate.count": MOST_ELEMENTS,
    "composite.count": MOST_ELEMENTS,
    "flexcomp.count": MOST_ELEMENTS,
    "flexcomp.cellcount": MOST_ELEMENTS,
}
"""Element and attribute -> the greatest number; of several their product counts for counts."""
LEAST = {"lengthrange.timestep": 1e-4, "option.timestep": 1e-6}
"""Element and attribute -> the least number."""

_FILES = (
    "file",
    "filename",
    "fileback",
    "filedown",
    "filefront",
    "fileleft",
    "fileright",
    "fileup",
)
_NOT_FINITE = re.compile(r"[+-]?(nan(\(\w*\))?|inf(inity)?)", re.IGNORECASE)
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_PNG = b"\x89PNG\r\n\x1a\n"
_UNITS = {"K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40, "P": 2**50, "E": 2**60}


@dataclass(frozen=True)
class _Element:
    """An element of an MJCF or of a file that it includes; `copies`: how often it is made."""

    xml: ET.Element
    file: Path
    copies: int

    def __str__(self) -> str:
        name = self.xml.get("name")
        return f"{self.file.name}: {self.xml.tag}{f' {name!r}' if name else ''}"


def check_mjcf(path: Path, folders: Sequence[Path]) -> None:
    """Check an MJCF and the files that it includes, before anything is made of it.

    Args:
        path: of the MJCF.
        folders: where the files that it names may lie, beside its own folder.

    Raises:
        ValueError: it is not XML, has a number that is not finite or too great, or names a file
            elsewhere; names the file, the element and the attribute.
    """
    _Check(path, [folder.resolve() for folder in (path.parent, *folders)]).run()


class _Check:
    def __init__(self, path: Path, folders: Sequence[Path], within: tuple[Path, ...] = ()) -> None:
        self._path = path
        self._chain = (*within, path.resolve())
        self._folders = folders

    def run(self) -> int:
        """Check everything; returns the number of elements."""
        elements = list(self._elements())
        names = {element.xml.get("name") for element in elements}
        # Where the files of assets may be.
        bases = dict.fromkeys([self._path.parent, *(element.file.parent for element in elements)])
        kinds = ("assetdir", "meshdir", "texturedir")
        compilers = [element.xml for element in elements if element.xml.tag == "compiler"]
        named = [xml.get(kind, "") for xml in compilers for kind in kinds]
        places = [base / folder for base in bases for folder in dict.fromkeys(["", *named])]
        attached: dict[str, int] = {}
        total = 0
        for element in sorted(elements, key=lambda element: element.xml.tag != "model"):
            for attribute, value in element.xml.attrib.items():
                field = f"mjcf: {element}: {attribute}"
                if attribute in _FILES and element.xml.tag != "include":
                    file = self._inside(field, value, places)
                    if element.xml.tag == "model" and file is not None:
                        name = element.xml.get("name") or file.stem
                        attached[name] = self._attached(field, file)
                elif value not in names and element.xml.tag != "text":
                    _check_numbers(field, element.xml.tag, attribute, value)
            xml = element.xml
            if xml.tag == "attach":
                made = attached.get(xml.get("model", ""), 1)
            elif xml.tag in ("composite", "flexcomp"):
                made = max(1, int(math.prod(_numbers(xml.get("count", "")))))
            else:
                made = 1
            total += element.copies * made
            if total > MOST_ELEMENTS:
                raise ValueError(
                    f"mjcf: {element}: got more than {MOST_ELEMENTS} elements up to here, copies "
                    f"of replicate, flexcomp and attach included; expected at most that many"
                )
        return total

    def _elements(self) -> Iterator[_Element]:
        """Every element of the MJCF and of what it includes, parents first."""
        read: set[Path] = set()
        left = [_Element(_parsed(self._path), self._path, 1)]
        while left:
            element = left.pop()
            yield element
            xml, file, copies = element.xml, element.file, element.copies
            if xml.tag == "include":
                places = [file.parent, self._path.parent]
                included = self._inside(f"mjcf: {element}: file", xml.get("file", ""), places)
                if included is not None and included not in read:
                    read.add(included)
                    left.append(_Element(_parsed(included), included, copies))
            if xml.tag == "replicate":
                copies *= max(1, int(math.prod(_numbers(xml.get("count", "")))))
            left.extend(_Element(child, file, copies) for child in reversed(xml))

    def _attached(self, field: str, file: Path) -> int:
        """Check a model that this one attaches; returns its number of elements."""
        if file in self._chain:
            raise ValueError(f"{field}: got {file.name!r}, which attaches itself, expected another")
        return _Check(file, self._folders, self._chain).run()

    def _inside(self, field: str, name: str, places: Sequence[Path]) -> Path | None:
        """The file of that name in one of the places; None if there is none."""
        found = [place for folder in places if (place := (folder / name).resolve()).is_file()]
        for place in found or [(places[0] / name).resolve()]:
            if not any(place.is_relative_to(folder) for folder in self._folders):
                raise ValueError(
                    f"{field}: got {name!r}, which is {place}, outside the folder of the MJCF; "
                    "expected a file inside it: move the file there, or name its folder under "
                    "'folders' in the body's description"
                )
        for place in found:
            _check_file(field, place)
        return found[0] if found else None


def _parsed(path: Path) -> ET.Element:
    _check_file(f"mjcf: {path.name}", path)
    try:
        # MuJoCo takes comments that XML forbids, such as lines of dashes.
        return ET.fromstring(_COMMENT.sub(b"", path.read_bytes()))
    except (ET.ParseError, ValueError) as error:
        raise ValueError(
            f"mjcf: got {str(path)!r}, which is not XML: {error}; expected an MJCF file"
        ) from error


def _check_file(field: str, file: Path) -> None:
    size = file.stat().st_size
    if size > MOST_FILE_BYTES:
        raise ValueError(
            f"{field}: got {file.name!r} of {size:,} bytes, expected at most {MOST_FILE_BYTES:,}"
        )
    with file.open("rb") as stream:
        head = stream.read(24)
    if head.startswith(_PNG):
        width, height = (int.from_bytes(head[i : i + 4], "big") for i in (16, 20))
        if max(width, height) > MOST_PIXELS:
            raise ValueError(
                f"{field}: got {file.name!r} of {width} x {height} pixels, expected at most "
                f"{MOST_PIXELS} x {MOST_PIXELS}"
            )


def _check_numbers(field: str, tag: str, attribute: str, value: str) -> None:
    wrong = [token for token in value.split() if _NOT_FINITE.fullmatch(token)]
    if wrong:
        raise ValueError(f"{field}: got {wrong[0]!r}, expected finite numbers")
    numbers, key = _numbers(value), f"{tag}.{attribute}"
    if not numbers:
        return
    if min(numbers) < (least := LEAST.get(key, -math.inf)):
        raise ValueError(f"{field}: got {value!r}, expected at least {least:g}")
    greatest = math.prod(numbers) if "count" in attribute else max(numbers)
    if greatest > (
        most := min(
            (most for name, most in MOST.items() if fnmatchcase(key, name)), default=math.inf
        )
    ):
        raise ValueError(f"{field}: got {value!r}, expected at most {most:.12g}")


def _numbers(value: str) -> list[float]:
    """The numbers of an attribute; none where it has something else. Sizes may have a unit."""
    try:
        return [
            float(token[:-1]) * _UNITS[token[-1].upper()]
            if token[-1].upper() in _UNITS
            else float(token)
            for token in value.split()
        ]
    except ValueError:
        return []
