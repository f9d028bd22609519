"""One start of an OpenXR program: its process, greeting, output, virtual time and display."""

import json
import mmap
import os
import re
import secrets
import select
import shutil
import socket
import struct
import time
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim2vr_harness.client.answers import BadReply, read
from sim2vr_harness.client.errors import AppDied, AppRefused, AppTimeout
from sim2vr_harness.client.openxr.link import (
    ABOUT,
    SESSION,
    About,
    Kind,
    Link,
    SessionEnded,
    SessionFacts,
)
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.temporary import OUTSIDE_FILE, TemporaryFolder, remove_same

SOCKET_VARIABLE = "SIM2VR_OPENXR_SOCKET"
_MOST_LINE_BYTES = 1 << 20
"""Of what a program prints in a step; the rest is left out."""
_STOP_S = 1.0
_ENGINES_UNIT_M = {"Qt": 0.005}
"""Metres of a unit of depth, where that is not 1: Qt 6.12 gives centimetres and half the range."""
_NO_HELLO = (
    "; is it an OpenXR program, and does its loader read XR_RUNTIME_JSON (a program with "
    "permissions of its own does not)?"
)
_DISPLAY = re.compile(r"\bxcb\b|\bdisplay\b", re.IGNORECASE)
"""In the output of a program that fails because it has no display."""
_NO_SESSION = "; it made an instance and no session: its log says what it did not find"


@dataclass(frozen=True)
class Launch:
    """Start parameters of a program.

    Attributes:
        command: program and arguments.
        manifest: manifest of the runtime.
        config: settings that the runtime receives.
        preload: libraries to preload.
        environment: further environment variables.
        virtual_clock: true if its time is virtual.
        depth: true if a user sees depth.
        start_timeout_s: deadline of the start, s.
        depth_unit_m: metres of one unit of its depth; None: the known unit of its engine.
    """

    command: Sequence[str]
    manifest: Path
    config: Mapping[str, Any]
    preload: Sequence[Path] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    virtual_clock: bool = False
    depth: bool = True
    start_timeout_s: float = 60.0
    depth_unit_m: float | None = None

    def config_for(self, engine: str) -> dict[str, Any]:
        """Return the settings for a program of an engine."""
        unit_m = self.depth_unit_m or _ENGINES_UNIT_M.get(engine, 1.0)
        return {**self.config, "farthest_m": self.config["farthest_m"] / unit_m}


class Program:
    """A program that was started and plays one round.

    Attributes:
        about: what it says of itself; None before its hello.
        session: what it draws with; None before its session.
        clock: its virtual time, if it has one.
        started_s: seconds until it waited for its first frame; None before.
    """

    def __init__(self, launch: Launch) -> None:
        self.about: About | None = None
        self.session: SessionFacts | None = None
        self._launch = launch
        self._began_s = time.monotonic()
        self.started_s: float | None = None
        ours, theirs = socket.socketpair()
        silent, self._silence = os.pipe()  # no key is pressed, nor does the input end
        self.clock = VirtualClock() if launch.virtual_clock else None
        try:
            inherited = [theirs.fileno()]
            environment = {
                **launch.environment,
                SOCKET_VARIABLE: str(theirs.fileno()),
                "XR_RUNTIME_JSON": str(launch.manifest),
            }
            if self.clock is not None:
                inherited.append(self.clock.descriptor)
                environment[CLOCK_VARIABLE] = str(self.clock.descriptor)
            if launch.preload:
                before = os.environ.get("LD_PRELOAD", "")
                libraries = [*map(str, launch.preload), *([before] if before else [])]
                environment["LD_PRELOAD"] = ":".join(libraries)
            self.process = AppProcess(
                launch.command, environment=environment, stdin=silent, inherited=inherited
            )
        except BaseException:
            ours.close()
            self._close_clock()
            os.close(self._silence)
            raise
        finally:
            theirs.close()
            os.close(silent)
        self._printed = os.open(self.process.log_file, os.O_RDONLY | os.O_CLOEXEC)
        self._unfinished = b""
        self.link = Link(self.process, ours)

    @property
    def ready(self) -> bool:
        """True if the program's session was accepted."""
        return self.started_s is not None

    @property
    def name(self) -> str:
        """Name of the program as it reports it, or else the name of its file."""
        assert self.about is not None
        return self.about.application or self.process.name

    # --- greeting ------------------------------------------------------------------------------

    def greet(self) -> None:
        """Take what it says of itself and its session; waits for both.

        Raises:
            AppRefused: it cannot be played, and would not be another time; says why.
            AppDied, AppTimeout, ProtocolError: it does not start.
        """
        limit_s = self._launch.start_timeout_s
        deadline = time.monotonic() + limit_s
        while not self.ready:
            doing, hint = (
                ("xrCreateInstance", _NO_HELLO)
                if self.about is None
                else ("xrCreateSession", _NO_SESSION)
            )
            try:
                self._answer(*self.link.receive(doing, limit_s, hint, deadline=deadline))
            except SessionEnded:  # of an instance that only looked around
                pass
            except AppDied as error:
                if "DISPLAY" in self._launch.environment or not _DISPLAY.search(str(error)):
                    raise
                words = f"--xvfb: got no display, expected this option; {error}"
                raise AppRefused(words) from error  # it would fail another time, too

    def greet_if_there(self) -> None:
        """The same as far as its messages are there; failures are kept for :meth:`greet`."""
        while not self.ready and self.link.usable:
            with suppress(SessionEnded):
                message = self.link.next_message("xrCreateSession")
                if message is None:
                    return
                self._answer(*message)

    def _answer(self, kind: Kind, body: bytes) -> None:
        try:
            if kind == Kind.HELLO:
                self.about = read("hello", ABOUT, body)
                config = self._launch.config_for(self.about.engine)
                self.link.send(Kind.CONFIG, json.dumps(config).encode())
                return
            if kind == Kind.SESSION and self.about is not None:
                self.session = read("session", SESSION, body)
        except BadReply as error:
            raise self.link.malformed(error) from error
        if self.session is None:
            raise self.link.malformed(BadReply(f"a message of kind {kind.name} while it starts"))
        if self._launch.depth and not self.session.depth_layers:
            self.link.send(Kind.ERROR, json.dumps({"error": "the user needs depth"}).encode())
            raise self.link.give_up(self.without_depth("does not enable the extension"))
        self.link.send(Kind.ACCEPTED)
        self.started_s = time.monotonic() - self._began_s

    def without_depth(self, what: str) -> AppRefused:
        """Return the error for a user that sees depth and a program that submits none."""
        return AppRefused(
            f"vision.channels: got depth, but {self.process.name} {what} "
            "(XR_KHR_composition_layer_depth), expected "
            "--set env.vision.channels=[red,green,blue], or a program that submits depth"
        )

    # --- in play -------------------------------------------------------------------------------

    def lines(self) -> list[str]:
        """Return the lines that it has printed since the last call."""
        got = os.read(self._printed, _MOST_LINE_BYTES)
        if len(got) == _MOST_LINE_BYTES:
            os.lseek(self._printed, 0, os.SEEK_END)
        if not got:
            return []
        *whole, self._unfinished = (self._unfinished + got).split(b"\n")
        self._unfinished = self._unfinished[-_MOST_LINE_BYTES:]
        return [line.decode(errors="replace").rstrip("\r") for line in whole]

    # --- the end -------------------------------------------------------------------------------

    def stop(self) -> None:
        """Let it end by itself, and end it if it does not; idempotent."""
        if self.link.usable and self.ready:
            self.link.send(Kind.QUIT)
            self.process.wait(_STOP_S)
        self.kill()

    def kill(self) -> None:
        """End it at once; idempotent."""
        self.link.close()
        if self._printed >= 0:
            os.close(self._printed)
            os.close(self._silence)
            self._printed = -1
        self._close_clock()
        self.process.kill()

    def _close_clock(self) -> None:
        if self.clock is not None:
            self.clock.close()


# --- virtual time ---------------------------------------------------------------------------

CLOCK_VARIABLE = "SIM2VR_CLOCK"
"""Environment variable with the number of the page's descriptor."""
START_NS = 100_000_000_000
"""XrTime of a round's first frame, with and without virtual time; must be above 0."""
_STARTUP_NS = START_NS - 10_000_000_000
"""Virtual time until the first frame; sleeps of the start fit before it."""

_NOW = struct.Struct("<q")
_STATE = struct.Struct("<II")
_STARTING, _PLAYING, _WAITING = 0, 1, 2


class VirtualClock:
    """The page of one program; see ``app_runtime/preload/clock.c`` for its layout.

    Attributes:
        descriptor: to be inherited by the program.
    """

    def __init__(self) -> None:
        self.descriptor = os.memfd_create("sim2vr-clock", os.MFD_CLOEXEC)
        os.posix_fallocate(self.descriptor, 0, mmap.PAGESIZE)
        self._page = mmap.mmap(self.descriptor, mmap.PAGESIZE)
        self._generation = 0
        _NOW.pack_into(self._page, 0, _STARTUP_NS)
        self._finalizer = weakref.finalize(self, os.close, self.descriptor)

    def play(self, time_ns: int) -> None:
        """Set the time; the program is about to compute frames."""
        _NOW.pack_into(self._page, 0, max(time_ns, *_NOW.unpack_from(self._page)))
        self._set(_PLAYING)

    def wait(self) -> None:
        """Note that the program waits for the next step."""
        self._set(_WAITING)

    def _set(self, state: int) -> None:
        self._generation = (self._generation + 1) & 0xFFFFFFFF
        _STATE.pack_into(self._page, 8, self._generation, state)

    def close(self) -> None:
        """Give the page back; idempotent."""
        self._finalizer()


# --- display --------------------------------------------------------------------------------

_XVFB = ("-nolisten", "tcp", "-noreset", "-screen", "0", "640x480x24")
_DISPLAY_STOP_S = 2.0
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
                [program, *_XVFB, "-auth", self._authority, "-displayfd", str(theirs)],
                inherited=(theirs,),
                home=self._folder,
            )
            os.close(theirs)
            theirs = -1
            deadline = time.monotonic() + start_timeout_s
            said = b""
            while not said.endswith(b"\n"):
                ready, _, _ = select.select([ours], [], [], max(0.0, deadline - time.monotonic()))
                got = os.read(ours, 64) if ready else b""
                if not got:
                    ended = bool(ready) and self._process.wait(1.0)
                    late = f"{self._process} was not ready within {start_timeout_s:g} s"
                    error = self._process.death("while it started") if ended else AppTimeout(late)
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
        """True if the process runs."""
        return self._process.running

    def close(self) -> None:
        """End it; idempotent."""
        self._process.terminate(_DISPLAY_STOP_S)
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
