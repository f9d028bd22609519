"""BSOR: boxes and poses of a person's replays, written as the format says."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from parts import RECORDINGS
from python.sessions.bsor_made import bsor_bytes
from sim2vr_harness.sessions import read_session

REPLAYS = RECORDINGS / "beats_replays"
NAMES = {"easy_21": 21, "normal_241": 241, "normal_406": 406}


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
