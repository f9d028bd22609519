"""Plays a recording through the app: the recorded poses at the recorded times."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.files import file_name
from sim2vr_harness.client import OptionValue
from sim2vr_harness.evaluation.replay.film import ReplayFilm
from sim2vr_harness.evaluation.replay.recordings import GAME, Event, Recording, read_events
from sim2vr_harness.evaluation.replay.timing import Timing, spawn_schedule, timing_of
from sim2vr_harness.sessions import AppIdentity, Controller, Session
from sim2vr_harness.sessions.replay import replay_session


@dataclass(frozen=True)
class Replay:
    """What our game made of a recording."""

    recording: Recording
    timing: Timing
    closed_loop: bool
    """Spawns were predicted as well, from the seed; otherwise they were taken from the log."""
    events: tuple[Event, ...]


def replay(
    recording: Recording,
    *,
    closed_loop: bool = False,
    fixed_step_s: float | None = None,
    options: Mapping[str, OptionValue] | None = None,
    log_dir: Path | None = None,
    film: ReplayFilm | None = None,
    only: bool = True,
) -> Replay:
    """Play a recording again: as a session, on the recording's absolute clock.

    Args:
        recording: The round.
        closed_loop: Seed and poses only; without, spawns are taken from the log as well.
        fixed_step_s: Period of the recording's fixed steps, s; None works it out.
        options: Further options of the game, over the recording's.
        log_dir: Keeps the replayed round's log here.
        film: Films the round.
        only: There is no other round in the film.

    Raises:
        InputError: The recording is none of this game, or its clock cannot be worked out.
    """
    try:
        timing = timing_of(recording, fixed_step_s)
        session = session_of(recording, closed_loop=closed_loop, timing=timing)
        with ExitStack() as stack:
            root = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            root = root if log_dir is None else log_dir / recording.name
            shown: dict[str, Any] = {}
            if film is not None:
                round_film = film.round(session, recording.name, GAME, only=only)
                shown = {"renderer": "automatic", "watch": stack.enter_context(round_film).watch}
            replay_session(session, options=options, log_dir=root, **shown)
            events = read_events(max(root.glob("*/events.csv")))
        return Replay(recording, timing, closed_loop, events)
    except ValueError as error:
        text, source = str(error), file_name(recording.source)
        if text.startswith(source):
            raise
        raise ValueError(f"{source}: {text}") from error


def session_of(
    recording: Recording, *, closed_loop: bool = True, timing: Timing | None = None
) -> Session:
    """Return a round as a session of the game, with the clock and the options that repeat it.

    Args:
        recording: The round.
        closed_loop: Without, the options take spawns from the log.
        timing: Of its frames; None works it out.
    """
    timing = timing_of(recording) if timing is None else timing
    times_ns, frames = _frames(timing)
    left, right = (
        None if one is None else Controller(grip=one[frames])
        for one in (recording.left, recording.right)
    )
    return Session(
        time_ns=times_ns,
        head=recording.head[frames],
        left=left,
        right=right,
        events=tuple(event.session_event for event in recording.events),
        app=AppIdentity(
            "game", GAME, recording.condition, _options(recording, timing, closed_loop)
        ),
        seed=recording.seed,
        clock=timing.clock,
        source="packed round",
        person=recording.person or "",
    )


def _options(recording: Recording, timing: Timing, closed_loop: bool) -> dict[str, OptionValue]:
    options: dict[str, OptionValue] = {
        "condition": recording.condition,
        "countdown_seconds": timing.countdown_s,
        "round_seconds": timing.round_s,
        **recording.options,
    }
    if not closed_loop:
        times, cells = spawn_schedule(recording, timing.frame_times_ns)
        options |= {"spawn_times": times, "spawn_cells": [float(cell) for cell in cells]}
    return options


def _frames(timing: Timing) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Times of the frames to run, and which recorded one each of them is."""
    times_ns, start = timing.frame_times_ns, timing.play_start_ns
    frames = np.arange(len(times_ns))
    if start is None:
        return times_ns, frames
    # The log has no row for the frame that started play; the hammer is where it is next.
    return np.insert(times_ns, 1, start), np.insert(frames, 1, 1)


def replay_all(
    recordings: list[Recording],
    *,
    closed_loop: bool = False,
    fixed_step_s: float | None = None,
    options: Mapping[str, OptionValue] | None = None,
    log_dir: Path | None = None,
    film: ReplayFilm | None = None,
    threads: int = 2,
) -> Iterator[Replay]:
    """Replay many recordings in their order, in parallel unless they are filmed.

    See :func:`replay`.
    """
    named = _with_distinct_names(recordings)
    one = partial(
        replay,
        closed_loop=closed_loop,
        fixed_step_s=fixed_step_s,
        options=options,
        log_dir=log_dir,
    )
    if film is None:
        with ThreadPoolExecutor(threads) as pool:
            yield from pool.map(one, named)
        return
    for recording in named:
        yield one(recording, film=film, only=len(named) == 1)


def _with_distinct_names(recordings: list[Recording]) -> list[Recording]:
    """Rounds that share a name get as much of their path in front as tells them apart."""
    names = [recording.name for recording in recordings]
    deepest = max(len(recording.source.resolve().parts) for recording in recordings)
    for depth in range(1, deepest):
        if len(set(names)) == len(names):
            break
        names = [
            "/".join([*recording.source.resolve().parts[-1 - depth : -1], recording.name])
            for recording in recordings
        ]
    return [replace(r, name=name) for r, name in zip(recordings, names, strict=True)]
