"""Reading ``states.csv``; tests/cpp/rl/state_log_test.cpp has the same cases."""

from pathlib import Path

import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions.state_log import StateLog, read_state_log

AXES = ("pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w")
TITLE = "condition hard, random seed 42\n"
HEADER = ", ".join(
    ["timestamp", *(f"{d}_{axis}" for d in ("left", "right", "head") for axis in AXES)]
)
HEADER += "\n"


def row(time: str) -> str:
    return time + ", 0, 0, 0, 0, 0, 0, 1, 1, 2, 3, 4, 5, 6, 7, -1E-05, .5, 9, 0, 0, 0, 1\n"


PLAIN = TITLE + HEADER + row("0") + row("0.05")
SAVED_BY_OTHERS = {
    "trailing commas": PLAIN.replace("\n", ",,,\n"),
    "CR LF": PLAIN.replace("\n", "\r\n"),
    "byte order mark": "\ufeff" + PLAIN,
    "cut off": PLAIN + "0.1, 0, 0",
}


def read(folder: Path, text: str) -> StateLog:
    (folder / "states.csv").write_text(text, newline="")
    return read_state_log(folder / "states.csv")


@pytest.mark.parametrize("how", SAVED_BY_OTHERS)
def test_as_a_spreadsheet_saves_it(tmp_path: Path, how: str) -> None:
    log = read(tmp_path, SAVED_BY_OTHERS[how])
    assert (log.condition, log.seed) == ("hard", 42)
    assert log.times_s.tolist() == [0.0, 0.05]
    assert log.right[1].tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert log.head[1].tolist() == [-1e-5, 0.5, 9, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("text", "seed"), [("-1", 4294967295), ("123456789012345678901", 792095797)]
)
def test_any_seed(tmp_path: Path, text: str, seed: int) -> None:
    """Beats' generated levels have a seed in their names."""
    log = read(tmp_path, PLAIN.replace("hard, random seed 42", f"generated 2, random seed {text}"))
    assert (log.condition, log.seed) == ("generated 2", seed)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: got an empty line, expected 'condition C, random seed N'"),
        (TITLE + "timestamp, left_pos_x\n", "expected a column left_pos_x and six more for the p"),
        (TITLE + HEADER, "got no row, expected at least one row"),
        (TITLE + HEADER + "0, 1\n", "line 3: got '0, 1', expected 22 numbers, as the header has c"),
        (TITLE + HEADER + row("NaN"), "line 3: got 'NaN, 0"),
        (TITLE + HEADER + row("1e999"), "line 3: got '1e999, 0"),
        (TITLE + HEADER + row("-1"), "line 3: got '-1', expected 0 to 1e9 s"),
        (TITLE + HEADER + row("1") + row("0.5"), "line 4: got '0.5', expected a time from the row"),
    ],
)
def test_errors_say_what_is_wrong_where(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert message in str(caught.value)
