"""Temporary folders of apps, and a watcher that clears up after this process.

All apps of a process have their folders in one, ``sim2vr-PID-XXXXXXXX`` in the temporary folder.
A shell waits at a pipe that ends when this process ends, however that is; then it kills the
process groups that the folders name, stopped ones too, and whatever the apps started in other
groups, and deletes the folders. Where the watcher
was killed as well, the next process that starts an app deletes them.
"""

import fcntl
import itertools
import os
import re
import shutil
import subprocess
import tempfile
import threading
import time
import weakref
from contextlib import suppress
from pathlib import Path

FOLDER_VARIABLE = "SIM2VR_APP_FOLDER"
"""Environment variable of an app and all it starts, with the app's folder: they are found by it."""

GROUP_FILE = "group"
"""In an app's folder: the number of its process group, and the end of the line."""

OUTSIDE_FILE = "outside"
"""In an app's folder: files that it made elsewhere and that are deleted with it.

A line has a file's inode and path: one that another program has made anew stays.
"""

_LOCK = "lock"
_NAME = re.compile(r"sim2vr-[0-9]+-\w{8}")
_REMOVE_S = 2.0

# The subshell leaves the harness no child. A number without its end of line is not taken: a part
# of one names another group.
_WATCHER = f"""
exec 3<&0 </dev/null
(
    trap '' HUP INT QUIT TERM
    read -r _ <&3
    for file in "$0"/*/{GROUP_FILE}; do
        read -r group <"$file" && [ "$group" -gt 1 ] && kill -s KILL -- "-$group"
    done
    for _ in 1 2 3; do
        grep -lszF "{FOLDER_VARIABLE}=$0/" /proc/[0-9]*/environ | while IFS=/ read -r _ _ id _; do
            kill -s KILL "$id"
        done
    done
    for file in "$0"/*/{OUTSIDE_FILE}; do
        while read -r inode made; do
            [ "$(stat -c %i -- "$made" 2>/dev/null)" = "$inode" ] && rm -f -- "$made"
        done <"$file"
    done
    for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
        rm -rf -- "$0" && break
        sleep 0.1
    done
) &
"""


class TemporaryFolder:
    """An app's folder, for you alone; it goes with :meth:`remove`, or with this process.

    Attributes:
        path: of the folder.
    """

    def __init__(self) -> None:
        self.path = _place().new_folder()
        self._finalizer = weakref.finalize(self, _remove, self.path, os.getpid())

    def remove(self) -> None:
        """Delete the folder; idempotent."""
        self._finalizer()


class _Place:
    """The folder of this process, locked as long as the process lives, and its watcher."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self._numbers = itertools.count()
        # Delete the folders in folder of processes that were killed with their watchers.
        folder = Path(tempfile.gettempdir())
        with os.scandir(folder) as entries:
            named = [entry for entry in entries if _NAME.fullmatch(entry.name)]
        for entry in named:
            with suppress(OSError):
                if (
                    not entry.is_dir(follow_symlinks=False)
                    or entry.stat(follow_symlinks=False).st_uid != os.geteuid()
                ):
                    continue
                flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
                lock = os.open(Path(entry.path, _LOCK), flags)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    for file, inode in outside_files(Path(entry.path)).items():
                        remove_same(file, inode)
                    shutil.rmtree(entry.path, ignore_errors=True)
                finally:
                    os.close(lock)
        self.path = Path(tempfile.mkdtemp(prefix=f"sim2vr-{self.owner}-"))
        locked = self.path / f"{_LOCK}.new"
        self._lock = os.open(locked, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        with suppress(OSError):  # a file system without locks: no one sweeps there
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        locked.rename(self.path / _LOCK)  # never there unlocked
        watched, self._alive = os.pipe()
        try:
            subprocess.run(
                ["sh", "-c", _WATCHER, str(self.path)],
                stdin=watched,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,
                check=True,
            )
        finally:
            os.close(watched)

    def new_folder(self) -> Path:
        """Make a folder in it."""
        folder = self.path / str(next(self._numbers))
        folder.mkdir(mode=0o700)
        return folder

    def let_go(self) -> None:
        """Close what a fork has of this process's, whose end would not be seen otherwise."""
        for descriptor in (self._lock, self._alive):
            os.close(descriptor)


_place_lock = threading.Lock()
_the_place: _Place | None = None


def _place() -> _Place:
    global _the_place
    with _place_lock:
        if _the_place is None or not _the_place.path.is_dir():
            _the_place = _Place()
        return _the_place


def _forked() -> None:
    global _the_place, _place_lock
    _place_lock = threading.Lock()  # a thread that the fork does not have may hold it
    if _the_place is not None:
        _the_place.let_go()
        _the_place = None


os.register_at_fork(after_in_child=_forked)


def outside_files(folder: Path) -> dict[Path, int]:
    """Return files that apps of a process's folder made elsewhere, with their inodes."""
    found = {}
    for listed in folder.glob(f"*/{OUTSIDE_FILE}"):
        for line in listed.read_text().splitlines():
            inode, _, file = line.partition(" ")
            if inode.isdigit():
                found[Path(file)] = int(inode)
    return found


def remove_same(file: Path, inode: int) -> None:
    """Delete a file unless it is another one by now."""
    with suppress(OSError):
        if file.lstat().st_ino == inode:
            file.unlink()


def _remove(folder: Path, owner: int) -> None:
    """Delete a folder in which killed processes may be writing for another moment."""
    if os.getpid() != owner:  # A fork of the owner; the folder is not its own.
        return
    deadline = time.monotonic() + _REMOVE_S
    while folder.exists() and time.monotonic() < deadline:
        shutil.rmtree(folder, ignore_errors=True)
        if folder.exists():
            time.sleep(0.02)
