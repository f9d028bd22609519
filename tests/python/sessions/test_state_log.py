"""Reading ``states.csv``; tests/cpp/rl/state_log_test.cpp has the same cases."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions.state_log import StateLog, read_state_log

FIXTURE = Path(__file__).resolve().parents[2] / "data" / "whacamole_round"
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
    "CR": PLAIN.replace("\n", "\r"),
    "tabs": PLAIN.replace(", ", "\t"),
    "no spaces": PLAIN.replace(", ", ","),
    "byte order mark": "\ufeff" + PLAIN,
    "empty rows": PLAIN + ",,,\n\n",
    "cut off": PLAIN + "0.1, 0, 0",
    "cut off in a number": PLAIN + row("1e-"),
    "no last line end": PLAIN[:-1],
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
    ("text", "seed"),
    [
        ("-1", 4294967295),
        ("-2147483648", 2147483648),
        ("4294967296", 0),
        ("123456789012345678901", 792095797),
    ],
)
def test_any_seed(tmp_path: Path, text: str, seed: int) -> None:
    assert read(tmp_path, PLAIN.replace("seed 42", f"seed {text}")).seed == seed


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: got an empty line, expected 'condition C, random seed N'"),
        ("condition hard\n", "line 1: got 'condition hard', expected 'condition C, random seed N'"),
        ("condition hard, random seed 1.5\n", "line 1: got 'condition hard, random seed 1.5'"),
        ("condition hard, random seed -\n", "line 1: got"),
        (TITLE + "timestamp, left_pos_x\n", "expected a column left_pos_x and six more for the p"),
        (TITLE + HEADER, "got no row, expected at least one row"),
        (TITLE + HEADER + "0, 1\n", "line 3: got '0, 1', expected 22 numbers, as the header has c"),
        (TITLE + HEADER + row("NaN"), "line 3: got 'NaN, 0"),
        (TITLE + HEADER + row("1_0"), "line 3: got '1_0, 0"),
        (TITLE + HEADER + row("1e999"), "line 3: got '1e999, 0"),
        (TITLE + HEADER + row("-1"), "line 3: got '-1', expected 0 to 1e9 s"),
        (TITLE + HEADER + row("1") + row("0.5"), "line 4: got '0.5', expected a time from the row"),
        (
            TITLE + HEADER + row("1") + "2, 3\n" + row("4"),
            "line 4: got '2, 3', expected 22 numbers",
        ),
    ],
)
def test_errors_say_what_is_wrong_where(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert message in str(caught.value)


def test_the_app_replays_what_the_harness_reads(tmp_path: Path) -> None:
    plain = (FIXTURE / "states.csv").read_text()
    rows = plain.replace("\n", ",,,,,\r").replace(", ", "\t")
    saved = {"plain": plain, "saved": "\ufeff" + rows.replace("seed\t42", "seed 42")}
    logs = {}
    for name, text in saved.items():
        (tmp_path / name).mkdir()
        read(tmp_path / name, text)
        out = tmp_path / f"{name}_again"
        file = tmp_path / name / "states.csv"
        options = ["--options", '{"round_seconds": 6}', "--renderer", "null", "--log-dir", str(out)]
        app = [str(paths.app_executable()), "--replay", "--state-log", str(file), *options]
        subprocess.run(app, check=True, capture_output=True)
        (states,) = out.rglob("states.csv")
        logs[name] = read_state_log(states)
    original = read_state_log(FIXTURE / "states.csv")
    for log in logs.values():
        assert (log.condition, log.seed) == (original.condition, original.seed)
        assert np.array_equal(log.right, original.right)


def test_a_condition_may_have_several_words(tmp_path: Path) -> None:
    """Beats' generated levels: their seed is part of their names."""
    file = tmp_path / "states.csv"
    file.write_text(PLAIN.replace("condition hard", "condition generated 2032329983"))
    log = read_state_log(file)
    assert (log.condition, log.seed) == ("generated 2032329983", 42)
