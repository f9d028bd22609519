"""A session with everything in it, made of closed forms."""

from pathlib import Path

import numpy as np

from sim2vr_harness.sessions import JOINT_NAMES, AppIdentity, Controller, Session, SessionEvent

ROOT = Path(__file__).resolve().parents[3]
FRAMES = 40


def poses(x: float, turn: float = 0.0, count: int = FRAMES) -> np.ndarray:
    """(count, 7): at x, moving up and turning about y."""
    t = np.arange(count) / 72
    half = 0.5 * (turn + t)
    zeros = np.zeros(count)
    return np.stack(
        [zeros + x, 1.0 + 0.1 * t, 0.3 + zeros, zeros, np.sin(half), zeros, np.cos(half)], axis=1
    )


def controller(x: float, *, joints: bool = False) -> Controller:
    """A controller with ray and inputs, of values that IWER's millimetres and bits can hold."""
    rng = np.random.default_rng(round(abs(x) * 100))
    inputs = np.zeros((FRAMES, 13))
    inputs[:, 0:2] = rng.integers(0, 5, (FRAMES, 2)) / 4
    inputs[:, 2:4] = rng.integers(-4, 5, (FRAMES, 2)) / 4
    inputs[:, 4:7] = rng.integers(0, 2, (FRAMES, 3))
    # What is pressed is touched, on the hardware as in IWER.
    for touch, value in ((8, 0), (9, 4), (10, 5), (11, 6)):
        inputs[:, touch] = np.maximum(inputs[:, value] > 0, rng.integers(0, 2, FRAMES))
    inputs[:, 12] = rng.integers(0, 2, FRAMES)
    hand = None
    if joints:
        each = [np.column_stack([poses(x + 0.01 * k), np.full(FRAMES, 0.008)]) for k in range(25)]
        hand = np.stack(each, axis=1)
        assert hand.shape[1] == len(JOINT_NAMES)
    return Controller(poses(x), poses(x, 0.4), inputs, hand)


def full_session() -> Session:
    """72 Hz, both controllers, joints of the right hand, events."""
    times = np.arange(FRAMES) * 13_888_889
    events = (
        SessionEvent(int(times[3]), "haptic", {"hand": "right", "amplitude": 0.5}),
        SessionEvent(int(times[9]), "value", {"name": "score", "value": 1}),
        SessionEvent(int(times[-1]), "end"),
    )
    return Session(
        time_ns=times,
        head=poses(0.0),
        left=controller(-0.2),
        right=controller(0.2, joints=True),
        events=events,
        app=AppIdentity("page", "game.html", "", {"speed": 2.0, "name": "a", "list": [1.0, 2.0]}),
        seed=7,
        headset="Quest 3",
        rate_hz=72.0,
        person="p1",
    )
