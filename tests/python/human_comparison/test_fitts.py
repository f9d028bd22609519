"""Fitts' law from logs that were made by hand."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import app
from sim2vr_harness.human_comparison.fitts import (
    AimedPerson,
    aimed_person,
    aimed_round,
    blocks_of,
    movements_of,
    submovements,
    taps_of,
)
from sim2vr_harness.sessions import read_session, read_sessions
from sim2vr_harness.statistics.fitts import fit_line

# Two targets 10 cm apart, one on either side of the middle, in turn: to the right, offsets are
# along x, to the left against it.
LEFT, RIGHT = (-0.05, 0.0), (0.05, 0.0)


def log_of(
    places: list[tuple[str, float, float, float]], width: float = 0.02, block: int = 0
) -> list[str]:
    """Events of a block: (outcome, time, x, y) of each trial, left and right in turn."""
    before = places[0][1] - 0.5
    block_starts = f"block_start, block {block}, distance 0.1, width {width}, index 9, targets 3"
    lines = [f"{before}, {block_starts}"]
    for trial, (outcome, time, x, y) in enumerate(places):
        center = LEFT if trial % 2 == 0 else RIGHT
        names = f"target ID {trial}, grid ID 0, block {block}, trial {trial}"
        lines.append(f"{before}, target_spawn, {names}, center {center[0]} {center[1]}")
        place = "" if outcome == "target_miss" else f", place {x} {y}"
        lines.append(f"{time}, {outcome}, {names}{place}")
        before = time
    return lines


def written(folder: Path, *blocks: list[str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    states(folder, tip=False)
    text = ["0, target plane transform 0.15 1.1 0.4 0 0 0 1"]
    text += [line for block in blocks for line in block]
    (folder / "events.csv").write_text("\n".join([*text, "19, episode statistics, hits 4", ""]))
    return folder


HAND_MADE = [
    ("target_hit", 1.0, -0.05, 0.001),
    ("target_hit", 1.5, 0.046, 0.0),
    ("target_hit", 2.1, -0.05, 0.0),
    ("target_error", 2.8, 0.054, 0.012),
]


def test_movements_by_hand(tmp_path: Path) -> None:
    taps = taps_of(read_session(written(tmp_path, log_of(HAND_MADE))))
    assert [tap.outcome for tap in taps] == ["hit", "hit", "hit", "error"]
    assert taps[3].shown_s == 2.1
    assert (taps[0].distance_m, taps[0].width_m) == (0.1, 0.02)
    moves = movements_of(taps)
    assert [move.time_s for move in moves] == pytest.approx([0.5, 0.6, 0.7])
    # To the right 4 mm short; to the left in the middle; to the right 4 mm too far.
    assert [move.offset_m for move in moves] == pytest.approx([-0.004, 0.0, 0.004])
    assert [move.length_m for move in moves] == pytest.approx([0.096, 0.096, 0.104])
    assert [move.across_m for move in moves] == pytest.approx([0.0, 0.0, 0.012])
    assert [move.hit for move in moves] == [True, True, False]


def test_a_block_by_hand(tmp_path: Path) -> None:
    """Spread 4 mm, 16.532 mm wide; mean length 98.667 mm: log2(6.968) = 2.8008 bits in 0.6 s."""
    taps = taps_of(read_session(written(tmp_path, log_of(HAND_MADE))))
    (block,) = blocks_of(movements_of(taps))
    assert block.spread_m == pytest.approx(0.004)
    assert block.effective_width_m == pytest.approx(0.016532)
    assert block.effective_distance_m == pytest.approx(0.0986667, abs=1e-6)
    assert block.effective_bits == pytest.approx(2.8008, abs=1e-4)
    assert block.throughput_bps == pytest.approx(2.8008 / 0.6, abs=1e-3)
    assert block.error_rate == pytest.approx(1 / 3)
    assert block.bits == pytest.approx(math.log2(6.0))


def test_no_movement_begins_or_ends_with_a_time_out(tmp_path: Path) -> None:
    places = [
        ("target_hit", 1.0, -0.05, 0.0),
        ("target_miss", 4.0, 0.0, 0.0),
        ("target_hit", 4.5, -0.05, 0.0),
        ("target_hit", 5.0, 0.05, 0.0),
    ]
    other = log_of([("target_hit", 5.5, -0.05, 0.0)], width=0.04, block=1)
    taps = taps_of(read_session(written(tmp_path, log_of(places), other)))
    assert [tap.place_m for tap in taps][1] is None
    (move,) = movements_of(taps)  # nor does one lead from a block to the next
    assert (move.block, move.began_s, move.time_s) == (0, 4.5, 0.5)
    assert blocks_of([move]) == []
    assert blocks_of([move, move]) == []  # no spread


def test_a_line_by_hand() -> None:
    straight = fit_line([1.0, 2.0, 3.0], [0.3, 0.5, 0.7])
    assert straight is not None
    assert (straight.a_s, straight.b_s_per_bit, straight.r2) == pytest.approx((0.1, 0.2, 1.0))
    # Residuals of -1/6, 1/3 and -1/6: 1/6 of the squares' sum of 2/3 is left.
    bent = fit_line([0.0, 1.0, 2.0], [1.0, 2.0, 2.0])
    assert bent is not None
    assert (bent.a_s, bent.b_s_per_bit, bent.r2) == pytest.approx((7 / 6, 0.5, 0.75))
    assert fit_line([1.0, 1.0, 2.0], [1.0, 2.0, 3.0]) is None


def hump(times: np.ndarray, begin: float, end: float, way: float) -> np.ndarray:
    """A movement of minimum jerk (Flash and Hogan 1985)."""
    t = np.clip((times - begin) / (end - begin), 0.0, 1.0)
    return way * (10 * t**3 - 15 * t**4 + 6 * t**5)


@pytest.mark.parametrize("rate_hz", [20, 72])
def test_submovements_are_humps_of_speed(rate_hz: int) -> None:
    times = np.arange(0.0, 2.0, 1.0 / rate_hz)
    still = np.zeros_like(times)
    one = np.stack([hump(times, 0.5, 1.0, 0.2), still], 1)
    assert submovements(times, one, 0.45, 1.05) == 1
    # A correction across, after the first has come to rest.
    two = one + np.stack([still, hump(times, 1.05, 1.35, 0.03)], 1)
    assert submovements(times, two, 0.45, 1.4) == 2
    assert submovements(times, np.zeros_like(one), 0.45, 1.4) == 1
    # One of 3 mm in 0.3 s is no faster than 1.9 cm/s: too slow to be told from noise.
    small = one + np.stack([still, hump(times, 1.05, 1.35, 0.003)], 1)
    assert submovements(times, small, 0.45, 1.4) == 1


def states(folder: Path, rate_hz: int = 20, *, tip: bool = True) -> None:
    """The tip goes from target to target in single movements, as in HAND_MADE."""
    times = np.arange(0.0, 3.0, 1.0 / rate_hz)
    x = -0.05 + hump(times, 1.05, 1.45, 0.096) + hump(times, 1.55, 2.05, -0.096)
    x += hump(times, 2.15, 2.75, 0.104)
    names = ("left", "right", "head", *(("tip",) if tip else ()))
    axes = ("pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w")
    head = ", ".join(f"{name}_{axis}" for name in names for axis in axes)
    still = "0, 0, 0, 0, 0, 0, 1"
    rows = [
        f"{t}, {still}, {still}, {still}" + (f", {v}, 0, 0, 0, 0, 0, 1" if tip else "")
        for t, v in zip(times, x, strict=True)
    ]
    lines = ["condition pointing, random seed 1", f"timestamp, {head}", *rows]
    (folder / "states.csv").write_text("\n".join(lines) + "\n")


def user(folder: Path, pause_s: float = 0.2) -> None:
    """Two rounds with blocks of three widths, each 0.1 s slower per bit."""
    for number in range(2):
        blocks, time = [], 0.0
        for k, width in enumerate((0.04, 0.02, 0.01)):
            bits = math.log2(0.1 / width + 1.0)
            time, places = time + 1.0, []
            for trial, slip in enumerate((0.0, -0.002, 0.002, 0.0)):
                side = -1.0 if trial % 2 == 0 else 1.0
                places.append(("target_hit", time, side * (0.05 + slip), 0.0))
                time += pause_s + 0.1 * bits
            blocks.append(log_of(places, width=width, block=k))
        written(folder / f"round{number}", *blocks)


def numbers_of(folder: Path) -> AimedPerson:
    return aimed_person([aimed_round(each) for each in read_sessions(folder)], folder.name)


def test_a_user_s_numbers(tmp_path: Path) -> None:
    user(tmp_path / "anna")
    result = numbers_of(tmp_path / "anna")
    assert (result.targets, result.timeouts) == (24, 0)
    folder = written(tmp_path / "round", log_of(HAND_MADE))
    states(folder)
    assert [one.submovements for one in numbers_of(folder).difficulties] == [1.0]
    # Offsets of -2, 2 and 0 mm whatever the width: the effective index is the same.
    bits = math.log2(0.1 / (4.133 * 0.002) + 1.0)
    for one in result.difficulties:
        assert one.throughput_bps == pytest.approx(bits / one.movement_time_s)
    mean = np.mean([one.throughput_bps for one in result.difficulties])
    assert result.throughput_bps == pytest.approx(float(mean))


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    folder = written(tmp_path / "a", log_of([("target_hit", 1.0, -0.05, 0.0)]))
    events = folder / "events.csv"
    text = events.read_text()
    events.write_text(text.replace("place -0.05 0.0", "place -0.05"))
    with pytest.raises(InputError, match=r"a, target_hit at 1 s: got .* expected an event"):
        taps_of(read_session(folder))
    states(folder)
    states_csv = folder / "states.csv"
    states_csv.write_text(states_csv.read_text().replace("tip_", "top_"))
    events.write_text(text)
    with pytest.raises(InputError, match="no column tip_pos_x"):
        aimed_round(read_session(folder))


def test_the_command_puts_users_beside_people(tmp_path: Path) -> None:
    """Two people of 0.1 s per bit; the user, two persons of an evaluation, needs 0.1 s more."""
    user(tmp_path / "people" / "anna")
    user(tmp_path / "people" / "bert", pause_s=0.3)
    for person, pause in ((0, 0.3), (1, 0.5)):
        user(tmp_path / "user" / "logs" / f"seed{person}", pause_s=pause)
    rows = []
    for place in sorted((tmp_path / "user" / "logs").glob("*/*")):
        states(place)
        rows.append(
            {
                "log_folder": str(place.relative_to(tmp_path / "user")),
                "person": int(place.parent.name[-1]),
            }
        )
    results = {"mid": {"game": "pointing", "rounds": rows}}
    (tmp_path / "user" / "results.json").write_text(json.dumps(results))
    out = tmp_path / "out"
    where = ["--recordings", str(tmp_path / "people"), "--out", str(out), "--every"]
    result = CliRunner(env={"COLUMNS": "140"}).invoke(
        app, ["compare", str(tmp_path / "user"), *where]
    )
    assert result.exit_code == 0, result.output
    assert (out / "movement_time.png").stat().st_size > 10_000
    found = json.loads((out / "comparison.json").read_text())
    line = found["fitts"]["law"]["user"]["line"]
    assert line["a_s"] == pytest.approx(0.4)
    assert line["b_s_per_bit"] == pytest.approx(0.1)
    assert line["r2"] == pytest.approx(1.0)
    rows = {row["measure"]: row for row in found["users"]["user"]["measures"]}
    assert rows["fitts_a"]["value"] == pytest.approx(0.4)
    assert rows["fitts_a"]["spread"] == pytest.approx(0.2 / math.sqrt(2.0))
    counts = {name: (row["persons"], row["people"]) for name, row in rows.items()}
    assert counts.pop("submovements") == (2, 0)  # the people's logs have no tip
    assert {*counts.values()} == {(2, 2)}
    (persons,) = found["users"]["user"]["persons"].values()
    assert [person["rounds"] for person in persons] == [2, 2]
    own = rows["throughput"]
    bits = math.log2(0.1 / (4.133 * 0.002) + 1.0)
    times = [0.3 + 0.1 * math.log2(0.1 / width + 1.0) for width in (0.04, 0.02, 0.01)]
    assert own["people_low"] == pytest.approx(np.mean([bits / time for time in times]), rel=1e-3)
    assert own["inside"] == 0.0 and not own["people_low"] <= own["value"] <= own["people_high"]


def test_without_recordings_published_figures_are_beside(tmp_path: Path) -> None:
    user(tmp_path / "anna")
    given = f"Anna={tmp_path / 'anna'}"
    command = ["compare", given, "--game", "pointing", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, [*command, "--no-figures"])
    assert result.exit_code == 0, result.output
    text = " ".join(result.output.split())
    assert "MT = 0.200 s + 0.100 s/bit * ID, R2 = 1.000, 3 indices" in text
    assert "Published, Triantafyllidis et al. 2022" in text
    assert "0.453 s + 0.557 s/bit * ID" in text
