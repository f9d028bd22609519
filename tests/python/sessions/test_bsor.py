"""BSOR: boxes and poses of made-up replays, and of a person's, written as the format says."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from python.sessions.bsor_made import bsor_bytes
from python.sessions.sessions_made import REPLAYS
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions import read_session

NAMES = {"easy_21": 21, "normal_241": 241, "normal_406": 406}
needs_replays = pytest.mark.skipif(
    not (REPLAYS / "README.md").is_file(),
    reason="no replays: SIM2VR_SHARED can name a folder with data/beats_replays",
)
BOX = {
    "event_s": 1.5,
    "column": 3,
    "row": 2,
    "colour": 1,
    "direction": 8,
    "outcome": "good",
    "speed_mps": 30.0,
    "time_deviation_s": 0.02,
    "direction_deviation_deg": -4.0,
    "distance_to_centre_m": 0.1,
    "before": 1.2,
    "after": 0.5,
    "cut": (0.1, 1.0, 0.8),
}


def boxes_of(name: str) -> list[dict[str, Any]]:
    with (REPLAYS / f"{name}_boxes.csv").open() as stream:
        return [
            {
                **{key: float(value) for key, value in row.items() if key != "outcome"},
                **{key: int(row[key]) for key in ("column", "row", "colour", "direction")},
                "outcome": row["outcome"],
                "cut": [float(row[f"cut_{axis}"]) for axis in "xyz"],
            }
            for row in csv.DictReader(stream)
        ]


@needs_replays
@pytest.mark.parametrize("name", NAMES)
def test_all_boxes_and_poses_of_a_person_s_replay(name: str, tmp_path: Path) -> None:
    arrays, boxes = np.load(REPLAYS / f"{name}_poses.npz"), boxes_of(name)
    assert len(boxes) == NAMES[name]
    file = tmp_path / "replay.bsor"
    file.write_bytes(bsor_bytes(arrays["time_s"], boxes, arrays["pose"], name="Zoë 玩家"))
    session = read_session(file)
    found = [event for event in session.events if event.kind == "box"]
    assert len(found) == len(boxes)
    pose = arrays["pose"][len(arrays["pose"]) - len(session) :]
    assert len(pose) >= len(arrays["pose"]) - 1  # frame 0 is from before tracking
    np.testing.assert_allclose(session.head, pose[:, 0], atol=2e-5)
    assert session.right is not None
    np.testing.assert_allclose(session.right.ray(), pose[:, 2], atol=2e-5)
    assert session.frame_rate_hz == pytest.approx(90, rel=0.02)
    for event, box in zip(found, sorted(boxes, key=lambda box: box["event_s"]), strict=True):
        data = event.data
        for key in ("column", "row", "colour", "direction", "outcome", "points"):
            assert data[key] == box[key], key  # points: the game's own
        assert data["time_deviation_s"] == pytest.approx(box["time_deviation_s"], abs=1e-5)
        assert data["cut_point_m"] == pytest.approx(box["cut"], abs=1e-5)
    assert "Zoë" not in repr(session) and "76561" not in repr(session)


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


def test_a_faster_song_takes_less_time(tmp_path: Path) -> None:
    file = tmp_path / "a.bsor"
    file.write_bytes(bsor_bytes([0.0, 1.2, 2.4], [BOX], modifiers="NF,FS"))
    session = read_session(file)
    assert session.time_ns.tolist() == pytest.approx([0, 1e9, 2e9], abs=100)
    assert session.events[0].time_ns == pytest.approx(1.25e9, abs=100)


@pytest.mark.parametrize("modifiers", ["", "NF,FS"])
def test_a_slower_song_in_practice_takes_longer(tmp_path: Path, modifiers: str) -> None:
    """At .5 of its speed, 1.2 s of the song are 2.4 s; practice takes no speed of modifiers."""
    file = tmp_path / "a.bsor"
    content = bsor_bytes([0.0, 1.2, 2.4], [BOX], modifiers=modifiers, practice_speed=0.5)
    file.write_bytes(content)
    session = read_session(file)
    assert session.time_ns.tolist() == pytest.approx([0, 2.4e9, 4.8e9], abs=300)
    assert session.events[0].time_ns == pytest.approx(3e9, abs=100)


@pytest.mark.parametrize("speed", [-1.0, 1e-30, 1e30])
def test_a_practice_speed_that_no_song_has_is_named(tmp_path: Path, speed: float) -> None:
    file = tmp_path / "a.bsor"
    file.write_bytes(bsor_bytes([0.0, 1.2], [BOX], practice_speed=speed))
    with pytest.raises(InputError, match=r"practice speed.*expected 0, or 0.01 to 100"):
        read_session(file)


@needs_replays
def test_another_reader_sees_the_same(tmp_path: Path) -> None:
    bsor = pytest.importorskip("bsor.Bsor", reason="needs py-bsor: pip install py-bsor")
    arrays, boxes = np.load(REPLAYS / "easy_21_poses.npz"), boxes_of("easy_21")
    file = tmp_path / "replay.bsor"
    file.write_bytes(bsor_bytes(arrays["time_s"], boxes, arrays["pose"]))
    with file.open("rb") as stream:
        theirs = bsor.make_bsor(stream)
    ours = read_session(file)
    assert len(theirs.frames) - len(ours) in (0, 1) and len(theirs.notes) == 21
    for event, note in zip(ours.events, theirs.notes, strict=True):
        data = event.data
        assert (data["column"], data["row"], data["points"]) == (
            note.lineIndex, note.noteLineLayer, note.score,
        )  # fmt: skip
