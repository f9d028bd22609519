"""The parts of a session as a page sends them: kept in files until the session is written."""

import os
import re
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from sim2vr_harness.base.errors import InputError, counted, reason
from sim2vr_harness.base.file_lock import sole_training
from sim2vr_harness.base.files import naming, write_atomically
from sim2vr_harness.base.notices import notice_once
from sim2vr_harness.sessions import Session, read_session, write_session

MAX_PART_BYTES = 1 << 22
MAX_BYTES = 1 << 28
MAX_PARTS = 20_000
PARTS_PER_SECOND = 10.0
BURST = 40.0
_ENDING = ".parts"
_LOCK = "recording.lock"
_PART = re.compile(r"([0-9]{5})\.part")
_QUERY = re.compile(r"session=([0-9a-f]{32})&part=([0-9]{1,5})&last=([01])")


class RefusedPart(Exception):
    """A part that is not kept: status of the answer, and why in one sentence."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


class Parts:
    """Parts of one session, within size limits; threads may call it at the same time.

    They are stored in the folder ``FILE.parts`` beside the file to write, so that they survive this
    process and :func:`recover` finds them.

    Args:
        out: The file to write; remaining parts of an earlier recording of it are used.

    Attributes:
        folder: Folder of the parts.
        complete: Set when the last part and all before it have arrived.

    Raises:
        InputError: The file exists, or another recording writes it.
        OSError: The folder cannot be made.
    """

    def __init__(self, out: Path) -> None:
        self.out, self.folder = out, out.with_name(f"{out.name}{_ENDING}")
        self.complete = threading.Event()
        self._lock = threading.Lock()
        self._hold = ExitStack()
        self._hold.enter_context(sole_training(self.folder, self.folder / _LOCK, "recording"))
        if out.exists() or out.is_symlink():
            self.close()
            raise InputError("--out", f"{str(out)!r}, which is there already", "a new file")
        self.folder.chmod(0o700)  # movements are personal
        self._session = ""
        self._last: int | None = None
        found = {file: _PART.fullmatch(file.name) for file in self.folder.iterdir()}
        self._kept = {int(match[1]) for match in found.values() if match}
        self._bytes = sum(file.stat().st_size for file, match in found.items() if match)
        self._allowance, self._asked_s = BURST, time.monotonic()

    def __len__(self) -> int:
        return len(self._kept)

    def take(self, query: str, content: bytes) -> None:
        """Store a part; one that was stored already is not changed.

        Args:
            query: Names session and part, and marks the last one.
            content: Lines of a session's file.

        Raises:
            RefusedPart: It is malformed, of another session, one too many, or cannot be written.
        """
        match = _QUERY.fullmatch(query)
        if match is None:
            raise RefusedPart(400, "Query: expected session, part and last.")
        session, number, last = match[1], int(match[2]), match[3] == "1"
        with self._lock:
            size = len(content)
            now_s = time.monotonic()
            gained = (now_s - self._asked_s) * PARTS_PER_SECOND
            self._allowance, self._asked_s = min(BURST, self._allowance + gained), now_s
            if self._allowance < 1.0:
                raise RefusedPart(429, f"Parts: got more than {PARTS_PER_SECOND:g} a second.")
            self._allowance -= 1.0
            if self._session and session != self._session:
                raise RefusedPart(
                    409, "Session: another page is recorded; start the command again."
                )
            if number >= MAX_PARTS or (self._last is not None and number > self._last):
                most = MAX_PARTS if self._last is None else self._last + 1
                raise RefusedPart(
                    413, f"Part: got number {number}, expected no more parts than {most}."
                )
            if size > MAX_PART_BYTES or self._bytes + size > MAX_BYTES:
                raise RefusedPart(413, f"Size: got over {MAX_BYTES >> 20} MB, expected a session.")
            self._session = session
            if number not in self._kept:
                # Write a part to the disk, all of it or nothing.
                try:
                    write_atomically(self.folder / f"{number:05}.part", content)
                except OSError as error:
                    why = f"cannot be written ({reason(error)})"
                    notice_once(f"{self.folder}: a part {why}; make room, the page sends it again")
                    raise RefusedPart(507, f"Part: {why}, expected to be sent again.") from error
                self._kept.add(number)
                self._bytes += len(content)
            if last:
                self._last = number
            if self._last is not None and len(self._kept) == self._last + 1:
                self.complete.set()

    def session(self) -> Session | None:
        """Return the session so far, read and checked; None: no part has arrived.

        Raises:
            InputError: The parts are no session.
            OSError: There is no room to join them.
        """
        if not self._kept:
            return None
        whole = self._join()
        try:
            session = read_session(whole)
        finally:
            whole.unlink()
        missing = max(self._kept) + 1 - len(self._kept)
        if missing:
            note = f"{counted(missing, 'part')} of the session did not arrive"
            session = replace(session, notes=(*session.notes, note))
        return session

    def finish(self) -> Session | None:
        """Write the session to its file, then remove the parts; None: no part has arrived.

        Raises:
            InputError: The parts are no session; they are kept as ``FILE.damaged``.
            FileExistsError: Another file has the name; the parts stay.
            OSError: The file cannot be written; the parts stay.
        """
        try:
            session = self.session()
        except InputError as error:
            damaged = self.out.with_name(f"{self.out.name}.damaged")
            self._publish(self._join(), damaged)
            expected = f"{error.expected}; it is kept as it came in {str(damaged)!r}"
            raise InputError(error.field, error.got, expected) from error
        if session is not None:
            made = self.folder / self.out.name
            with naming(self.out):
                write_session(session, made)
                self._publish(made, self.out)
        return session

    def _join(self) -> Path:
        whole = self.folder / "session.jsonl"
        with naming(self.out), self._lock, whole.open("wb") as written:
            for number in sorted(self._kept):
                written.write((self.folder / f"{number:05}.part").read_bytes())
        return whole

    def _publish(self, made: Path, out: Path) -> None:
        """Give a file, or a log's folder, its name, and remove the parts."""
        for file in made.iterdir() if made.is_dir() else (made,):
            with file.open("rb") as written:
                os.fsync(written.fileno())
        # The name is claimed first: a replacement alone would take the place of another file.
        if made.is_dir():
            out.mkdir()
        else:
            out.touch(exist_ok=False)
        made.replace(out)
        shutil.rmtree(self.folder)
        self._kept.clear()

    def close(self) -> None:
        """Release the folder; parts that are not written yet stay in it."""
        self._hold.close()


def recover(folder: Path) -> Iterator[str]:
    """Write the remaining parts of killed recordings in a folder; yield a line for each.

    Parts of a running recording are not changed. Parts that cannot be written stay, and the line
    names the reason.
    """
    for left in sorted(folder.glob(f"*{_ENDING}")):
        if not (left / _LOCK).is_file():
            continue
        out = left.with_name(left.name.removesuffix(_ENDING))
        try:
            parts = Parts(out)
        except InputError:  # another recording writes it, or
            if out.exists():
                yield f"Left: {left}, parts of a recording; rename {out} and start again"
            continue
        try:
            session = parts.finish()
            if session is None:
                shutil.rmtree(left)
            else:
                length = f"{len(session):,} frames, {session.duration_s:.1f} s"
                yield f"Recovered: {out} ({length}), of a recording that was cut off"
        except InputError as error:
            yield f"Damaged: {error}"
        except Exception as error:  # none may keep the next recording from being made
            yield f"Left: {left}, parts of a recording ({reason(error)})"
        finally:
            parts.close()
