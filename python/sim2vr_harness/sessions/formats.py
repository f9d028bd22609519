"""The formats of sessions: one table, found by a file's content, written by its name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name, read_head
from sim2vr_harness.sessions import bsor
from sim2vr_harness.sessions.checks import checked
from sim2vr_harness.sessions.file import FORMAT, read_file, write_file
from sim2vr_harness.sessions.iwer import read_iwer, write_iwer
from sim2vr_harness.sessions.logs import read_log, write_log
from sim2vr_harness.sessions.session import Session
from sim2vr_harness.sessions.table import read_table, write_table
from sim2vr_harness.sessions.whacamole import PACKED, packed_rounds, read_packed

_HEAD = 4096


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: as ``session show`` has it.
        summary: a line for people.
        matches: whether a file's first bytes are of it; a folder has none.
        read: reads a file without the checks that all formats share.
        endings: of names of files to write, the first being the usual one.
        write: writes a file; None: read only.
    """

    name: str
    summary: str
    matches: Callable[[bytes], bool]
    read: Callable[[Path], Session]
    endings: tuple[str, ...] = ()
    write: Callable[[Session, Path], None] | None = None


def _text(head: bytes) -> str:
    return head.removeprefix(b"\xef\xbb\xbf").decode("utf-8", errors="replace").lstrip()


def _is_own(head: bytes) -> bool:
    return head[:2] == b"\x1f\x8b" or (_text(head)[:1] == "{" and FORMAT.encode() in head)


FORMATS: tuple[Format, ...] = (
    Format(
        "session",
        "JSON lines, described in docs/reference/sessions.md; .gz: packed",
        _is_own,
        read_file,
        (".jsonl", ".jsonl.gz"),
        write_file,
    ),
    Format(
        "bsor",
        "Open Replay of Beat Saber, read only",
        lambda head: head[:4] == bsor.MAGIC,
        bsor.read_bsor,
    ),
    Format(
        PACKED,
        "packed round of Whac-A-Mole with its manifest.json, read only",
        lambda head: head[:2] == b"PK",
        read_packed,
    ),
    Format(
        "iwer",
        "recording of IWER's ActionRecorder",
        lambda head: _text(head)[:1] == "{",
        read_iwer,
        (".json",),
        write_iwer,
    ),
    Format(
        "log",
        "folder of a round's states.csv and events.csv",
        lambda head: _text(head).startswith("condition"),
        read_log,
        ("",),
        write_log,
    ),
    Format(
        "csv",
        "table with a header, a row per frame",
        lambda head: b"time_" in head.split(b"\n", 1)[0],
        read_table,
        (".csv",),
        write_table,
    ),
)
"""Every format, in the order in which a file's content is looked at."""

_EXPECTED = (
    "a session: JSON lines, a recording of IWER, BSOR, a round's states.csv or its folder, a "
    "packed round NAME.npz, or a CSV table with time_s and head_x"
)
_IN_FOLDERS = (".jsonl", ".jsonl.gz", ".bsor")
"""Ends of sessions' names in folders, which hold other files, too; a file may be of any format."""


def format_of(path: Path) -> Format:
    """Return the format of a file by its first bytes; a folder is a log.

    Raises:
        InputError: it is none, or cannot be read.
    """
    if path.is_dir():
        if not (path / "states.csv").is_file():
            raise InputError(file_name(path), "a folder without states.csv", _EXPECTED)
        return next(each for each in FORMATS if each.name == "log")
    head = read_head(path, _EXPECTED, _HEAD)
    if not head.strip():
        raise InputError(file_name(path), "an empty file", _EXPECTED)
    for each in FORMATS:
        if each.matches(head):
            return each
    utf16 = head[:2] in (b"\xff\xfe", b"\xfe\xff")
    raise InputError(file_name(path), "UTF-16" if utf16 else "another file", _EXPECTED)


def read_session(path: Path) -> Session:
    """Read a session of any format, checked.

    Raises:
        InputError: it is none, or damaged; one sentence with the file and the place in it.
    """
    session = checked(format_of(path).read(path), file_name(path))
    return replace(session, path=path.parent if path.name == "states.csv" else path)


def find_sessions(path: Path) -> list[Path]:
    """Return the sessions at or below a place; none where it is no session.

    A folder's own are those that its ``manifest.json`` lists, its files of the formats that are
    only sessions, and logs; a file may be of any format.

    Raises:
        InputError: a ``manifest.json`` is damaged.
    """
    if path.is_dir() and (path / "states.csv").is_file():
        return [path]
    if path.is_dir() and (path / "manifest.json").is_file():
        return packed_rounds(path / "manifest.json")
    if path.is_dir():
        below = sorted(path.iterdir())
        known = (each for each in below if each.is_dir() or each.name.endswith(_IN_FOLDERS))
        return [found for each in known for found in find_sessions(each)]
    if path.name == "manifest.json":
        return packed_rounds(path)
    try:
        found = format_of(path).name if path.is_file() else None
    except InputError:
        return []
    packed = found == PACKED and path.suffix != ".npz"  # other files are ZIP archives, too
    return [] if found is None or packed else [path]


def read_sessions(path: Path, option: str = "PATH") -> list[Session]:
    """Read all sessions at or below a place.

    Args:
        path: a session of any format, a ``manifest.json``, or a folder above such.
        option: the command's, for the error.

    Raises:
        InputError: there is none, or one is damaged.
    """
    if not path.exists():
        raise InputError(option, repr(str(path)), "a file or folder that exists")
    if path.is_file() and path.name != "manifest.json":
        return [read_session(path)]
    files = find_sessions(path)
    if not files:
        expected = (
            "a session, a folder with states.csv and events.csv, or with manifest.json, NAME.npz "
            "and NAME_events.csv; or a folder above such ones"
        )
        raise InputError(option, repr(str(path)), expected)
    return [read_session(file) for file in files]


def require_name(path: Path) -> Format:
    """Return the format that a file's name asks for.

    Raises:
        InputError: there is none; lists the endings.
    """
    for each in FORMATS:
        if each.write and any(path.name.endswith(end) for end in each.endings if end):
            return each
    if not path.suffix:
        return next(each for each in FORMATS if each.name == "log")
    endings = ", ".join(end for each in FORMATS for end in each.endings if end)
    raise InputError("OUT", repr(str(path)), f"a name that ends in {endings}, or a folder")


def write_session(session: Session, path: Path) -> None:
    """Write a session in the format that the name asks for.

    Raises:
        InputError: no format has such names.
        OSError: the file cannot be written.
    """
    write = require_name(path).write
    assert write is not None
    write(session, path)
