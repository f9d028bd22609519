"""Games are played to their ends by scripts that know the level, or see the picture."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import players
import pytest
from beats_player import BeatsPlayer
from transports import TRANSPORTS

from sim2vr_harness.client import AppClient, DevicePoses, OptionValue, describe_level
from sim2vr_harness.human_comparison.fitts import aimed_person, aimed_round
from sim2vr_harness.sessions import read_sessions

ALONE: Callable[..., AppClient] = TRANSPORTS["alone"]
FIRST = {"level": "first", "end_on_miss": True}
FULL = {"level": "full", "end_on_miss": True}
GENERATED = {"level": "generated", "level_seconds": 30.0, "end_on_miss": True}


def still(frame: int, image: np.ndarray) -> DevicePoses:
    return players.idle(frame)


def play(
    app: AppClient, player: Any, seed: int, period_ns: int = players.FRAME_NS
) -> tuple[Mapping[str, float], float, int]:
    """Log, sum of rewards and frames of a whole round."""
    reply = app.reset(seed, players.idle(0))
    total, frame = 0.0, 0
    while not reply.finished:
        frame += 1
        reply = app.step(frame * period_ns, player(frame, app.image))
        total += reply.reward
    return reply.log, total, frame


@pytest.mark.parametrize(
    ("options", "seed", "rate_hz"),
    [(FIRST, 1, 10), (FIRST, 1, 90), (FULL, 1, 20), (GENERATED, 2, 20)],
)
def test_every_box_of_a_beats_level_is_cut(
    options: dict[str, OptionValue], seed: int, rate_hz: int
) -> None:
    level = describe_level("beats", options, seed)
    kinds = [item.kind for item in level.items]
    boxes = kinds.count("left box") + kinds.count("right box")
    period_ns = 1_000_000_000 // rate_hz
    script = BeatsPlayer(level, period_ns / 1e9)
    with ALONE("beats", options, width=16, height=16) as app:
        log, total, _ = play(app, lambda frame, image: script(frame), seed, period_ns)
        idle, _, _ = play(app, still, seed, period_ns)
    assert log["AccumulatedCorrectSlices"] == log["Boxes"] == log["MaxCombo"] == boxes >= 4
    assert log["AccumulatedErrors"] == log["Misses"] == 0.0
    # 4.2 m/s along: 50 + 75 * 3.7 / 4.5 + 75. Frames that lie half in a stroke see less speed.
    assert 125.0 * boxes < log["Score"] <= 187.0 * boxes
    assert total == pytest.approx(log["Score"])
    assert log["CutAngleError"] < 1.0
    assert log["MinesAvoided"] == kinds.count("mine")
    assert (log["WallsAvoided"] > 0) == ("wall" in kinds)
    assert (idle["Score"], idle["Misses"]) == (0.0, 1.0)


def test_the_panel_is_operated_by_one_who_sees_it() -> None:
    with TRANSPORTS["protocol2"]("panel") as app:
        log, total, _ = play(app, players.PanelPlayer(), seed=3)
    # A round of 20 s has frames 1 to 400; every third one from the second on is a selection.
    assert log["Points"] == 133.0
    assert log["Errors"] == log["Timeouts"] == 0.0
    # The first button is seen in frame 0; each next one comes up with the selection before it.
    assert log["MedianSelectionTime"] == pytest.approx(0.15, abs=1e-4)
    assert 1330.0 - 0.1 * 400 < total < 1330.0
    options = {"round_seconds": 2.0, "timeout_seconds": 0.5}
    with ALONE("panel", options, width=16, height=16) as app:
        log, _, _ = play(app, still, seed=1)
    assert log["Points"] == log["Errors"] == 0.0
    assert log["Timeouts"] == 4.0  # at 0.5, 1.0, 1.5 and 2.0 s


@pytest.mark.parametrize("period_ns", [players.FRAME_NS, 12_500_000])
def test_targets_are_tapped_and_the_logs_say_what_the_game_measured(
    period_ns: int, tmp_path: Path
) -> None:
    with ALONE("pointing", log_dir=tmp_path) as app:
        log, total, _ = play(app, players.PointingPlayer(), 3, period_ns)
    assert log["Points"] == log["Trials"] == 90.0
    assert (log["Failures"], log["Blocks"]) == (0.0, 9.0)
    # Three frames from tap to tap, whatever the distance.
    tap_s = 3e-9 * period_ns
    assert log["MovementTime"] == pytest.approx(tap_s, rel=1e-3)
    assert 0.0 < log["EndpointSpread"] < 0.01
    assert log["Throughput"] == pytest.approx(log["EffectiveIndex"] / tap_s, rel=1e-3)
    # 10 each, and at most 0.1 off per frame for the distance.
    assert 900.0 - 0.1 * 271 < total < 900.0
    events = (tmp_path / "0000-pointing" / "events.csv").read_text()
    assert (events.count("target_hit"), events.count("block_end")) == (90, 9)
    if period_ns != players.FRAME_NS:
        return
    # Worked out anew from places and times; binary32 numbers in the logs.
    found = aimed_person([aimed_round(each) for each in read_sessions(tmp_path)], "script")
    assert found.targets == log["Trials"]
    assert sum(one.movements for one in found.difficulties) == log["Movements"]
    assert found.throughput_bps == pytest.approx(log["Throughput"], rel=1e-4)
    spread = sum(one.spread_m**2 for one in found.difficulties) / 9
    assert spread**0.5 == pytest.approx(log["EndpointSpread"], rel=1e-3)
    assert [round(one.bits, 3) for one in found.difficulties] == [
        *(1.688, 2.115, 2.322, 2.585, 2.807, 3.02, 3.322, 3.544, 4.087)
    ]


def test_the_idle_let_every_target_go() -> None:
    options = {"timeout_seconds": 0.1, "distances_m": [0.2], "widths_m": [0.03]}
    with ALONE("pointing", options, width=16, height=16) as app:
        log, _, frames = play(app, still, seed=1)
    assert log["Timeouts"] == log["Trials"] == 10.0
    assert log["Points"] == log["Errors"] == 0.0
    assert frames == 20
