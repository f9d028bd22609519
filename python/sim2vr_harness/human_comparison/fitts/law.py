"""Movement time against the index of difficulty, and all of a user's numbers."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.human_comparison.fitts.movements import Block, Movement, blocks_of, movements_of
from sim2vr_harness.human_comparison.fitts.submovements import submovements
from sim2vr_harness.human_comparison.fitts.taps import Tap, read_taps
from sim2vr_harness.sessions.state_log import read_state_log
from sim2vr_harness.statistics.fitts import FittedLine, fit_line


@dataclass(frozen=True)
class Difficulty:
    """A user's blocks of one distance and width, over all rounds.

    Attributes:
        distance_m: nominal.
        width_m: nominal.
        bits: nominal index of difficulty.
        movements: how many.
        movement_time_s: mean over the movements.
        error_rate: share of the movements that ended beside the target.
        spread_m: standard deviation along the task axis: root of the mean variance of the blocks.
        effective_bits: mean over the blocks.
        throughput_bps: mean over the blocks.
        submovements: mean over the movements; None without the tip's way.
    """

    distance_m: float
    width_m: float
    bits: float
    movements: int
    movement_time_s: float
    error_rate: float
    spread_m: float
    effective_bits: float
    throughput_bps: float
    submovements: float | None


@dataclass(frozen=True)
class FittsResult:
    """One user's, or one person's.

    Attributes:
        name: for tables and pictures.
        rounds: how many.
        targets: that came up.
        timeouts: of them.
        difficulties: in the order of their indices.
        throughput_bps: mean over distances and widths of the means over blocks, as the standard
            has it for one person.
        line: movement times of the difficulties by their nominal indices.
        effective_line: the same by their effective indices.
        error_rate: of all movements.
    """

    name: str
    rounds: int
    targets: int
    timeouts: int
    difficulties: tuple[Difficulty, ...]
    throughput_bps: float
    line: FittedLine | None
    effective_line: FittedLine | None
    error_rate: float

    def as_dict(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return asdict(self)


def rounds_below(folder: Path) -> list[Path]:
    """The folders of rounds at or below a folder, those with an ``events.csv``.

    Raises:
        InputError: there is none.
    """
    found = sorted(file.parent for file in folder.rglob("events.csv"))
    if not found:
        raise InputError(
            str(folder), "no events.csv", "a folder with logs of pointing, from evaluate --log"
        )
    return found


def measure_user(rounds: Iterable[Path], name: str) -> FittsResult:
    """Measure one user's rounds.

    Args:
        rounds: folders with ``events.csv``, and ``states.csv`` for submovements.
        name: of the user.

    Raises:
        InputError: a log cannot be read, or no block has effective numbers.
    """
    taps: list[list[Tap]] = []
    blocks: dict[tuple[float, float], list[Block]] = defaultdict(list)
    pieces: dict[tuple[float, float], list[int]] = defaultdict(list)
    movements: dict[tuple[float, float], list[Movement]] = defaultdict(list)
    for folder in rounds:
        taps.append(read_taps(folder / "events.csv"))
        moved = movements_of(taps[-1])
        for block in blocks_of(moved):
            blocks[block.distance_m, block.width_m].append(block)
        counts = _submovements(folder, moved)
        for k, movement in enumerate(moved):
            key = movement.distance_m, movement.width_m
            movements[key].append(movement)
            if counts is not None:
                pieces[key].append(counts[k])
    difficulties = [_difficulty(blocks[key], movements[key], pieces[key]) for key in blocks]
    if not difficulties:
        raise InputError(name, "no block with two movements that differ", "rounds that were played")
    difficulties.sort(key=lambda one: one.bits)
    every = [movement for group in movements.values() for movement in group]
    times_s = [one.movement_time_s for one in difficulties]
    return FittsResult(
        name=name,
        rounds=len(taps),
        targets=sum(map(len, taps)),
        timeouts=sum(tap.outcome == "miss" for played in taps for tap in played),
        difficulties=tuple(difficulties),
        throughput_bps=float(np.mean([one.throughput_bps for one in difficulties])),
        line=fit_line([one.bits for one in difficulties], times_s),
        effective_line=fit_line([one.effective_bits for one in difficulties], times_s),
        error_rate=float(np.mean([not movement.hit for movement in every])),
    )


def _submovements(folder: Path, movements: Sequence[Movement]) -> list[int] | None:
    file = folder / "states.csv"
    if not file.is_file():
        return None
    log = read_state_log(file)
    if "tip" not in log.others:
        raise InputError(str(file), "no column tip_pos_x", "the log of a round of pointing")
    tip = log.others["tip"][:, :2]
    return [
        submovements(log.times_s, tip, move.began_s, move.began_s + move.time_s)
        for move in movements
    ]


def _difficulty(
    blocks: Sequence[Block], movements: Sequence[Movement], pieces: Sequence[int]
) -> Difficulty:
    return Difficulty(
        distance_m=blocks[0].distance_m,
        width_m=blocks[0].width_m,
        bits=blocks[0].bits,
        movements=len(movements),
        movement_time_s=float(np.mean([movement.time_s for movement in movements])),
        error_rate=float(np.mean([not movement.hit for movement in movements])),
        spread_m=float(np.sqrt(np.mean([block.spread_m**2 for block in blocks]))),
        effective_bits=float(np.mean([block.effective_bits for block in blocks])),
        throughput_bps=float(np.mean([block.throughput_bps for block in blocks])),
        submovements=float(np.mean(pieces)) if pieces else None,
    )
