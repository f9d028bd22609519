"""Items of a round, by logs that were written by hand."""

from pathlib import Path

import pytest

from sim2vr_harness.client import GameFacts, ItemOutcome, LoggedItem, describe_game
from sim2vr_harness.evaluation.data.items import (
    item_rows,
    read_log,
)

COIN = LoggedItem(
    name="coin",
    id_field="coin ID",
    begin_event="coin_comes",
    outcomes=(ItemOutcome("coin_taken", "taken", True), ItemOutcome("coin_lost", "lost", False)),
    counted_events=("coin_brushed",),
    cell_field="slot",
    places_event="slots",
    velocity_field="velocity",
)
GAME = GameFacts("coins", items=(COIN,))
LOG = """\
0, slots [0 1 2 3] [7 0.5 1.25 -2]
0.5, coin_comes, coin ID 0, slot 7
0.75, coin_comes, coin ID 1, slot 0
1, coin_brushed, coin ID 0, slot 7, velocity 9 9 9
1.25, coin_brushed, coin ID 0, slot 7
2, coin_taken, coin ID 0, slot 7, velocity 2 -3 6, worth 10, left, tint 1 2
2.5, coin_los"""


def rows_of(text: str, facts: GameFacts, folder: Path) -> list[dict[str, object]]:
    (folder / "events.csv").write_text(text)
    return item_rows("a_seed1", read_log(folder / "events.csv"), facts)


def test_items_by_hand(tmp_path: Path) -> None:
    first, second = rows_of(LOG, GAME, tmp_path)
    assert first == {
        "episode": "a_seed1", "item": "coin", "item_id": 0, "cell": 7, "begin_s": 0.5,
        "end_s": 2.0, "latency_s": 1.5, "outcome": "taken", "success": True,
        "x_m": 0.5, "y_m": 1.25, "z_m": -2.0,
        # |(2, -3, 6)| = 7; the brush's velocity decided nothing.
        "speed_mps": 7.0, "velocity_x_mps": 2.0, "velocity_y_mps": -3.0, "velocity_z_mps": 6.0,
        "coin_brushed_count": 2, "log_worth": 10.0, "log_left": True, "log_tint_x": 1.0,
        "log_tint_y": 2.0,
    }  # fmt: skip
    # Its end was cut off with the log: it has none.
    assert second["begin_s"] == 0.75 and second["x_m"] == 1.0
    assert "end_s" not in second and "outcome" not in second


@pytest.mark.parametrize(
    ("game", "line", "expected"),
    [
        (
            "whacamole",
            "1.1, target_hit, target ID 3, grid ID 1, velocity 0 3 4",
            {"item": "target", "item_id": 3, "cell": 1, "outcome": "hit", "speed_mps": 5.0},
        ),
        (
            "beats",
            "1.2, box_spawn, number 2, due 2.2, column 3, row 0, kind: left link, direction -135",
            {
                "item": "box",
                "begin_s": 1.2,
                "log_due": 2.2,
                "log_column": 3.0,
                "log_row": 0.0,
                "log_kind": "left link",
                "log_direction": -135.0,
            },
        ),
        (
            "beats",
            "2.25, box_wrong_hand, number 2, level time 2.2, place -1 2 3, left, velocity 0 3 4, "
            "timing -0.02, angle 12.5",
            {"outcome": "wrong hand", "log_timing": -0.02, "log_angle": 12.5, "log_left": True},
        ),
        (
            "beats",
            "4, wall_avoided, number 1, level time 3.9, place 0 1 2",
            {"item": "wall", "item_id": 1, "outcome": "avoided", "success": True},
        ),
        (
            "pointing",
            "4, target_error, target ID 5, grid ID 2, block 1, trial 3, place 0.1 0.2",
            {"item": "target", "outcome": "error", "cell": 2, "log_block": 1.0, "log_place_y": 0.2},
        ),
    ],
)
def test_items_that_games_publish(
    game: str, line: str, expected: dict[str, object], tmp_path: Path
) -> None:
    (row,) = rows_of(line, describe_game(game), tmp_path)
    assert expected.items() <= row.items()
