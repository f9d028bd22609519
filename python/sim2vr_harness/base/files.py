"""Reading what people, earlier sessions and other machines have written, and writing it.

The one place where YAML, JSON, tensors and arrays are decoded. Every reader is bounded in size and
in time, and ends either with the content or with an :class:`InputError` of one sentence: the file,
what was found and what was expected.
"""

import gzip
import io
import json
import lzma
import math
import os
import pickletools
import stat
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, cast

from sim2vr_harness.base.errors import InputError, reason, shown
from sim2vr_harness.base.file_lock import temporary_of

MOST_TEXT = 256 * 2**20
"""Bytes of a text file: JSON, CSV, logs."""
MOST_YAML = 2**18
"""Bytes of a YAML file; those that ship have some thousand."""
MOST_LINE = 2**20
"""Bytes of a line of a file that is read line by line."""
MOST_BINARY = 2**36
"""Bytes of a file of tensors or arrays, packed or not."""
MOST_UNPACKED = 2**28
"""Bytes beyond a file's own that its arrays, tensors or members may need when they are unpacked.

What the project writes is stored unpacked where it is large, so this is for small packed parts."""

_MOST_DIGITS = 300
"""Of an integer in JSON; from 309 on no float is as large."""

Path_ = str | os.PathLike[str]
T = TypeVar("T")


def file_name(path: Path_) -> str:
    """Return a file's name for a sentence: control characters escaped, cut where it is long."""
    text = os.fspath(path)
    return shown(text, 300) if not text.isprintable() or len(text) > 300 else text


def read_bytes(
    path: Path_, expected: str, *, most: int = MOST_BINARY, unpack: bool = True
) -> bytes:
    """Return a file's content.

    Args:
        path: of a regular file, or a link to one.
        expected: what it should hold, for the error.
        most: bytes that it may have.
        unpack: whether to unpack a file whose name ends with ``.xz``.

    Raises:
        InputError: it is missing, a folder, a device or a pipe, too long, or cannot be read.
    """
    try:
        with _opened(path, expected, most) as stream:
            content = stream.read()
        if not (unpack and os.fspath(path).endswith(".xz")):
            return content
        reader = lzma.LZMADecompressor()
        content = reader.decompress(content, MOST_UNPACKED)
    except lzma.LZMAError as error:
        raise InputError(file_name(path), "no data of xz, or damaged ones", expected) from error
    except (OSError, MemoryError) as error:
        raise InputError(file_name(path), reason(error), expected) from error
    if not reader.eof:
        long = f"more than {MOST_UNPACKED:,} bytes when unpacked"
        got = "data of xz that are cut off or damaged" if reader.needs_input else long
        raise InputError(file_name(path), got, expected)
    return content


def _opened(path: Path_, expected: str, most: int) -> BinaryIO:
    """Open a regular file of at most ``most`` bytes."""
    name = file_name(path)
    try:
        about = os.stat(path)
        if stat.S_ISREG(about.st_mode) and about.st_size <= most:
            return open(path, "rb")
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        missing = isinstance(error, FileNotFoundError)
        got = "nothing: there is no such file" if missing else reason(error)
        raise InputError(name, got, expected) from error
    if not stat.S_ISREG(about.st_mode):
        got = "a folder" if stat.S_ISDIR(about.st_mode) else "no regular file"
        raise InputError(name, got, expected)
    raise InputError(name, f"more than {most:,} bytes", expected)


def read_head(path: Path_, expected: str, count: int) -> bytes:
    """Return the first ``count`` bytes of a file of any length, by which its format is known.

    Raises:
        InputError: as :func:`read_bytes`.
    """
    try:
        with _opened(path, expected, MOST_BINARY) as stream:
            return stream.read(count)
    except OSError as error:
        raise InputError(file_name(path), reason(error), expected) from error


def read_lines_of(path: Path_, expected: str) -> Iterator[str]:
    """Yield a text file's lines, packed with gzip or not, one at a time, without their ends.

    Args:
        path: of a regular file, or a link to one.
        expected: what it should hold, for the error.

    Raises:
        InputError: as :func:`read_text`; a line is longer than ``MOST_LINE``; damaged gzip.
    """
    name = file_name(path)
    left, number = MOST_TEXT, 0
    with _opened(path, expected, MOST_TEXT) as plain:
        packed = plain.read(2) == b"\x1f\x8b"
        plain.seek(0)
        stream = cast(BinaryIO, gzip.GzipFile(fileobj=plain) if packed else plain)
        while True:
            try:
                line = stream.readline(MOST_LINE + 1)
            except (OSError, EOFError, zlib.error) as error:
                got = f"gzip data that is cut off or damaged, after line {number}"
                raise InputError(name, got, expected) from error
            if not line:
                return
            number, left = number + 1, left - len(line)
            if left < 0:
                raise InputError(name, f"more than {MOST_TEXT:,} bytes", expected)
            if len(line) > MOST_LINE:
                got = f"a line of more than {MOST_LINE:,} bytes"
                raise InputError(f"{name}, line {number}", got, expected)
            try:
                yield line.decode("utf-8-sig" if number == 1 else "utf-8").rstrip("\r\n")
            except UnicodeDecodeError as error:
                got = "UTF-16" if line[:2] in (b"\xff\xfe", b"\xfe\xff") else "no UTF-8 text"
                raise InputError(f"{name}, line {number}", got, f"{expected}, in UTF-8") from error


def read_text(path: Path_, expected: str, *, most: int = MOST_TEXT) -> str:
    """Return a file's text: UTF-8, with or without a byte order mark.

    Raises:
        InputError: as :func:`read_bytes`, or it is not UTF-8.
    """
    content = read_bytes(path, expected, most=most)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        utf16 = content[:2] in (b"\xff\xfe", b"\xfe\xff")
        got = "UTF-16" if utf16 else f"a byte at {error.start:,} that is no UTF-8 text"
        raise InputError(file_name(path), got, f"{expected}, in UTF-8") from error


def read_yaml(path: Path_, expected: str) -> Any:
    """Return what a YAML file holds: mappings with text as keys, lists and plain values.

    Raises:
        InputError: as :func:`read_text` and ``bounded_yaml.parse_yaml``, or it is empty.
    """
    from sim2vr_harness.base.bounded_yaml import parse_yaml

    tree = parse_yaml(read_text(path, expected, most=MOST_YAML), file_name(path), expected)
    if tree is None:
        raise InputError(file_name(path), "an empty file", expected)
    return tree


def read_json(path: Path_, expected: str, *, most: int = MOST_TEXT) -> dict[str, Any]:
    """Return the object that a JSON file holds.

    Raises:
        InputError: as :func:`read_text` and :func:`parse_json`.
    """
    return parse_json(read_text(path, expected, most=most), file_name(path), expected)


def parse_json(text: str | bytes, source: str, expected: str) -> dict[str, Any]:
    """Return the object that a JSON text holds.

    Args:
        text: the JSON, UTF-8.
        source: where it is from, for the error.
        expected: what it should be, for the error.

    Raises:
        InputError: it is empty or no JSON, nested too deep, has a key twice, or is no object.
    """
    if not text.strip():
        raise InputError(source, "an empty file", expected)
    try:
        content = json.loads(text, object_pairs_hook=_each_key_once, parse_int=_whole_number)
    except json.JSONDecodeError as error:
        got = f"text that is not JSON ({error.msg})"
        raise InputError(f"{source}, line {error.lineno}", got, expected) from error
    except (ValueError, RecursionError) as error:
        got = "JSON nested too deep" if isinstance(error, RecursionError) else reason(error)
        raise InputError(source, got, expected) from error
    if not isinstance(content, dict):
        raise InputError(source, f"JSON of {shown(content, 40)}", expected)
    return content


def _whole_number(digits: str) -> int | float:
    """Return an integer; infinity where no float is as large, so that readers refuse it."""
    return int(digits) if len(digits) <= _MOST_DIGITS else float(digits)


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {shown(twice)} twice")
    return content


def read_members(path: Path_, names: Sequence[str], expected: str) -> dict[str, bytes]:
    """Return members of a zip archive.

    Raises:
        InputError: as :func:`read_bytes`, or it is no such archive, damaged, or lacks a member.
    """
    content, name = read_bytes(path, expected), file_name(path)

    def unpack() -> dict[str, bytes]:
        with _archive(content, name, expected) as archive:
            there = set(archive.namelist())
            for member in names:
                if member not in there:
                    raise ValueError(f"an archive without {member}")
            return {member: archive.read(member) for member in names}

    return _decoded(name, "no zip archive, or a damaged one", expected, unpack)


def _archive(content: bytes, source: str, expected: str) -> zipfile.ZipFile:
    """Open a zip archive whose headers declare that it unpacks to a modest size.

    Readers never unpack more of a member than its header declares.

    Raises:
        InputError: The members need too much memory.
        ValueError, zipfile.BadZipFile: It is no archive.
    """
    if content[:4] != b"PK\x03\x04":  # torch reads other files in ways that trust their sizes
        raise ValueError("no zip archive")
    archive = zipfile.ZipFile(io.BytesIO(content))
    unpacked = sum(info.file_size for info in archive.infolist())
    _require_modest(unpacked, len(content), source, expected)
    return archive


def _require_modest(unpacked: int, packed: int, source: str, expected: str) -> None:
    """Refuse what needs far more memory than its file has bytes."""
    most = packed + MOST_UNPACKED
    if unpacked > most:
        got = f"{packed:,} bytes that unpack to {unpacked:,}"
        raise InputError(source, got, f"{expected}, which unpacks to at most {most:,} bytes")


def read_arrays(path: Path_, expected: str) -> dict[str, Any]:
    """Return the NumPy arrays of an ``.npz`` file by name.

    Raises:
        InputError: as :func:`read_bytes` and :func:`parse_arrays`.
    """
    return parse_arrays(read_bytes(path, expected), file_name(path), expected)


def parse_arrays(content: bytes, source: str, expected: str) -> dict[str, Any]:
    """Return the NumPy arrays that the bytes of an ``.npz`` file hold, never running a pickle.

    Raises:
        InputError: they are no such arrays; names ``source``.
    """
    import numpy as np

    def load() -> dict[str, Any]:
        # NumPy makes an array as large as its header says before it reads the first number.
        with _archive(content, source, expected) as archive:
            for info in archive.infolist():
                with archive.open(info) as member:
                    version = np.lib.format.read_magic(member)
                    old = version == (1, 0)
                    read = np.lib.format.read_array_header_1_0
                    shape, _, dtype = (read if old else np.lib.format.read_array_header_2_0)(member)
                if math.prod(shape) * max(dtype.itemsize, 1) > info.file_size:
                    got = f"shape {shape} of {dtype} in {info.file_size:,} bytes"
                    raise ValueError(f"{shown(info.filename, 60)} declares {got}")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}

    return _decoded(source, "no arrays of NumPy, or damaged ones", expected, load)


def read_tensors(path: Path_, expected: str) -> dict[str, Any]:
    """Return what ``torch.save`` wrote of a mapping, never running a pickle.

    Raises:
        InputError: as :func:`read_bytes` and :func:`parse_tensors`.
    """
    return parse_tensors(read_bytes(path, expected), file_name(path), expected)


def parse_tensors(
    content: bytes, source: str, expected: str, device: Any = "cpu"
) -> dict[str, Any]:
    """Return the mapping that the bytes of ``torch.save`` hold, on ``device``.

    Raises:
        InputError: they are no such mapping; names ``source``.
    """
    import torch

    def load() -> dict[str, Any]:
        with _archive(content, source, expected) as archive:
            for info in archive.infolist():
                # An instruction of a few bytes makes a bytearray of any length; tensors need none.
                if info.filename.endswith("/data.pkl") and any(
                    operation.name == "GLOBAL" and str(name).endswith(" bytearray")
                    for operation, name, _ in pickletools.genops(archive.read(info))
                ):
                    raise ValueError("a bytearray in it")
        with warnings.catch_warnings():  # of damaged files, on lines of their own
            warnings.simplefilter("ignore")
            found = torch.load(io.BytesIO(content), map_location=device, weights_only=True)
        if not isinstance(found, Mapping) or not all(isinstance(key, str) for key in found):
            raise ValueError(f"a {type(found).__name__} in it")
        # A tensor can spread a few stored numbers over any shape, and every copy has them all.
        unpacked, known, parts = 0, set[int](), list[Any](found.values())
        while parts:
            part = parts.pop()
            if id(part) in known:
                continue
            known.add(id(part))
            if isinstance(part, torch.Tensor):
                unpacked += part.numel() * part.element_size()
            elif isinstance(part, Mapping):
                parts.extend(part.values())
            elif isinstance(part, list | tuple | set):
                parts.extend(part)
        _require_modest(unpacked, len(content), source, expected)
        return dict(found)

    return _decoded(source, "no tensors of torch, or damaged ones", expected, load)


def _decoded(source: str, problem: str, expected: str, decode: Callable[[], T]) -> T:
    """Run a decoder of someone else's, whose errors on wrong bytes can be of any type."""
    try:
        return decode()
    except InputError:
        raise
    except Exception as error:
        # Torch's own text is a page about pickles.
        detail = "" if len(str(error)) > 200 else f" ({reason(error)})"
        raise InputError(source, problem + detail, expected) from error


@contextmanager
def naming(path: Path_) -> Iterator[None]:
    """Give errors of the operating system in the block the name of the file that is written.

    The system names none where writing itself fails: on a full disk, on a file that grew too large.

    Raises:
        OSError: of the same number.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(Path(path))) from error


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that it is either complete or not there, whatever happens meanwhile.

    Folders that are missing are made: what took minutes is not lost for want of one.

    Raises:
        OSError: names the file, also where the system does not (a full disk).
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_of(path)
    with naming(path):
        try:
            with temporary.open("wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
