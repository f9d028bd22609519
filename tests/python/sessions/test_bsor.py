"""BSOR: boxes and poses of made-up replays, written as the format says."""

from pathlib import Path

import pytest

from python.sessions.bsor_made import bsor_bytes
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions import read_session

BOX = {
    "event_s": 1.5, "column": 3, "row": 2, "colour": 1, "direction": 8, "outcome": "good",
    "speed_mps": 30.0, "time_deviation_s": 0.02, "direction_deviation_deg": -4.0,
    "distance_to_centre_m": 0.1, "before": 1.2, "after": 0.5, "cut": (0.1, 1.0, 0.8),
}  # fmt: skip


def test_outcomes_and_points_by_hand(tmp_path: Path) -> None:
    # 70 for before > 1, 30 * .5 = 15 after, 15 * (1 - .1 / .3) = 10 for the centre.
    boxes = [BOX, {**BOX, "outcome": "bad"}, {**BOX, "outcome": "miss"}, {**BOX, "outcome": "bomb"}]
    file = tmp_path / "a.bsor"
    file.write_bytes(bsor_bytes([0.0, 1.0, 2.0], boxes))
    session = read_session(file)
    assert [event.data["outcome"] for event in session.events] == ["good", "bad", "miss", "bomb"]
    assert [event.data.get("points") for event in session.events] == [95, 0, None, None]
    assert session.events[0].data["scoring"] == 3
    assert (session.app.name, session.app.condition) == ("beat_saber", "Normal")
    assert session.app.options["jump_distance_m"] == 12.0


@pytest.mark.parametrize(
    ("modifiers", "practice_speed", "slower"),
    [
        ("NF,FS", 0.0, 1 / 1.2),
        # At .5 of its speed, 1.2 s of the song are 2.4 s; practice takes no speed of modifiers.
        ("", 0.5, 2.0),
        ("NF,FS", 0.5, 2.0),
    ],
)
def test_a_song_of_another_speed_takes_another_time(
    modifiers: str, practice_speed: float, slower: float, tmp_path: Path
) -> None:
    file = tmp_path / "a.bsor"
    speeds = {"modifiers": modifiers, "practice_speed": practice_speed}
    file.write_bytes(bsor_bytes([0.0, 1.2, 2.4], [BOX], **speeds))
    session = read_session(file)
    assert session.time_ns.tolist() == pytest.approx([0, 1.2e9 * slower, 2.4e9 * slower], abs=300)
    assert session.events[0].time_ns == pytest.approx(1.5e9 * slower, abs=200)
    file.write_bytes(bsor_bytes([0.0, 1.2], [BOX], practice_speed=-1.0))
    with pytest.raises(InputError, match=r"practice speed.*expected 0, or 0.01 to 100"):
        read_session(file)
