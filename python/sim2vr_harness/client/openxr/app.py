"""An unmodified OpenXR program as an app in lockstep, and the transport of such programs."""

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim2vr_harness.base import paths
from sim2vr_harness.client.answers import BadReply
from sim2vr_harness.client.base import AppReply, Float64Array, Int64Array, OptionValue, UInt8Array
from sim2vr_harness.client.devices import HANDS, DevicePoses
from sim2vr_harness.client.errors import AppDied, AppError, AppRefused
from sim2vr_harness.client.foreign import (
    FARTHEST_M,
    FRAME_RATE_HZ,
    VERTICAL_FOV_DEG,
    ForeignApp,
    refuse_logs,
)
from sim2vr_harness.client.openxr.link import Kind, SessionEnded, StepAnswer, answer_in, step_body
from sim2vr_harness.client.openxr.program import START_NS, Display, Launch, Program
from sim2vr_harness.client.openxr.runtime_files import (
    CLOCK_LIBRARY,
    MODES_LIBRARY,
    find_library,
    find_runtime,
)
from sim2vr_harness.client.openxr.values import Happened, ProgramValues
from sim2vr_harness.client.process import end_words
from sim2vr_harness.client.shared_images import map_file
from sim2vr_harness.client.transport import AppsWanted, Transport, checked_options

_AHEAD_S = 0.1
"""A program that takes longer to start is started ahead of the next round."""
_FIRST_FRAMES = 2
"""Of a round: in the first a session gets its focus, and hands are there from the second on."""
_EXIT_S = 1.0
"""Deadline for a program that ended its session to exit, so that its exit status is reported, s."""
_HINT = (
    " (it drew no frame: is it stuck, does it wait for real time to pass (--virtual-clock), or "
    "does it wait for a frame before it ended the last (transport_options.gate=pipelined)?)"
)
_CAPABILITIES = frozenset({"frames", "inputs", "left_controller", "haptics", "two_eyes"})


class OpenXRApp(ForeignApp):
    """One program, started anew for every round.

    Args:
        wanted: what is requested.
        launch: how to start the program.
        ahead: whether the next start is made during the round: ``auto``, ``true``, ``false``.
        on_close: called at the end.

    Raises:
        AppRefused: the program or an expression of the task cannot be used.
    """

    kind = "a program"
    found_capabilities = _CAPABILITIES

    def __init__(
        self, wanted: AppsWanted, launch: Launch, *, ahead: str, on_close: Callable[[], None]
    ) -> None:
        super().__init__(wanted)
        self._launch, self._ahead, self._on_close = launch, ahead, on_close
        self._values = ProgramValues(wanted.values)
        self._program: Program | None = None
        self._spare: tuple[list[str], Program] | None = None
        self._shared: UInt8Array | None = None
        self._awaited: list[bytes] = []
        self._poses: Float64Array = np.zeros((3, 7))
        self._described = "OpenXR program, not started yet"

    @property
    def renderer_description(self) -> str:
        return self._described

    @property
    def usable(self) -> bool:
        """True if the program still answers requests."""
        return self._program is not None and self._program.link.usable

    # --- rounds --------------------------------------------------------------------------------

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """Start the program and begin a round.

        ``{seed}`` and ``{NAME}`` of an option are replaced in its arguments.
        """
        rows, inputs = self._checked_reset(seed, poses, time_ns)
        self._options |= options or {}
        self._end_program()
        command = self._command(seed)
        spare, self._spare = self._spare, None
        if spare is not None:
            if spare[0] == command and spare[1].link.usable and spare[1].process.running:
                self._program = spare[1]
            else:
                spare[1].kill()
        program = self._program or Program(replace(self._launch, command=command))
        self._program = program
        self._values.begin()
        program.greet()
        assert program.session is not None and program.started_s is not None
        self._described = f"{program.name} over OpenXR ({program.session.graphics})"
        if program.session.graphics != "headless" and self._wanted.renderer != "null":
            shape = (self._wanted.eyes, self._wanted.height, self._wanted.width, 4)
            if program.link.file is not None:
                self._shared = map_file(program.link.file, shape)
            if self._shared is None:
                raise program.link.malformed("it sent no memory that its images fit into")
        self._playing, self._last_ns = True, 0
        frames = _FIRST_FRAMES + (self._launch.config["gate"] == "pipelined")
        times = np.arange(1 - frames, 1, dtype=np.int64) * int(
            1e9 / self._launch.config["frame_rate_hz"]
        )
        rows, inputs = (np.repeat(part, frames, 0) for part in (rows, inputs))
        self._send(times, rows, inputs, poses, frames - 1)
        reply = self.finish_step()
        # Start the next round's program, where that takes long and needs no seed.
        slow = self._ahead == "auto" and program.started_s > _AHEAD_S
        if (slow or self._ahead == "true") and command == self._command(seed + 1):
            self._spare = command, Program(replace(self._launch, command=command))
        return reply

    def _command(self, seed: int) -> list[str]:
        """The program with its arguments, in which seed and options are replaced."""
        command = []
        for word in self._launch.command:
            for name, value in {**self._options, "seed": seed}.items():
                word = word.replace(f"{{{name}}}", str(value))
            command.append(word)
        return command

    def _send(
        self,
        times_ns: Int64Array,
        rows: Float64Array,
        inputs: Float64Array,
        poses: DevicePoses,
        drawn: int,
    ) -> None:
        """Send the frames up to the drawn one, a message's last; keeps the others."""
        self._poses = rows[-1]
        tracked = poses.left_controller is not None, poses.right_controller is not None
        image = self._wanted.renderer != "null"
        parts = slice(0, drawn + 1), slice(drawn + 1, len(times_ns))
        self._awaited = [
            step_body(
                START_NS + times_ns[part], rows[part], inputs[part], tracked, image=image and first
            )
            for part, first in zip(parts, (True, False), strict=True)
            if part.start < part.stop
        ]
        self._send_part()

    def _send_part(self) -> None:
        program, body = self._program, self._awaited[0]
        assert program is not None
        if program.clock is not None:
            program.clock.play(int.from_bytes(body[4:12], "little"))
        program.link.send(Kind.STEP, body)

    def finish_step(self) -> AppReply:
        """Wait for the program to finish the step, and return its reply."""
        self._require_step()
        program = self._program
        assert program is not None
        answers: list[StepAnswer] = []
        self._left = ""
        try:
            while self._awaited:
                answers.append(self._answer(program))
                del self._awaited[0]
                if self._awaited:
                    self._send_part()
        except SessionEnded as end:
            self._left = self._leave(program, end)
        finally:
            self._awaited.clear()
        if self._spare is not None:
            try:
                self._spare[1].greet_if_there()
            except (AppError, AppRefused):  # is started again when its turn comes
                self._spare[1].kill()
                self._spare = None
        pulses = tuple(pulse for answer in answers for pulse in answer.haptics)
        labels = [label for answer in answers for label in answer.labels]
        lines = program.lines() if self._values.of_lines else []
        happened = Happened(self._poses, pulses, labels, lines)
        return self._reply(pulses, self._values.take(happened))

    def _answer(self, program: Program) -> StepAnswer:
        link, timeout_s = program.link, self._wanted.place.timeout_s
        kind, body = link.receive("answer to a step", timeout_s, _HINT)
        if kind != Kind.ANSWER:
            raise link.malformed(f"got a message of kind {kind.name}, expected an answer")
        if program.clock is not None:
            program.clock.wait()
        try:
            answer = answer_in(body)
        except BadReply as error:
            raise link.malformed(error) from error
        if answer.has_image and self._shared is not None:
            if self._launch.depth and not answer.has_depth and answer.layers > 0:
                raise link.give_up(program.without_depth("submits no depth"))
            self._image[...] = self._shared if self._wanted.eyes == 2 else self._shared[0]
        return answer

    def _leave(self, program: Program, end: SessionEnded) -> str:
        """End the round of a program that ended its session; returns how it left.

        Raises:
            AppDied: it failed.
            AppRefused: it left before its first frame.
        """
        self._playing = False
        program.link.give_up(end)
        assert program.session is not None
        words = self._ended_words(program.name, str(end), "before its first frame")
        if program.process.wait(_EXIT_S):
            words += f", {end_words(program.process.exit_status)}"
            if program.process.exit_status != 0:
                raise AppDied(words + program.process.log_words()) from None
        if self._last_ns == 0:
            headless = program.session.graphics == "headless"
            seen = "; this one has no graphics (XR_MND_headless)" if headless else ""
            raise AppRefused(f"{words}, expected one that ends frames (xrEndFrame){seen}") from None
        return words

    # --- the end -------------------------------------------------------------------------------

    def _end_program(self) -> None:
        self._playing = False
        self._awaited.clear()
        self._shared = None
        if self._program is not None:
            self._program.kill()
            self._program = None

    def close(self) -> None:
        """End the program."""
        if self._closed:
            return
        super().close()
        if self._spare is not None:
            self._spare[1].kill()
            self._spare = None
        if self._program is not None and not self._awaited:
            self._program.stop()
        self._end_program()
        self._on_close()


# --- the transport -------------------------------------------------------------------------------

_TRUTHS = ("false", "true")
_CHOICES = {
    "gate": ("strict", "pipelined"),
    "virtual_clock": _TRUTHS,
    "xvfb": _TRUTHS,
    "ahead": ("auto", *_TRUTHS),
    "frame_rate_hz": (str(FRAME_RATE_HZ), "90"),
    "profile": ("oculus-touch", "valve-index", "htc-vive", "khr-simple"),
}
_PROFILES = {
    "oculus-touch": "/interaction_profiles/oculus/touch_controller",
    "valve-index": "/interaction_profiles/valve/index_controller",
    "htc-vive": "/interaction_profiles/htc/vive_controller",
    "khr-simple": "/interaction_profiles/khr/simple_controller",
}


class _Programs:
    """The source of the users' programs; they share a display."""

    def __init__(self, wanted: AppsWanted) -> None:
        self._wanted = wanted
        self._options = checked_options(wanted.place.options, _CHOICES)
        self._display: Display | None = None
        self._open = 0

    def __call__(self, index: int, log_dir: Path | None) -> OpenXRApp:
        """The program of user ``index``; see :data:`AppSource`."""
        refuse_logs(log_dir, "a program")
        app = OpenXRApp(
            self._wanted, self._launch(), ahead=self._options["ahead"], on_close=self._closed
        )
        self._open += 1
        return app

    def _closed(self) -> None:
        self._open -= 1
        if self._open == 0 and self._display is not None:
            self._display.close()
            self._display = None

    def _launch(self) -> Launch:
        options, wanted, place = self._options, self._wanted, self._wanted.place
        program = place.executable
        if program is None:
            raise AppRefused("app.executable: got none, expected an OpenXR program")
        virtual = options["virtual_clock"] == "true"
        of_lines = ProgramValues(wanted.values).of_lines
        xvfb = options["xvfb"] == "true"
        libraries = {CLOCK_LIBRARY: virtual or of_lines, MODES_LIBRARY: xvfb}
        preload = []
        for name in (name for name, needed in libraries.items() if needed):
            file = find_library(name)
            if file is None:
                raise AppRefused(
                    f"OpenXR programs: got no {name}, expected the package's own; run: "
                    f"{paths.rebuild_command()}"
                )
            preload.append(file)
        environment = {
            "PYTHONUNBUFFERED": "1",
            "QT_FORCE_STDERR_LOGGING": "1",
            # Mesa's software drivers draw in the thread that asks: programs share the cores.
            "LP_NUM_THREADS": os.environ.get("LP_NUM_THREADS", "0"),
        }
        if xvfb:
            if self._display is None or not self._display.running:
                self._display = Display(place.start_timeout_s)
            environment |= self._display.environment
        config = {
            "width": wanted.width,
            "height": wanted.height,
            "ipd_m": wanted.ipd_m,
            "vertical_fov_deg": VERTICAL_FOV_DEG,
            "frame_rate_hz": int(options["frame_rate_hz"]),
            "depth": wanted.depth,
            "eyes": wanted.eyes,
            "hands": list(HANDS),
            "profile": _PROFILES[options["profile"]],
            "gate": options["gate"],
            "timeout_s": place.timeout_s,
            "start_time_ns": START_NS,
            "images": wanted.renderer != "null",
            "farthest_m": FARTHEST_M,
        }
        found = program if "/" in program else (shutil.which(program) or program)
        return Launch(
            command=[found, *place.arguments],
            manifest=find_runtime(),
            config=config,
            preload=preload,
            environment=environment,
            virtual_clock=virtual,
            depth=wanted.depth and wanted.renderer != "null",
            start_timeout_s=place.start_timeout_s,
            depth_unit_m=_unit_m(options.get("depth_unit_m")),
        )


def _unit_m(text: str | None) -> float | None:
    """Metres of one unit of depth, None: the engine's; raises :class:`AppRefused`."""
    if text is None:
        return None
    try:
        unit_m = float(text)
    except ValueError:
        unit_m = 0.0
    if not 1e-4 <= unit_m <= 10.0:
        raise AppRefused(
            f"app.transport_options.depth_unit_m: got {text!r}, expected a number from 0.0001 to 10"
        )
    return unit_m


OPENXR = Transport(
    name="openxr",
    summary="an OpenXR program as it is, by a runtime of our own",
    apps=_Programs,
    capabilities=_CAPABILITIES,
    reads=frozenset({"executable", "arguments", "timeout_s", "start_timeout_s"}),
    options={
        "gate": "strict (default), or pipelined: for programs that wait for a frame early",
        "virtual_clock": "whether the program's clocks are virtual (default: false)",
        "xvfb": "whether to start an X server without a screen (default: false)",
        "ahead": "start the next round's program early: auto (default: if slow), true, false",
        "frame_rate_hz": "the display's: 72 (default) or 90",
        "depth_unit_m": "metres of one unit of the program's depth (default: 1, Qt's 0.005)",
        "profile": "controllers: oculus-touch (default), valve-index, htc-vive, khr-simple",
    },
    text_options=frozenset({"gate", "profile", "depth_unit_m", "frame_rate_hz", "ahead"}),
    users_per_connection=1,
    needs="executable",
    reports_reward=False,
)
