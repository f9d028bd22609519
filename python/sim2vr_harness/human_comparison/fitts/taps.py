"""Selections of the game ``pointing``, read from a round's ``events.csv``.

The columns are those of docs/reference/games/pointing.md, "Logs". The place and time of a selection
are read; values that the game computes from them are computed again, so that both can be compared.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions.state_log import read_lines

Outcome = Literal["hit", "error", "miss"]
Point = tuple[float, float]

_OUTCOMES: dict[str, Outcome] = {
    "target_hit": "hit",
    "target_error": "error",
    "target_miss": "miss",
}
_FIELD = re.compile(r"([A-Za-z][A-Za-z ]*?) (-?[0-9.][-+0-9.Ee ]*)")


@dataclass(frozen=True)
class Tap:
    """One target, from when it came up until it was selected, missed or went away.

    Attributes:
        block: number of its block within the round.
        trial: within the block; 0 begins it, and is the end of no movement.
        distance_m: of the block, between targets that follow each other.
        width_m: diameter of the target.
        center_m: of the target, x and y from the circle's centre.
        shown_s: when it came up.
        time_s: when it was selected or went away.
        outcome: ``hit``, ``error`` (a selection beside it), ``miss`` (it went away).
        place_m: of the selection, x and y; None for a miss.
    """

    block: int
    trial: int
    distance_m: float
    width_m: float
    center_m: Point
    shown_s: float
    time_s: float
    outcome: Outcome
    place_m: Point | None


def read_taps(path: Path) -> list[Tap]:
    """Read the targets of a round's ``events.csv``, in their order.

    Raises:
        InputError: names the line that cannot be read, or a log of another game.
    """
    taps: list[Tap] = []
    block: dict[str, str] = {}
    shown: tuple[float, dict[str, str]] | None = None
    for number, line in enumerate(read_lines(path), start=1):
        time, _, text = line.partition(", ")
        kind, _, rest = text.partition(", ")
        if kind not in ("block_start", "target_spawn", *_OUTCOMES):
            continue
        fields = dict(_FIELD.findall(rest))
        try:
            if kind == "block_start":
                block = fields
            elif kind == "target_spawn":
                shown = (_number(time), fields)
            else:
                assert shown is not None
                taps.append(_tap(_OUTCOMES[kind], block, shown, _number(time), fields))
        except (AssertionError, KeyError, ValueError):
            expected = "an event of a round of pointing, as docs/reference/games/pointing.md has it"
            raise InputError(f"{path}, line {number}", repr(line[:60]), expected) from None
    if not taps:
        raise InputError(str(path), "no target", "the log of a round of pointing")
    return taps


def _tap(
    outcome: Outcome,
    block: dict[str, str],
    shown: tuple[float, dict[str, str]],
    time_s: float,
    fields: dict[str, str],
) -> Tap:
    shown_s, spawn = shown
    if fields["target ID"] != spawn["target ID"]:
        raise ValueError
    return Tap(
        block=int(fields["block"]),
        trial=int(fields["trial"]),
        distance_m=_number(block["distance"]),
        width_m=_number(block["width"]),
        center_m=_point(spawn["center"]),
        shown_s=shown_s,
        time_s=time_s,
        outcome=outcome,
        place_m=None if outcome == "miss" else _point(fields["place"]),
    )


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def _point(text: str) -> Point:
    x, y = map(_number, text.split())
    return x, y
