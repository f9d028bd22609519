"""Rounds whose measures can be worked out by hand."""

from pathlib import Path

import numpy as np

from sim2vr_harness.human_comparison.rounds import PlayedRound, Targets

REST = np.array([0.0, 0.0, -0.15])
ONSET_S, HIT_S, BACK_S, EVERY_S = 0.2, 0.4, 0.6, 0.8


def strikes(
    rate_hz: float = 20.0, *, onset_s: float = ONSET_S, seconds: float = 62.0, seed: int = 3
) -> PlayedRound:
    """Targets come up one by one; each is hit by a straight stroke of constant speed.

    The tool rests until ``onset_s`` after the spawn, is at the target 0.2 s later, and back 0.2 s
    after that. Its root goes half as far. Every tenth target is missed, the tool resting.
    """
    times = np.arange(int(seconds * rate_hz) + 1) / rate_hz
    spawn = np.arange(0.5, seconds - 1.5, EVERY_S)
    spawn = times[np.rint(spawn * rate_hz).astype(int)]  # spawns lie on frames
    n = len(spawn)
    cell = np.random.default_rng(seed).integers(9, size=n)
    place = np.stack([0.125 * (cell % 3 - 1), 0.125 * (1 - cell // 3)], axis=1)
    missed = np.arange(n) % 10 == 9
    tool = np.tile(REST, (len(times), 1))
    for i in np.flatnonzero(~missed):
        end = np.append(place[i], 0.0)
        since = times - spawn[i]
        part = np.interp(since, [onset_s, onset_s + 0.2, onset_s + 0.4], [0.0, 1.0, 0.0])
        tool += part[:, None] * (end - REST)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
    return PlayedRound(
        source=Path("made"),
        group="constrained",
        condition="easy",
        person="a",
        times_s=times,
        tool_m=tool,
        root_m=(tool - REST) / 2.0,
        controller=still,
        head=np.hstack([np.zeros((len(times), 3)), still]),
        targets=Targets(
            spawn_s=spawn,
            end_s=spawn + np.where(missed, 0.75, onset_s + 0.2),
            hit=~missed,
            missed=missed,
            cell=cell,
            place_m=place,
            logged_speed_mps=np.where(missed, np.nan, 1.5),
        ),
        contacts=7,
    )
