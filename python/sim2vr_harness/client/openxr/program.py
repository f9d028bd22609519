"""One start of an OpenXR program: its process, the greeting, and what it prints."""

import json
import os
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim2vr_harness.client.answers import BadReply
from sim2vr_harness.client.errors import AppDied, AppRefused, ProtocolError
from sim2vr_harness.client.openxr.clock import CLOCK_VARIABLE, VirtualClock
from sim2vr_harness.client.openxr.link import Link, SessionEnded
from sim2vr_harness.client.openxr.wire import About, Kind, SessionFacts, about_in, session_in
from sim2vr_harness.client.process import AppProcess

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
_NO_SESSION = "; it made an instance and no session: its log says what it did not find"


@dataclass(frozen=True)
class Launch:
    """How a program is started.

    Attributes:
        command: program and arguments.
        manifest: of the runtime.
        config: settings that the runtime receives.
        preload: libraries.
        environment: further variables.
        virtual_clock: whether its time is virtual.
        depth: whether a user sees depth.
        start_timeout_s: how long the start may take.
        depth_unit_m: metres of one unit of its depth; None: what its engine is known to give.
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
        """Whether its session was accepted."""
        return self.started_s is not None

    @property
    def name(self) -> str:
        """What to call it."""
        return self.process.name

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
            with suppress(SessionEnded):  # of an instance that only looked around
                self._answer(*self.link.receive(doing, limit_s, hint, deadline=deadline))

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
                self.about = about_in(body)
                config = self._launch.config_for(self.about.engine)
                self.link.send(Kind.CONFIG, json.dumps(config).encode())
                return
            if kind == Kind.SESSION and self.about is not None:
                self.session = session_in(body)
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
            f"vision.channels: got depth, but {self.name} {what} "
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

    def died(self, what: str) -> Exception:
        """Return the error of a program that cannot go on."""
        return self.link.give_up(AppDied(f"{self.process}: {what}{self.process.log_words()}"))

    def malformed(self, what: str) -> Exception:
        """Return the error for an answer that is another thing."""
        return self.link.give_up(ProtocolError(f"{self.process}: {what}"))

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
