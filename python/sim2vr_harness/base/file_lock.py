"""One training at a time in a run's folder, and nothing left there of those that were killed."""

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sim2vr_harness.base.errors import InputError

_TEMPORARY = re.compile(r"\..+\.([1-9][0-9]*)\.tmp")


def temporary_of(path: Path) -> Path:
    """Return where this process writes a file before it takes its place."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def is_temporary(file: Path) -> bool:
    """Return whether :func:`temporary_of` has named a file, by the form of its name."""
    return _TEMPORARY.fullmatch(file.name) is not None and file.is_file()


@contextmanager
def sole_training(folder: Path, lock_file: Path, what: str = "training") -> Iterator[None]:
    """Hold a run's folder, made if needed, for the time of a training.

    The kernel lets go of the lock when the process ends, however it ends.

    Args:
        folder: of the run; empty folders that were made here go again if nothing came into them.
        what: what works there, for people, where it is no training.

    Raises:
        InputError: another one works there.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(lock_file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                "--out",
                f"{str(folder)!r}, in which another {what} is running",
                f"that {what} to end first, or another folder",
            ) from error
        sweep(folder)
        yield
    finally:
        os.close(descriptor)
        if made:
            with suppress(OSError):
                if [file.name for file in folder.iterdir()] == [lock_file.name]:
                    lock_file.unlink()
                    folder.rmdir()


def sweep(folder: Path) -> list[Path]:
    """Delete what killed processes were writing below ``folder``, and return the files.

    A process's own number counts as that of an earlier one: nothing is being written yet.
    """
    swept = []
    for file in folder.rglob(".*.tmp"):
        found = _TEMPORARY.fullmatch(file.name)
        if found is not None and file.is_file() and not _lives(int(found.group(1))):
            with suppress(OSError):
                file.unlink()
                swept.append(file)
    return swept


def _lives(number: int) -> bool:
    """Return whether another process with this number runs, no matter to which user it belongs."""
    return number != os.getpid() and Path(f"/proc/{number}").exists()
