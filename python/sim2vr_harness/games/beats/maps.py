"""Write lists of boxes as maps, which the option ``level`` of Beats reads."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim2vr_harness.client.devices import HANDS, Hand

_FILE = "Boxes.dat"


@dataclass(frozen=True)
class MapBox:
    """A box to cut.

    Attributes:
        time_s: when it should be cut, from the first frame of a round on.
        column: 0 (left) to 3.
        row: 0 (bottom) to 2.
        hand: whose saber cuts it.
        direction: of the cut, in Beat Saber's order: 0 up, 1 down, 2 left, 3 right, 4 up left,
            5 up right, 6 down left, 7 down right, 8 any.
    """

    time_s: float
    column: int
    row: int
    hand: Hand
    direction: int


def write_map(folder: Path, boxes: Iterable[MapBox]) -> Path:
    """Write boxes as a map of version 2 with one beat a second.

    Args:
        folder: to write to; its parent exists.
        boxes: in any order. The round's log numbers them by time; equal times keep their order.

    Returns:
        The folder: the value of the option ``level``.
    """
    notes = [
        {
            "_time": box.time_s,
            "_lineIndex": box.column,
            "_lineLayer": box.row,
            "_type": HANDS.index(box.hand),
            "_cutDirection": box.direction,
        }
        for box in boxes
    ]
    info: dict[str, Any] = {
        "_version": "2.0.0",
        "_songName": folder.name,
        "_beatsPerMinute": 60,
        "_difficultyBeatmapSets": [
            {
                "_beatmapCharacteristicName": "Standard",
                "_difficultyBeatmaps": [{"_difficulty": "Normal", "_beatmapFilename": _FILE}],
            }
        ],
    }
    folder.mkdir(exist_ok=True)
    (folder / "Info.dat").write_text(json.dumps(info), encoding="utf-8")
    notes_only = {"_version": "2.0.0", "_notes": notes, "_obstacles": [], "_events": []}
    (folder / _FILE).write_text(json.dumps(notes_only), encoding="utf-8")
    return folder
