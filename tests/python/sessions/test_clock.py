"""Which clock made a recording's rounded times. Numbers by hand."""

import numpy as np
import pytest

from sim2vr_harness.sessions import AppIdentity, Session, SessionEvent
from sim2vr_harness.sessions.whacamole import printed, timing_of

PERIOD_20HZ_S = 0.04999999701976776  # the largest binary32 below 0.05
STEP_70HZ_S = 0.014285714365541935  # binary32 of 0.014285714


Event = tuple[float, str, int, int]
"""Time (s), kind, target, cell."""


def recording(times: np.ndarray, events: tuple[Event, ...] = (), finished: bool = True) -> Session:
    pose = np.tile(np.array([0, 1.2, 0, 0, 0, 0, 1.0]), (len(times), 1))
    time_ns = np.rint(times * 1e9).astype(np.int64)
    found = [
        SessionEvent(round(time_s * 1e9), f"target_{kind}", {"target_id": n, "grid_id": cell})
        for time_s, kind, n, cell in events
    ]
    found += [SessionEvent(int(time_ns[-1]), "episode_statistics")] if finished else []
    app = AppIdentity("game", "whacamole", "medium")
    return Session(time_ns, pose, events=tuple(found), app=app, seed=1, source="log")


def device_times() -> np.ndarray:
    """A minute at about 72 Hz after a countdown of 4.02 s, as the original prints it."""
    rng = np.random.default_rng(1)
    t = 325.0 + 4.02 + np.cumsum(rng.uniform(0.0136, 0.0142, 4400))
    last = np.searchsorted(t, t[0] - 0.0139 + 60.0, side="right")
    return np.array([printed(x) for x in np.concatenate([[325.0], t[: last + 1]])])


def test_a_simulated_users_frames_get_their_full_times_back() -> None:
    # The original's simulated rounds: no frame at 0.05 s.
    frames = np.array([0, 0, *range(2, 1202)])
    times = np.array([printed(n * PERIOD_20HZ_S) for n in frames])
    timing = timing_of(recording(times))
    assert timing.play_start_ns is None
    assert timing.round_s == 60.0
    expected = np.rint(frames * PERIOD_20HZ_S * 1e9).astype(np.int64)
    assert np.array_equal(timing.frame_times_ns, expected)
    assert timing.clock.fixed_delta_time_s == 0.002
    assert timing.clock.fixed_step_tolerance_s == 0.0


def test_peoples_frames_are_taken_as_printed() -> None:
    times = device_times()
    timing = timing_of(recording(times))
    assert np.array_equal(timing.frame_times_ns, np.rint(times * 1e9).astype(np.int64))
    assert timing.clock.fixed_delta_time_s == 0.014285714
    assert timing.clock.fixed_step_tolerance_s == 1e-5
    # Play was started in the frame before the first logged one, when the countdown was over.
    assert timing.play_start_ns is not None
    start_s = timing.play_start_ns / 1e9
    assert times[1] - start_s == pytest.approx(0.0139, abs=0.0004)
    assert start_s - 325.0 > timing.countdown_s > start_s - 325.0 - 0.005
    # The round ends in its last frame.
    assert timing.round_s == 60.0
    assert times[-2] <= start_s + 60.0 < times[-1]


@pytest.mark.parametrize("step_s", [0.002, STEP_70HZ_S])
def test_the_fixed_step_is_read_off_the_events(step_s: float) -> None:
    events = tuple(
        (printed(k * float(np.float32(step_s))), "miss", n, 0)
        for n, k in enumerate(range(23100, 26000, 97))
    )
    for times in (device_times(), np.arange(1, 100) * PERIOD_20HZ_S):
        found = timing_of(recording(times, events)).clock.fixed_delta_time_s
        assert np.float32(found) == np.float32(step_s)
