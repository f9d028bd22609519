"""Clock of a recording, estimated from its rounded time stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import ClockSettings
from sim2vr_harness.evaluation.replay.recordings import Recording
from sim2vr_harness.sessions.logs import DIGITS, rounding_s, times_of_log

# Of simulated users and of people in the original (binary32 in both).
_FIXED_STEPS_S = (1.0 / 70.0, 0.002)
_STUDY_STEP_S = 0.014285714
_ROUND_S = 60.0
# A gap this long before the first frame of play is the countdown.
_SHORTEST_COUNTDOWN_S = 0.5
# A fixed step belongs to the first frame with k h <= t + this, for rounded t. Results are the same
# within 0.1 % from -2e-5 to 2e-5.
_TOLERANCE_S = 1e-5
# Log times are game times: what a hitch took from the game is not in them.
_NO_MAXIMUM_S = 120.0


@dataclass(frozen=True)
class Timing:
    """How to drive the app so that its clock reads what the recording's did.

    Attributes:
        frame_times_ns: (N,) of the recording's frames, absolute.
        play_start_ns: The frame in which play was started, one before the first frame of play; None
            when that is frame 0 (no countdown).
        countdown_s: Option ``countdown_seconds``.
        round_s: Option ``round_seconds``.
        clock: Fixed step and tolerances.
        lockstep: The frames lie on the grid of a simulated user's app.
    """

    frame_times_ns: NDArray[np.int64]
    play_start_ns: int | None
    countdown_s: float
    round_s: float
    clock: ClockSettings
    lockstep: bool


def printed(time_s: float) -> float:
    """A time as the original's log prints it: binary32, 7 significant digits."""
    return float(f"{np.float32(time_s):.{DIGITS}g}")


def timing_of(recording: Recording, fixed_step_s: float | None = None) -> Timing:
    """Work out the clock of a recording.

    Args:
        recording: The round.
        fixed_step_s: Period of its fixed steps, s; None: as the source says, or the one of the
            original's two (1/70 s for people, 0.002 s for simulated users) that its events lie on.

    Raises:
        InputError: The events fit neither fixed step, or the frames are no round.
    """
    times_ns, rate = times_of_log(recording.times_s)
    step_s = fixed_step_s or recording.fixed_step_s or _fixed_step(recording)
    clock = ClockSettings(
        fixed_delta_time_s=step_s,
        maximum_delta_time_s=_NO_MAXIMUM_S,
        fixed_step_tolerance_s=0.0 if rate is not None else min(_TOLERANCE_S, step_s / 4),
    )
    start_ns, countdown_s = _start_of_play(times_ns)
    base_ns = int(times_ns[0]) if start_ns is None else start_ns
    round_s = _round_length(recording, times_ns, base_ns)
    if start_ns is not None and round_s == _ROUND_S:
        start_ns = _start_that_ends_on_time(times_ns, start_ns)
        countdown_s = _countdown(times_ns, start_ns)
    return Timing(times_ns, start_ns, countdown_s, round_s, clock, rate is not None)


def _fixed_step(recording: Recording) -> float:
    """The original's fixed step whose multiples the events' times are."""
    times = np.array([event.time_s for event in recording.events if event.kind != "spawn"])
    if len(times) == 0:
        return _STUDY_STEP_S if times_of_log(recording.times_s)[1] is None else 0.002
    for exact_s in _FIXED_STEPS_S:
        step_s = _STUDY_STEP_S if exact_s == _FIXED_STEPS_S[0] else exact_s
        grid_s = float(np.float32(step_s))
        off_s = np.abs(np.rint(times / grid_s) * grid_s - times)
        if np.mean(off_s <= rounding_s(times) + 1e-6) > 0.9:
            return step_s
    raise InputError(
        "--fixed-step",
        "nothing",
        f"the period of the fixed steps in s: the events of {recording.name} lie neither on "
        "multiples of 1/70 s nor of 0.002 s",
    )


def _start_of_play(times_ns: NDArray[np.int64]) -> tuple[int | None, float]:
    """Time of the frame that started play, and the countdown that makes it so."""
    gap_ns = int(times_ns[1] - times_ns[0])
    frame_ns = int(np.median(np.diff(times_ns[1:])))
    if gap_ns < max(_SHORTEST_COUNTDOWN_S * 1e9, 2 * frame_ns):
        return None, 0.0
    start_ns = int(times_ns[1]) - frame_ns
    return start_ns, _countdown(times_ns, start_ns)


def _countdown(times_ns: NDArray[np.int64], start_ns: int) -> float:
    # A little less than the pause, which binary32 game times may round either way.
    return max(0.0, (start_ns - int(times_ns[0])) / 1e9 - 2e-3)


def _round_length(recording: Recording, times_ns: NDArray[np.int64], start_ns: int) -> float:
    """The round ends with the last frame; no log of the original has its length."""
    if not recording.finished:
        return 3600.0
    before_s, after_s = (float(t - start_ns) / 1e9 for t in times_ns[-2:])
    frame_s = after_s - before_s
    if before_s - frame_s <= _ROUND_S <= after_s + frame_s:
        return _ROUND_S
    return (before_s + after_s) / 2.0


def _start_that_ends_on_time(times_ns: NDArray[np.int64], start_ns: int) -> int:
    """The start nearest to ``start_ns`` with which the last frame is the first after 60 s."""
    edge_ns = 200_000
    low = int(times_ns[-2]) - round(_ROUND_S * 1e9) + edge_ns
    high = int(times_ns[-1]) - round(_ROUND_S * 1e9) - edge_ns
    return min(max(start_ns, low), max(high, low))


def spawn_schedule(
    recording: Recording, times_ns: Sequence[int] | NDArray[np.int64]
) -> tuple[list[float], list[int]]:
    """The options ``spawn_times`` and ``spawn_cells`` that repeat the recorded spawns.

    Each target appears in the frame nearest to its recorded time.

    Raises:
        InputError: A spawn lies at no frame.
    """
    frames_s = np.asarray(times_ns) / 1e9
    times: list[float] = []
    cells: list[int] = []
    for event in recording.events:
        if event.kind != "spawn":
            continue
        nearest = float(frames_s[np.argmin(np.abs(frames_s - event.time_s))])
        if abs(nearest - event.time_s) > 2e-3:
            raise InputError(
                f"{recording.name}, target {event.target}",
                f"a spawn at {event.time_s:g} s, {abs(nearest - event.time_s):.3g} s from a frame",
                "the time of a frame in states.csv",
            )
        times.append(nearest)
        cells.append(event.cell)
    return times, cells
