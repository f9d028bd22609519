"""Beats is played to its end by a script, over every transport."""

from collections.abc import Callable, Mapping

import players
import pytest
from beats_player import BeatsPlayer
from transports import TRANSPORTS

from sim2vr_harness.client import AppClient, DevicePoses, OptionValue, describe_level

Player = Callable[[int], DevicePoses]
FIRST = {"level": "first", "end_on_miss": True}
FULL = {"level": "full", "end_on_miss": True}
GENERATED = {"level": "generated", "level_seconds": 30.0, "end_on_miss": True}


def play(
    app: AppClient, player: Player, seed: int, period_ns: int = players.FRAME_NS
) -> tuple[Mapping[str, float], float]:
    """(log, sum of rewards) of a whole round."""
    reply = app.reset(seed, player(0))
    total, frame = 0.0, 0
    while not reply.finished:
        frame += 1
        reply = app.step(frame * period_ns, player(frame))
        total += reply.reward
    return reply.log, total


def expect_full_combo(log: Mapping[str, float], boxes: int) -> None:
    assert log["AccumulatedCorrectSlices"] == log["Boxes"] == log["MaxCombo"] == boxes
    assert log["AccumulatedErrors"] == log["Misses"] == 0.0
    # 4.2 m/s along: 50 + 75 * 3.7 / 4.5 + 75. Frames that lie half in a stroke see less speed.
    assert 125.0 * boxes < log["Score"] <= 187.0 * boxes
    assert log["CutAngleError"] < 1.0


@pytest.mark.parametrize("transport", sorted(TRANSPORTS))
def test_the_first_ten_seconds_over_every_transport(transport: str) -> None:
    make: Callable[..., AppClient] = TRANSPORTS[transport]
    with make("beats", FIRST) as app:
        log, total = play(app, BeatsPlayer(describe_level("beats", FIRST, 1)), seed=1)
        expect_full_combo(log, 4)
        assert total == log["Score"]
        idle, _ = play(app, players.idle, seed=1)
        assert idle["Score"] == 0.0
        assert idle["Misses"] == 1.0


@pytest.mark.parametrize(("options", "seed"), [(FULL, 1), (GENERATED, 1), (GENERATED, 2)])
def test_whole_levels_with_mines_and_walls(options: dict[str, OptionValue], seed: int) -> None:
    level = describe_level("beats", options, seed)
    kinds = [item.kind for item in level.items]
    with TRANSPORTS["alone"]("beats", options, width=16, height=16) as app:
        log, _ = play(app, BeatsPlayer(level), seed)
    expect_full_combo(log, kinds.count("left box") + kinds.count("right box"))
    assert log["MinesAvoided"] == kinds.count("mine") > 0
    assert log["WallsAvoided"] > 0


@pytest.mark.parametrize("rate_hz", [10, 90])
def test_at_other_rates_of_tracking(rate_hz: int) -> None:
    period_ns = 1_000_000_000 // rate_hz
    player = BeatsPlayer(describe_level("beats", FIRST, 1), period_ns / 1e9)
    with TRANSPORTS["alone"]("beats", FIRST, width=16, height=16) as app:
        log, _ = play(app, player, seed=1, period_ns=period_ns)
    expect_full_combo(log, 4)
