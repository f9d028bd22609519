"""Recorded rounds of Beat Saber, played in Beats with the rules of the original."""

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from parts import RECORDINGS
from sim2vr_harness.client import DevicePoses, InProcessApp, OptionValue
from sim2vr_harness.client.devices import HANDS
from sim2vr_harness.games.beats.maps import MapBox, write_map

REPLAYS = RECORDINGS / "beats_replays"
BOXES = {"easy_21": 21, "normal_241": 241, "normal_406": 406}


@dataclass(frozen=True)
class Recording:
    """A round of a person.

    Attributes:
        time_s: (T,) of the frames.
        pose: (T, 3, 7) head, left and right saber; m and quaternion x, y, z, w.
        boxes: the map, in order of time, and what the original made of it.
        options: approach speed, jump distance and the player's height.
    """

    time_s: NDArray[np.float64]
    pose: NDArray[np.float64]
    boxes: list[dict[str, float]]
    options: dict[str, OptionValue]


def read(name: str) -> Recording:
    """Read a round without frames that repeat or have no poses."""
    with np.load(REPLAYS / f"{name}_poses.npz") as arrays:
        time_s, pose = arrays["time_s"].astype(float), arrays["pose"].astype(float)
    whole = np.linalg.norm(pose[..., 3:], axis=-1).min(1) > 0.5
    keep = np.append(np.diff(time_s) > 0.0, True) & whole
    with (REPLAYS / f"{name}_boxes.csv").open(encoding="utf-8") as file:
        rows = [
            {key: float(value) for key, value in row.items() if key != "outcome"}
            for row in csv.DictReader(file)
        ]
    facts = json.loads((REPLAYS / f"{name}.json").read_text(encoding="utf-8"))
    return Recording(
        time_s[keep],
        pose[keep],
        sorted(rows, key=lambda row: row["time_s"]),
        {key: facts[key] for key in ("approach_mps", "jump_distance_m", "player_height_m")},
    )


@dataclass(frozen=True)
class Cuts:
    """What Beats made of the boxes, in order of time; NaN where none was cut.

    Attributes:
        early_s: before the box's time.
        angle_deg: to the demanded direction.
        points: of 115.
        before: share of the full swing before the cut.
        log: of the round at its end.
    """

    early_s: NDArray[np.float64]
    angle_deg: NDArray[np.float64]
    points: NDArray[np.float64]
    before: NDArray[np.float64]
    log: dict[str, float]


def play(recording: Recording, folder: Path) -> Cuts:
    """Play a person's poses, frame by frame, at the recorded times."""
    start_s = recording.time_s[0]
    boxes = [
        MapBox(
            box["time_s"] - start_s,
            int(box["column"]),
            int(box["row"]),
            HANDS[int(box["colour"])],
            int(box["direction"]),
        )
        for box in recording.boxes
    ]
    options: dict[str, OptionValue] = {
        "level": str(write_map(folder / "map", boxes)),
        "rules": "beat_saber",
        "end_on_miss": False,
        **recording.options,
    }
    with InProcessApp("beats", options, renderer="null", log_dir=folder / "logs") as app:
        head, left, right = recording.pose.swapaxes(0, 1)
        app.reset(1, DevicePoses(head[0], right[0], left[0]))
        for i, time_s in enumerate(recording.time_s[1:] - start_s, 1):
            reply = app.step(round(time_s * 1e9), DevicePoses(head[i], right[i], left[i]))
            if reply.finished:
                break
    (events,) = (folder / "logs").glob("*/events.csv")
    return cuts_of(events.read_text(encoding="utf-8"), len(boxes), dict(reply.log))


def cuts_of(events: str, count: int, log: dict[str, float]) -> Cuts:
    """Read the cuts of boxes from a round's log."""
    found = np.full((4, count), np.nan)
    for line in events.splitlines():
        fields = dict(re.findall(r", (number|timing|angle|points|before) (-?[\d.e+-]+)", line))
        box = int(fields["number"]) if "number" in fields else -1
        if ", box_slice, " in line:
            found[:2, box] = -float(fields["timing"]), float(fields["angle"])
        if ", box_points, " in line:
            found[2:, box] = float(fields["points"]), float(fields["before"])
    return Cuts(*found, log)


@pytest.fixture(scope="module", params=list(BOXES))
def played(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Recording, Cuts]:
    recording = read(request.param)
    assert len(recording.boxes) == BOXES[request.param]
    return recording, play(recording, tmp_path_factory.mktemp(request.param))


def column(recording: Recording, name: str) -> NDArray[np.float64]:
    return np.array([box[name] for box in recording.boxes])


def test_every_box_that_the_person_cut_is_cut(played: tuple[Recording, Cuts]) -> None:
    recording, cuts = played
    assert cuts.log["AccumulatedCorrectSlices"] == len(recording.boxes)
    assert cuts.log["AccumulatedErrors"] == cuts.log["Misses"] == 0.0


def test_cuts_are_worth_the_same(played: tuple[Recording, Cuts]) -> None:
    recording, cuts = played
    off = np.abs(cuts.points - column(recording, "points"))
    assert np.mean(off <= 5.0) >= 0.97
    assert np.mean(off <= 1.0) >= 0.85
    assert cuts.log["Score"] == cuts.points.sum()
    # Not the points alone: how far the blade was swung before, of which some had less than all.
    swing = np.abs(cuts.before - column(recording, "before"))
    assert np.median(swing) < 0.02


def test_cuts_are_at_the_same_time_and_angle(played: tuple[Recording, Cuts]) -> None:
    """The original counts at the end of a frame (11 ms) and by the blade's tip."""
    recording, cuts = played
    earlier = cuts.early_s - column(recording, "time_deviation_s")
    assert np.mean(np.abs(earlier) < 0.012) >= 0.9
    assert 0.0 < np.median(earlier) < 0.0111
    one_way = column(recording, "direction") < 8
    angle = np.abs(column(recording, "direction_deviation_deg"))
    assert np.median(np.abs(cuts.angle_deg - angle)[one_way]) < 3.0
