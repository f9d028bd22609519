"""The parts of a session as a page sends them: kept in files, put together in the end."""

from __future__ import annotations

import re
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

from sim2vr_harness.base.errors import counted
from sim2vr_harness.sessions import Session, read_session

MAX_PART_BYTES = 1 << 22
MAX_BYTES = 1 << 28
MAX_PARTS = 20_000
PARTS_PER_SECOND = 10.0
BURST = 40.0
_QUERY = re.compile(r"session=([0-9a-f]{32})&part=([0-9]{1,5})&last=([01])")


class RefusedPart(Exception):
    """A part that is not kept: status of the answer, and why in one sentence."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


class Parts:
    """Parts of one session, within bounds; threads may call it at the same time.

    Attributes:
        complete: Set when the last part and all before it are there.
    """

    def __init__(self) -> None:
        self.complete = threading.Event()
        self._folder = tempfile.TemporaryDirectory(prefix="sim2vr-session-")
        self._lock = threading.Lock()
        self._session = ""
        self._last: int | None = None
        self._kept: set[int] = set()
        self._bytes = 0
        self._allowance, self._asked_s = BURST, time.monotonic()

    def __len__(self) -> int:
        return len(self._kept)

    def take(self, query: str, content: bytes) -> None:
        """Keep a part; one that is there already stays as it is.

        Args:
            query: Names session and part, and says whether it is the last one.
            content: Lines of a session's file.

        Raises:
            RefusedPart: It is malformed, of another session, or one too many.
        """
        match = _QUERY.fullmatch(query)
        if match is None:
            raise RefusedPart(400, "Query: expected session, part and last.")
        session, number, last = match[1], int(match[2]), match[3] == "1"
        with self._lock:
            self._check(session, number, len(content))
            self._session = session
            if number not in self._kept:
                (Path(self._folder.name) / f"{number:05}").write_bytes(content)
                self._kept.add(number)
                self._bytes += len(content)
            if last:
                self._last = number
            if self._last is not None and len(self._kept) == self._last + 1:
                self.complete.set()

    def _check(self, session: str, number: int, size: int) -> None:
        now_s = time.monotonic()
        gained = (now_s - self._asked_s) * PARTS_PER_SECOND
        self._allowance, self._asked_s = min(BURST, self._allowance + gained), now_s
        if self._allowance < 1.0:
            raise RefusedPart(429, f"Parts: got more than {PARTS_PER_SECOND:g} a second.")
        self._allowance -= 1.0
        if self._session and session != self._session:
            raise RefusedPart(409, "Session: another page is recorded; start the command again.")
        if number >= MAX_PARTS or (self._last is not None and number > self._last):
            raise RefusedPart(413, f"Part: got number {number}, expected no more parts.")
        if size > MAX_PART_BYTES or self._bytes + size > MAX_BYTES:
            raise RefusedPart(413, f"Size: got over {MAX_BYTES >> 20} MB, expected a session.")

    def session(self) -> Session | None:
        """Return the session so far, read and checked; None: nothing has come.

        Raises:
            InputError: The parts are no session.
        """
        if not self._kept:
            return None
        file = Path(self._folder.name) / "session.jsonl"
        missing = self.write(file)
        session = read_session(file)
        if missing:
            note = f"{counted(missing, 'part')} of the session did not arrive"
            session = replace(session, notes=(*session.notes, note))
        return session

    def write(self, file: Path) -> int:
        """Write the parts that are there as one file; return how many are missing.

        Raises:
            OSError: The file cannot be written.
        """
        with self._lock, file.open("wb") as whole:
            for number in sorted(self._kept):
                whole.write((Path(self._folder.name) / f"{number:05}").read_bytes())
            return max(self._kept, default=-1) + 1 - len(self._kept)

    def close(self) -> None:
        """Remove the files."""
        self._folder.cleanup()
