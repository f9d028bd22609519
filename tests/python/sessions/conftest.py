"""Recordings made by our own app with a scripted hammer, and the original's log written by hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.client import DevicePoses, InProcessApp, OptionValue, frame_time_ns

HEAD = np.array([0.01, 1.17, 0.02, 0.0, 0.0, 0.0, 1.0])

PlayRound = Callable[..., Path]


def swinging_hand(time_s: float) -> np.ndarray:
    """Strikes cell 4 of the middle area about once a second, wandering a little."""
    z = 0.22 + 0.16 * np.sin(2 * np.pi * 1.1 * time_s) ** 3
    angle = 0.1 * np.sin(0.7 * time_s)
    return np.array(
        [0.15 + 0.1 * np.sin(0.9 * time_s), 1.03, z, np.sin(angle), 0.0, 0.0, np.cos(angle)]
    )


@pytest.fixture
def play_round(tmp_path: Path) -> PlayRound:
    """Plays a round and returns the folder of its log."""

    def play(
        name: str = "logs",
        condition: str = "hard",
        seed: int = 7,
        round_s: float = 6.0,
        rate_hz: int = 20,
        frames_per_step: int = 1,
        start_ns: int = 0,
        options: dict[str, OptionValue] | None = None,
    ) -> Path:
        root = tmp_path / name
        all_options = {"condition": condition, "round_seconds": round_s, **(options or {})}
        with InProcessApp("whacamole", all_options, renderer="null", log_dir=root) as app:
            reply = app.reset(seed, DevicePoses(HEAD, swinging_hand(0.0)), time_ns=start_ns)
            frame = 0
            while not reply.finished:
                times = [
                    start_ns + frame_time_ns(frame + j, rate_hz)
                    for j in range(1, frames_per_step + 1)
                ]
                hands = np.stack([swinging_hand((t - start_ns) / 1e9) for t in times])
                heads = np.tile(HEAD, (frames_per_step, 1))
                reply = app.step_frames(np.array(times), DevicePoses(heads, hands))
                frame += frames_per_step
        return next(root.iterdir())

    return play
