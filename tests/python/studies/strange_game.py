"""Tables of a game that nobody knows here, played by a body that nobody knows: made by hand.

Two conditions of two rounds each, 4 s long. Items come up at the corners of a square that leans
back by 45 degrees; the tool stays 0.1 m in front of it.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.evaluation.data.columns import Column, columns_of, merged, number_table
from sim2vr_harness.evaluation.data.episodes import EPISODE_COLUMNS
from sim2vr_harness.evaluation.data.folder import FOLDER, DataFolder
from sim2vr_harness.evaluation.data.items import EVENT_COLUMNS
from sim2vr_harness.evaluation.data.steps import pose_columns

CONDITIONS = ("calm", "wild <!--<script>")
SCORES = {"calm": (10.0, 14.0), "wild <!--<script>": (20.0, 26.0)}
MUSCLES = ("ALPHA", "BETA", "GAMMA")
HALF = float(np.sqrt(0.5))
NORMAL = np.array([0.0, -HALF, HALF])
"""Of the items' plane, away from the player; x right, y up, z forward."""
MIDDLE = np.array([0.1, 1.0, 0.5])
SIDES = (np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.1 * HALF, 0.1 * HALF]))
DT_S, STEPS = 0.05, 80


def write_tables(root: Path) -> Path:
    """Write an evaluation's tables; returns its folder."""
    folder = DataFolder(root / FOLDER)
    episodes: list[dict[str, Any]] = []
    events: list[dict[str, Any]] = []
    for condition in CONDITIONS:
        for number, score in enumerate(SCORES[condition]):
            key = f"{condition[:4]}_seed{number + 1}"
            episodes.append(_episode(key, condition, number, score))
            events += [_item(key, i) for i in range(8)]
            folder.write_moments("steps", key, _steps(key))
            folder.write_moments("frames", key, _frames(key))
    extra = columns_of({"sparks": 1.0, "effort": 1.0}, {"sparks": ("V", "Sparks: of the wheel")})
    player = [Column("max_fatigued", "number", "0-1", "Muscle fatigue: at its worst")]
    player += [
        Column(n, "number", "", f"{n}: of a round") for n in ("effort", "game_return", "return")
    ]
    columns = merged([*EPISODE_COLUMNS, *extra[:1], *player])
    folder.add({"episodes": (episodes, columns), "events": (events, EVENT_COLUMNS)})
    return root


def _episode(key: str, condition: str, number: int, score: float) -> dict[str, Any]:
    return {
        "episode": key, "user": "somebody", "trained_steps": 1000, "person": None,
        "game": "strange", "condition": condition, "number": number, "seed": number + 1,
        "deterministic": False, "changes": json.dumps([]), "ended": "finished", "steps": STEPS,
        "duration_s": STEPS * DT_S, "effort_weight": 0.1, "sparks": score,
        "max_fatigued": score / 100, "effort": 2.0, "game_return": 2 * score,
        "return": 2 * score - 2.0,
    }  # fmt: skip


def _item(key: str, index: int) -> dict[str, Any]:
    side = (index % 2 * 2 - 1) * SIDES[0] + (index // 2 % 2 * 2 - 1) * SIDES[1]
    place = MIDDLE + side
    begin = 0.4 * index
    return {
        "episode": key, "item": "spark", "item_id": index, "cell": index % 4, "begin_s": begin,
        "end_s": begin + 0.3, "latency_s": 0.3, "outcome": "caught" if index % 4 else "gone",
        "success": index % 4 > 0, "x_m": place[0], "y_m": place[1], "z_m": place[2],
        "speed_mps": 1.0 + 0.1 * index,
    }  # fmt: skip


def _poses(places: dict[str, np.ndarray], n: int) -> tuple[list[Column], np.ndarray]:
    columns = [column for name in places for column in pose_columns(name, name)]
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    row = np.concatenate([np.concatenate([place, turn]) for place in places.values()])
    return columns, np.tile(row, (n, 1)).astype(np.float32)


def _steps(key: str) -> Any:
    head, right = np.array([0.0, 1.2, 0.0]), np.array([0.1, 1.0, 0.3])
    columns, values = _poses({"head": head, "right": right}, STEPS)
    values[:, columns.index(next(c for c in columns if c.name == "right_x_m"))] += 0.1 * np.sin(
        np.arange(STEPS)
    )
    tired = np.linspace(0.0, 1.0, STEPS)[:, None] * np.array([0.1, 0.3, 0.2])
    for prefix, numbers in (("act_", tired + 0.1), ("fatigued_", tired), ("most_fatigued_", tired)):
        columns += [Column(f"{prefix}{name}", "single", "", name) for name in MUSCLES]
        values = np.concatenate([values, numbers.astype(np.float32)], axis=1)
    steps = np.arange(1, STEPS + 1)
    counts = [
        (Column("step", "integer", "", "Step"), steps),
        (Column("time_s", "number", "s", "Time"), steps * DT_S),
    ]
    return number_table(key, counts, values, columns)


def _frames(key: str) -> Any:
    head = np.array([0.0, 1.2, 0.0])
    columns, values = _poses({"head": head, "wand": MIDDLE - 0.1 * NORMAL}, STEPS + 2)
    frames = np.arange(STEPS + 2)
    counts = [
        (Column("frame", "integer", "", "Frame"), frames),
        (Column("step", "integer", "", "Step"), np.maximum(0, frames - 1)),
        (Column("time_s", "number", "s", "Time"), np.maximum(0, frames - 1) * DT_S),
    ]
    return number_table(key, counts, values, columns)
