"""The panel is played by a script that sees the picture, over every transport."""

from collections.abc import Callable, Mapping

import players
import pytest
from panel_player import PanelPlayer
from transports import TRANSPORTS

from sim2vr_harness.client import AppClient


def play(app: AppClient, seed: int, *, idle: bool = False) -> tuple[Mapping[str, float], float]:
    """(log, sum of rewards) of a whole round."""
    player = PanelPlayer()
    reply = app.reset(seed, players.idle(0))
    total, frame = 0.0, 0
    while not reply.finished:
        frame += 1
        poses = players.idle(frame) if idle else player(frame, app.image)
        reply = app.step(frame * players.FRAME_NS, poses)
        total += reply.reward
    return reply.log, total


# Protocol 1 carries no triggers.
@pytest.mark.parametrize("transport", sorted(set(TRANSPORTS) - {"protocol1"}))
def test_a_round_over_every_transport_with_inputs(transport: str) -> None:
    make: Callable[..., AppClient] = TRANSPORTS[transport]
    with make("panel") as app:
        log, total = play(app, seed=3)
    # A round of 20 s has frames 1 to 400; every third one from the second on is a selection.
    assert log["Points"] == 133.0
    assert log["Errors"] == log["Timeouts"] == 0.0
    # The first button is seen in frame 0; each next one comes up with the selection before it.
    assert log["MedianSelectionTime"] == pytest.approx(0.15, abs=1e-4)
    assert 1330.0 - 0.1 * 400 < total < 1330.0


def test_the_idle_operate_nothing() -> None:
    options = {"round_seconds": 2.0, "timeout_seconds": 0.5}
    with TRANSPORTS["alone"]("panel", options, width=16, height=16) as app:
        log, _ = play(app, seed=1, idle=True)
    assert log["Points"] == log["Errors"] == 0.0
    # At 0.5, 1.0, 1.5 and 2.0 s.
    assert log["Timeouts"] == 4.0
