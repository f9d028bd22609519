"""An unmodified OpenXR program as an app in lockstep."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from sim2vr_harness.client.answers import BadReply
from sim2vr_harness.client.base import AppReply, Float64Array, Int64Array, OptionValue, UInt8Array
from sim2vr_harness.client.devices import HANDS, DevicePoses
from sim2vr_harness.client.errors import AppDied, AppError, AppRefused, AppUnsupported
from sim2vr_harness.client.foreign import FARTHEST_M, ForeignApp
from sim2vr_harness.client.openxr.clock import START_NS
from sim2vr_harness.client.openxr.link import SessionEnded
from sim2vr_harness.client.openxr.program import Launch, Program
from sim2vr_harness.client.openxr.values import Happened, ProgramValues
from sim2vr_harness.client.openxr.wire import Kind, StepAnswer, answer_in, step_body
from sim2vr_harness.client.poses import checked_rows, later_times, one_frame
from sim2vr_harness.client.process import end_words
from sim2vr_harness.client.runtime import checked_seed
from sim2vr_harness.client.shared_images import map_file
from sim2vr_harness.client.transport import AppsWanted

CAPABILITIES = frozenset({"frames", "inputs", "left_controller", "haptics", "two_eyes"})
_AHEAD_S = 0.1
"""A program that takes longer to start is started ahead of the next round."""
_FIRST_FRAMES = 2
"""Of a round: in the first a session gets its focus, and hands are there from the second on."""
_EXIT_S = 1.0
"""How long a program that ended its session may take to exit, for its status to be told."""
_DOING = "answer to a step"
_HINT = (
    " (it drew no frame: is it stuck, does it wait for real time to pass (--virtual-clock), or "
    "does it wait for a frame before it ended the last (transport_options.gate=pipelined)?)"
)


class OpenXRApp(ForeignApp):
    """One program, started anew for every round.

    Args:
        wanted: what is requested.
        launch: how to start the program.
        pipelined: whether its images are one frame late.
        ahead: whether the next start is made during the round: ``auto``, ``true``, ``false``.
        on_close: called at the end.

    Raises:
        AppRefused: the program or an expression of the task cannot be used.
    """

    kind = "a program"

    def __init__(
        self,
        wanted: AppsWanted,
        launch: Launch,
        *,
        pipelined: bool,
        ahead: str,
        on_close: Callable[[], None],
    ) -> None:
        super().__init__(wanted.width, wanted.height, wanted.eyes)
        self._wanted, self._launch = wanted, launch
        self._pipelined, self._ahead, self._on_close = pipelined, ahead, on_close
        self._values = ProgramValues(wanted.values)
        self._options: dict[str, OptionValue] = dict(wanted.options)
        self._program: Program | None = None
        self._spare: tuple[list[str], Program] | None = None
        self._shared: UInt8Array | None = None
        self._awaited: list[bytes] = []
        self._poses: Float64Array = np.zeros((3, 7))
        self._last_ns = 0
        self._start_s = 0.0
        self._described = ""

    @property
    def capabilities(self) -> frozenset[str]:
        return CAPABILITIES

    @property
    def renderer_description(self) -> str:
        return self._described or "OpenXR program, not started yet"

    @property
    def usable(self) -> bool:
        """Whether the program can still be asked."""
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
        """See :class:`AppClient`; starts the program.

        ``{seed}`` and ``{NAME}`` of an option in its arguments are replaced.
        """
        self._require_open()
        checked_seed(seed)
        if time_ns != 0:
            raise AppUnsupported("time_ns: a program's clock begins at 0 with each round")
        rows, inputs = checked_rows(one_frame(poses), 1)
        self._options |= options or {}
        self._end_program()
        self._program = program = self._started(self._command(seed))
        self._values.begin()
        program.greet()
        assert program.about is not None and program.session is not None
        name = program.about.application or program.name
        self._described = f"{name} over OpenXR ({program.session.graphics})"
        self._shared = None
        if program.session.graphics != "headless" and self._wanted.renderer != "null":
            shape = (self._wanted.eyes, self._wanted.height, self._wanted.width, 4)
            if program.link.file is not None:
                self._shared = map_file(program.link.file, shape)
            if self._shared is None:
                raise program.malformed("it sent no memory that its images fit into")
        self._playing, self._last_ns, self._poses = True, 0, rows[-1]
        frames = _FIRST_FRAMES + self._pipelined
        times = np.arange(1 - frames, 1, dtype=np.int64) * self._period_ns
        self._send([(times, np.repeat(rows, frames, 0), np.repeat(inputs, frames, 0))], poses)
        reply = self.finish_step()
        # Start the next round's program, where that takes long and needs no seed.
        command = self._command(seed)
        ahead_program = self._program
        assert ahead_program is not None and ahead_program.started_s is not None
        slow = self._ahead == "true" or (
            self._ahead == "auto" and ahead_program.started_s > _AHEAD_S
        )
        if slow and command == self._command(seed + 1):
            self._spare = command, Program(replace(self._launch, command=command))
        return reply

    @property
    def _period_ns(self) -> int:
        return int(1e9 / self._launch.config["frame_rate_hz"])

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """See :class:`AppClient`; sends the frames."""
        self._require_round()
        if self._awaited:
            raise AppError("step: the last one goes on; call finish_step first")
        times = later_times(times_ns, self._last_ns)
        rows, inputs = checked_rows(poses, len(times))
        self._last_ns, self._poses = int(times[-1]), rows[-1]
        parts = [(times, rows, inputs)]
        cut = range(len(times))[drawn] + 1
        if cut < len(times):  # the image is of a message's last frame
            parts = [
                (times[:cut], rows[:cut], inputs[:cut]),
                (times[cut:], rows[cut:], inputs[cut:]),
            ]
        self._send(parts, poses)

    def _send(
        self, parts: list[tuple[Int64Array, Float64Array, Float64Array]], poses: DevicePoses
    ) -> None:
        """Send the first part of a step; keeps the second, which draws nothing."""
        tracked = poses.left_controller is not None, poses.right_controller is not None
        image = self._wanted.renderer != "null"
        self._awaited = [
            step_body(START_NS + times, rows, inputs, tracked, image=image and k == 0)
            for k, (times, rows, inputs) in enumerate(parts)
        ]
        self._start_s = (START_NS + int(parts[0][0][0])) * 1e-9
        self._send_part()

    def _send_part(self) -> None:
        program, body = self._program, self._awaited[0]
        assert program is not None
        if program.clock is not None:
            program.clock.play(int.from_bytes(body[4:12], "little"))
        program.link.send(Kind.STEP, body)

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`; waits for the program."""
        program = self._program
        if not self._awaited or program is None:
            raise AppError("finish_step: no step was started; call start_step first")
        answers: list[StepAnswer] = []
        self._left = ""
        while self._awaited:
            try:
                answers.append(self._answer(program))
            except SessionEnded as end:
                self._awaited.clear()
                self._playing = False
                # How the program left.
                program.link.give_up(end)
                assert program.about is not None and program.session is not None
                name = program.about.application or program.name
                first = self._last_ns == 0
                when = "before its first frame" if first else f"after {self._last_ns * 1e-9:.1f} s"
                words = f"{name}: the program ended its session ({end}) {when}"
                if program.process.wait(_EXIT_S):
                    words += f", {end_words(program.process.exit_status)}"
                    if program.process.exit_status != 0:
                        raise AppDied(words + program.process.log_words()) from None
                if first:
                    headless = program.session.graphics == "headless"
                    seen = "; this one has no graphics (XR_MND_headless)" if headless else ""
                    raise AppRefused(
                        f"{words}, expected one that ends frames (xrEndFrame){seen}"
                    ) from None
                self._left = words
                break
            except BaseException:
                self._awaited.clear()
                raise
            del self._awaited[0]
            if self._awaited:
                self._send_part()
        if self._spare is not None:
            self._greet_spare(self._spare[1])
        pulses = tuple(pulse for answer in answers for pulse in answer.haptics)
        labels = [label for answer in answers for label in answer.labels]
        lines = program.lines() if self._values.of_lines else []
        return AppReply(
            reward=0.0,
            finished=not self._playing,
            time_feature=0.0,
            log={},
            haptics=pulses,
            values=self._values.take(Happened(self._poses, pulses, labels, lines)),
            left=self._left,
        )

    def _answer(self, program: Program) -> StepAnswer:
        kind, body = program.link.receive(_DOING, self._wanted.place.timeout_s, _HINT)
        if kind != Kind.ANSWER:
            raise program.malformed(f"got a message of kind {kind.name}, expected an answer")
        if program.clock is not None:
            program.clock.wait()
        try:
            answer = answer_in(body)
        except BadReply as error:
            raise program.link.malformed(error) from error
        if answer.has_image and self._shared is not None:
            if self._launch.depth and not answer.has_depth and answer.layers > 0:
                raise program.link.give_up(program.without_depth("submits no depth"))
            self._image[...] = self._shared if self._wanted.eyes == 2 else self._shared[0]
        return answer

    # --- the program ---------------------------------------------------------------------------

    def _command(self, seed: int) -> list[str]:
        """The program with its arguments, in which seed and options are replaced."""
        known = {**self._options, "seed": seed}
        command = []
        for word in self._launch.command:
            for name, value in known.items():
                word = word.replace(f"{{{name}}}", str(value))
            command.append(word)
        return command

    def _started(self, command: list[str]) -> Program:
        """The program that was started ahead, if it is the same, or another."""
        spare, self._spare = self._spare, None
        if spare is not None:
            if spare[0] == command and spare[1].link.usable and spare[1].process.running:
                return spare[1]
            spare[1].kill()
        return Program(replace(self._launch, command=command))

    def _greet_spare(self, program: Program) -> None:
        """Answer what it says; one that fails is started again when its turn comes."""
        try:
            program.greet_if_there()
        except (AppError, AppRefused, SessionEnded):
            self._spare = None
            program.kill()

    def _end_program(self) -> None:
        self._playing = False
        self._awaited.clear()
        self._shared = None
        if self._program is not None:
            self._program.kill()
            self._program = None

    def close(self) -> None:
        """See :class:`AppClient`; ends the program."""
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


def config_of(
    wanted: AppsWanted,
    *,
    frame_rate_hz: int,
    vertical_fov_deg: float,
    pipelined: bool,
    profile: str,
) -> dict[str, object]:
    """Return the settings of a user that the runtime receives."""
    return {
        "width": wanted.width,
        "height": wanted.height,
        "ipd_m": wanted.ipd_m,
        "vertical_fov_deg": vertical_fov_deg,
        "frame_rate_hz": frame_rate_hz,
        "depth": wanted.depth,
        "eyes": wanted.eyes,
        "hands": list(HANDS),
        "profile": profile,
        "gate": "pipelined" if pipelined else "strict",
        "timeout_s": wanted.place.timeout_s,
        "start_time_ns": START_NS,
        "images": wanted.renderer != "null",
        "farthest_m": FARTHEST_M,
    }
