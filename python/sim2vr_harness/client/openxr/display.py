"""An X server without a screen, for programs that need a window (``xvfb``)."""

from __future__ import annotations

import os
import secrets
import select
import shutil
import struct
import time

from sim2vr_harness.client.errors import AppRefused, AppTimeout
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.temporary import OUTSIDE_FILE, TemporaryFolder

__all__ = ["Display"]

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
            self.number = self._number(ours, start_timeout_s)
        finally:
            os.close(ours)
            if theirs >= 0:
                os.close(theirs)
        made = (f"/tmp/.X{self.number}-lock", f"/tmp/.X11-unix/X{self.number}")
        outside = self._folder.path / OUTSIDE_FILE
        outside.write_text("".join(f"{name}\n" for name in made))

    def _number(self, descriptor: int, timeout_s: float) -> int:
        deadline = time.monotonic() + timeout_s
        said = b""
        while not said.endswith(b"\n"):
            ready, _, _ = select.select([descriptor], [], [], max(0.0, deadline - time.monotonic()))
            got = os.read(descriptor, 64) if ready else b""
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
        return int(said)

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


def _authority(cookie: bytes) -> bytes:
    """A file of Xauthority with one cookie, for any host and display."""
    parts = [struct.pack(">H", _ANY_HOST)]
    parts += [struct.pack(">H", len(part)) + part for part in (b"", b"", _COOKIE, cookie)]
    return b"".join(parts)
