"""An X server without a screen, for programs that need a window (``xvfb``)."""

import os
import secrets
import select
import shutil
import struct
import time
import weakref
from collections.abc import Mapping
from pathlib import Path

from sim2vr_harness.client.errors import AppRefused, AppTimeout
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.temporary import OUTSIDE_FILE, TemporaryFolder, remove_same

_ARGUMENTS = ("-nolisten", "tcp", "-noreset", "-screen", "0", "640x480x24")
_STOP_S = 2.0
_ANY_HOST = 0xFFFF
_COOKIE = b"MIT-MAGIC-COOKIE-1"


class Display:
    """An Xvfb with a display number of its own, which only this user's programs reach.

    Args:
        start_timeout_s: how long it may take to start.

    Raises:
        AppRefused: there is no Xvfb.
        AppDied, AppTimeout: it does not start.
    """

    def __init__(self, start_timeout_s: float) -> None:
        program = shutil.which("Xvfb")
        if program is None:
            raise AppRefused(
                "--xvfb: got no Xvfb on the PATH, expected it (apt-get install xvfb); or leave the "
                "option out on a machine with a display"
            )
        self._folder = TemporaryFolder()
        self._authority = self._folder.path / "authority"
        self._authority.touch(mode=0o600)
        self._authority.write_bytes(_authority(secrets.token_bytes(16)))
        ours, theirs = os.pipe()
        try:
            self._process = AppProcess(
                [program, *_ARGUMENTS, "-auth", self._authority, "-displayfd", str(theirs)],
                inherited=(theirs,),
                home=self._folder,
            )
            os.close(theirs)
            theirs = -1
            timeout_s = start_timeout_s
            deadline = time.monotonic() + timeout_s
            said = b""
            while not said.endswith(b"\n"):
                ready, _, _ = select.select([ours], [], [], max(0.0, deadline - time.monotonic()))
                got = os.read(ours, 64) if ready else b""
                if not got:
                    ended = bool(ready) and self._process.wait(1.0)
                    error = (
                        self._process.death("while it started")
                        if ended
                        else AppTimeout(f"{self._process} was not ready within {timeout_s:g} s")
                    )
                    self._process.kill()
                    raise error
                said += got
            self.number = int(said)
        finally:
            os.close(ours)
            if theirs >= 0:
                os.close(theirs)
        number = self.number
        named = Path(f"/tmp/.X11-unix/X{number}"), Path(f"/tmp/.X{number}-lock")
        made = {file: file.lstat().st_ino for file in named if file.exists()}
        outside = self._folder.path / OUTSIDE_FILE
        outside.write_text("".join(f"{inode} {file}\n" for file, inode in made.items()))
        # Runs before the process's own finalizer, which ends it without a chance to clear up.
        self._finalizer = weakref.finalize(self, _remove_files, made, os.getpid())

    @property
    def environment(self) -> dict[str, str]:
        """Variables by which a program finds it."""
        return {"DISPLAY": f":{self.number}", "XAUTHORITY": str(self._authority)}

    @property
    def running(self) -> bool:
        """Whether it is there."""
        return self._process.running

    def close(self) -> None:
        """End it; idempotent."""
        self._process.terminate(_STOP_S)
        self._finalizer()


def _remove_files(made: Mapping[Path, int], owner: int) -> None:
    """Delete files of a display, unless another server has made them anew."""
    if os.getpid() != owner:
        return
    for file, inode in made.items():
        remove_same(file, inode)


def _authority(cookie: bytes) -> bytes:
    """A file of Xauthority with one cookie, for any host and display."""
    parts = [struct.pack(">H", _ANY_HOST)]
    parts += [struct.pack(">H", len(part)) + part for part in (b"", b"", _COOKIE, cookie)]
    return b"".join(parts)
