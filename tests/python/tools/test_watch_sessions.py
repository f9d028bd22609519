"""Sessions to watch, alone and beside a user, without a browser."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from python.tools.test_watch import ball, moment, show_of
from sim2vr_harness.client.scene import PLAYER_LAYER
from sim2vr_harness.sessions import read_session
from sim2vr_harness.tools.watch.frames import Playlist
from sim2vr_harness.tools.watch.sessions import beside, session_show

ROUND = Path(__file__).parents[2] / "data" / "whacamole_round"


def test_a_session_is_played_again_in_its_game() -> None:
    session = read_session(ROUND)
    shown = list(session_show(session, "round").moments())
    hits = sum(event.kind == "target_hit" for event in session.events)
    lines = [line for one in shown for line in one.events]
    assert hits > 3 and len([line for line in lines if "  Hits " in line]) == hits
    assert shown[-1].time_s == pytest.approx(np.ptp(session.time_ns) / 1e9, abs=0.05)
    # What stands for the headset is where the session's head was.
    rows = np.searchsorted(session.time_ns - session.time_ns[0], round(shown[40].time_s * 1e9))
    heads = [one.pose[:3] for one in shown[40].scene.objects if one.layer == PLAYER_LAYER]
    assert min(np.linalg.norm(head - session.head[rows, :3]) for head in heads) < 0.01


def test_a_user_and_a_session_side_by_side() -> None:
    """The user's round has 3 moments, the session's 5; shapes and objects stay apart."""
    player = replace(ball(4, [0, 0, 1, 1]), layer=PLAYER_LAYER)

    def recorded() -> Playlist:
        moments = [moment(k, player, events=(f"event {k}",)) for k in range(5)]
        return Playlist("session", 20.0, lambda: iter(moments))

    both = list(beside(show_of(3, []), recorded()).moments())
    assert [one.time_s for one in both] == pytest.approx([0.05, 0.1, 0.15, 0.2])
    told = [line for one in both for line in one.events]
    assert told == [f"event {k} (session)" for k in range(5)]
    assert both[-1].text == "Hits 3   session: Hits 4"
    (one,) = both[0].scene.drawn(player=False)
    assert (one.path, one.id, one.mesh) == ("Session/Ball 4", 9, 1)
    assert one.pose[0] == player.pose[0] - 1.2
    assert both[0].headset.shape == (4, 12, 3)
