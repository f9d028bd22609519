"""Pointing is played to its end by a script that sees the picture, over every transport."""

from collections.abc import Callable, Mapping
from pathlib import Path

import players
import pytest
from pointing_player import PointingPlayer
from transports import TRANSPORTS

from sim2vr_harness.client import AppClient
from sim2vr_harness.human_comparison.fitts import aimed_person, aimed_round
from sim2vr_harness.sessions import read_sessions


def play(
    app: AppClient, seed: int, period_ns: int = players.FRAME_NS
) -> tuple[Mapping[str, float], float]:
    """(log, sum of rewards) of a whole round."""
    player = PointingPlayer()
    reply = app.reset(seed, players.idle(0))
    total, frame = 0.0, 0
    while not reply.finished:
        frame += 1
        reply = app.step(frame * period_ns, player(frame, app.image))
        total += reply.reward
    return reply.log, total


def expect_all_hit(log: Mapping[str, float], seconds: float) -> None:
    assert log["Points"] == log["Trials"] == 90.0
    assert log["Failures"] == 0.0
    assert log["Blocks"] == 9.0
    # Three frames from tap to tap, whatever the distance.
    assert log["MovementTime"] == pytest.approx(3 * seconds, rel=1e-3)
    assert 0.0 < log["EndpointSpread"] < 0.01
    assert log["Throughput"] == pytest.approx(log["EffectiveIndex"] / (3 * seconds), rel=1e-3)


@pytest.mark.parametrize("transport", sorted(TRANSPORTS))
def test_a_round_over_every_transport(transport: str) -> None:
    make: Callable[..., AppClient] = TRANSPORTS[transport]
    with make("pointing") as app:
        log, total = play(app, seed=3)
        expect_all_hit(log, 0.05)
        # 10 each, and at most 0.1 off per frame for the distance.
        assert 900.0 - 0.1 * 271 < total < 900.0


def test_at_another_rate_of_tracking() -> None:
    with TRANSPORTS["alone"]("pointing") as app:
        log, _ = play(app, seed=4, period_ns=12_500_000)
    expect_all_hit(log, 0.0125)


def test_the_idle_let_every_target_go() -> None:
    options = {"timeout_seconds": 0.1, "distances_m": [0.2], "widths_m": [0.03]}
    with TRANSPORTS["alone"]("pointing", options, width=16, height=16) as app:
        reply = app.reset(1, players.idle(0))
        frame = 0
        while not reply.finished:
            frame += 1
            reply = app.step(frame * players.FRAME_NS, players.idle(frame))
    assert reply.log["Timeouts"] == reply.log["Trials"] == 10.0
    assert reply.log["Points"] == reply.log["Errors"] == 0.0
    assert frame == 20


def test_a_log_has_every_selection(tmp_path: Path) -> None:
    with TRANSPORTS["alone"]("pointing", log_dir=tmp_path) as app:
        log, _ = play(app, seed=5)
    events = (tmp_path / "0000-pointing" / "events.csv").read_text()
    assert events.count("target_hit") == log["Points"]
    assert events.count("block_end") == 9


def test_the_logs_say_what_the_game_measured(tmp_path: Path) -> None:
    """Worked out anew from places and times, at 20 Hz; binary32 numbers in the logs."""
    with TRANSPORTS["alone"]("pointing", log_dir=tmp_path) as app:
        log, _ = play(app, seed=6)
    found = aimed_person([aimed_round(each) for each in read_sessions(tmp_path)], "script")
    assert found.targets == log["Trials"]
    assert sum(one.movements for one in found.difficulties) == log["Movements"]
    assert found.throughput_bps == pytest.approx(log["Throughput"], rel=1e-4)
    spread = sum(one.spread_m**2 for one in found.difficulties) / 9
    assert spread**0.5 == pytest.approx(log["EndpointSpread"], rel=1e-3)
    assert [round(one.bits, 3) for one in found.difficulties] == [
        *(1.688, 2.115, 2.322, 2.585, 2.807, 3.02, 3.322, 3.544, 4.087),
    ]
    # Between targets the tip goes out of the way and back: two humps.
    assert all((one.submovements or 0.0) >= 1.0 for one in found.difficulties)
