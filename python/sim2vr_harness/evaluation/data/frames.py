"""The app's own log of poses (``states.csv``) as a table: a row per frame of the app."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.evaluation.data.columns import Column, number_table
from sim2vr_harness.evaluation.data.steps import pose_columns
from sim2vr_harness.sessions.state_log import read_state_log

_ROUNDING_S = 1e-4
"""Logged times are binary32."""


def frame_table(episode: str, folder: Path, step_s: float) -> Any:
    """Return the poses that the app logged of a round, tool included; None without a log.

    Args:
        episode: The key of the episode.
        folder: With the round's ``states.csv``.
        step_s: Length of a user step.

    Raises:
        InputError: The log cannot be read.
    """
    file = folder / "states.csv"
    if not file.is_file():
        return None
    log = read_state_log(file)
    poses = {"head": log.head, "right": log.right, "left": log.left, **log.others}
    columns = [
        column
        for name in poses
        for column in pose_columns(name, f"what the app's log calls {name!r}")
    ]
    times_s = log.times_s - log.times_s[0]
    steps = [math.ceil((time_s - _ROUNDING_S) / step_s) for time_s in times_s]
    counts = [
        (Column("frame", "integer", "", "Frame of the app, from 0; a key"), range(len(times_s))),
        (
            Column("step", "integer", "", "The user step that it is part of; 0: before the first"),
            np.maximum(0, steps),
        ),
        (Column("time_s", "number", "s", "Game time of the frame"), log.times_s),
    ]
    values = np.concatenate(list(poses.values()), axis=1, dtype=np.float32)
    return number_table(episode, counts, values, columns)
