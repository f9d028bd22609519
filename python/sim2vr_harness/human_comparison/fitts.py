"""Aimed movements of the game ``pointing``: Fitts' law, throughput, submovements.

After R. W. Soukoreff and I. S. MacKenzie, "Towards a standard for pointing device evaluation",
International Journal of Human-Computer Studies 61 (2004) 751-789: errors count like hits, a
movement's length and the spread of its end are taken along the task axis, from the target before
to the one aimed at. The events are those of docs/reference/games/pointing.md, "Logs".
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions import Session
from sim2vr_harness.statistics.fitts import FittedLine, fit_line

FloatArray = NDArray[np.float64]
Outcome = Literal["hit", "error", "miss"]
Point = tuple[float, float]

_OUTCOMES: dict[str, Outcome] = {
    "target_hit": "hit",
    "target_error": "error",
    "target_miss": "miss",
}
_TIP = "tip"
"""The tracked object that selects."""
_WIDTH_OF_SD = 4.133
"""Standard deviations that hold 96 % of normally spread selections."""
_LEAST_SD_M = 1e-6
_GRID_S = 0.05
PROMINENCE_MPS = 0.05
"""Least prominence of a peak of speed above the speeds on both of its sides."""


# --- selections ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tap:
    """One target, from its appearance until it was selected, missed or disappeared.

    Attributes:
        block: number of its block within the round.
        trial: within the block; 0 begins it, and is the end of no movement.
        distance_m: of the block, between consecutive targets.
        width_m: diameter of the target.
        center_m: of the target, x and y from the circle's centre.
        shown_s: time of its appearance.
        time_s: time of its selection or disappearance.
        outcome: ``hit``, ``error`` (a selection beside it), ``miss`` (it disappeared).
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


def taps_of(session: Session) -> list[Tap]:
    """Return the targets of a round, in their order.

    Raises:
        InputError: names the event that cannot be read, or a round of another game.
    """
    taps: list[Tap] = []
    block: Mapping[str, Any] = {}
    shown: tuple[float, Mapping[str, Any]] | None = None
    for event in session.events:
        data, time_s = event.data, event.time_ns / 1e9
        try:
            if event.kind == "block_start":
                block = data
            elif event.kind == "target_spawn":
                shown = (time_s, data)
            elif event.kind in _OUTCOMES:
                assert shown is not None
                taps.append(_tap(_OUTCOMES[event.kind], block, shown, time_s, data))
        except (AssertionError, KeyError, TypeError, ValueError):
            place = f"{session.name}, {event.kind} at {time_s:g} s"
            expected = "an event of a round of pointing, as docs/reference/games/pointing.md has it"
            raise InputError(place, repr(dict(data))[:60], expected) from None
    if not taps:
        raise InputError(session.name, "no target", "the log of a round of pointing")
    return taps


def _tap(
    outcome: Outcome,
    block: Mapping[str, Any],
    shown: tuple[float, Mapping[str, Any]],
    time_s: float,
    data: Mapping[str, Any],
) -> Tap:
    shown_s, spawn = shown
    if data["target_id"] != spawn["target_id"]:
        raise ValueError
    x, y = map(float, spawn["center"])
    place = None if outcome == "miss" else tuple(map(float, data["place"]))
    if place is not None and len(place) != 2:
        raise ValueError
    return Tap(
        block=int(data["block"]),
        trial=int(data["trial"]),
        distance_m=float(block["distance"]),
        width_m=float(block["width"]),
        center_m=(x, y),
        shown_s=shown_s,
        time_s=time_s,
        outcome=outcome,
        place_m=None if place is None else (place[0], place[1]),
    )


# --- movements and blocks ------------------------------------------------------------------------


def index_of_difficulty(distance_m: float, width_m: float) -> float:
    """Shannon's form of the index of difficulty, log2(D / W + 1), bits."""
    return math.log2(distance_m / width_m + 1.0)


@dataclass(frozen=True)
class Movement:
    """From one selection to the next within a block.

    Attributes:
        block: number of its block within the round.
        distance_m: nominal.
        width_m: nominal.
        began_s: time of the selection before.
        time_s: from that to this one: the movement time.
        offset_m: of the selection beyond the target's centre along the task axis.
        across_m: of the selection across the task axis.
        length_m: from the selection before to this one along the task axis.
        hit: whether the target was hit.
    """

    block: int
    distance_m: float
    width_m: float
    began_s: float
    time_s: float
    offset_m: float
    across_m: float
    length_m: float
    hit: bool


def movements_of(taps: Sequence[Tap]) -> list[Movement]:
    """Return the movements of a round; none begins or ends with a target that disappeared."""
    found = []
    for before, tap in pairwise(taps):
        follows = tap.block == before.block and tap.trial == before.trial + 1
        if not follows or before.place_m is None or tap.place_m is None:
            continue
        from_m, to_m = np.array(before.center_m), np.array(tap.center_m)
        axis = (to_m - from_m) / np.linalg.norm(to_m - from_m)
        beyond = np.array(tap.place_m) - to_m
        found.append(
            Movement(
                block=tap.block,
                distance_m=tap.distance_m,
                width_m=tap.width_m,
                began_s=before.time_s,
                time_s=tap.time_s - before.time_s,
                offset_m=float(beyond @ axis),
                across_m=float(axis[0] * beyond[1] - axis[1] * beyond[0]),
                length_m=float((np.array(tap.place_m) - before.place_m) @ axis),
                hit=tap.outcome == "hit",
            )
        )
    return found


@dataclass(frozen=True)
class Block:
    """Consecutive movements of one distance and width.

    Attributes:
        distance_m: nominal.
        width_m: nominal.
        movements: number of movements.
        movement_time_s: their mean.
        error_rate: proportion of them that ended beside the target.
        spread_m: standard deviation of their offsets along the task axis.
        effective_distance_m: their mean length.
        effective_width_m: 4.133 times the spread.
        effective_bits: index of difficulty of the effective numbers.
        throughput_bps: effective index / movement time, bits/s.
    """

    distance_m: float
    width_m: float
    movements: int
    movement_time_s: float
    error_rate: float
    spread_m: float
    effective_distance_m: float
    effective_width_m: float
    effective_bits: float
    throughput_bps: float

    @property
    def bits(self) -> float:
        """Nominal index of difficulty."""
        return index_of_difficulty(self.distance_m, self.width_m)


def blocks_of(movements: Sequence[Movement]) -> list[Block]:
    """Return the blocks of a round with effective numbers: at least two movements that differ."""
    blocks = []
    for _, group in groupby(movements, key=lambda movement: movement.block):
        block = _block(list(group))
        if block is not None:
            blocks.append(block)
    return blocks


def _block(movements: Sequence[Movement]) -> Block | None:
    if len(movements) < 2:
        return None
    spread_m = float(np.std([movement.offset_m for movement in movements], ddof=1))
    length_m = float(np.mean([movement.length_m for movement in movements]))
    time_s = float(np.mean([movement.time_s for movement in movements]))
    if spread_m < _LEAST_SD_M or length_m <= 0.0 or time_s <= 0.0:
        return None
    bits = index_of_difficulty(length_m, _WIDTH_OF_SD * spread_m)
    return Block(
        distance_m=movements[0].distance_m,
        width_m=movements[0].width_m,
        movements=len(movements),
        movement_time_s=time_s,
        error_rate=float(np.mean([not movement.hit for movement in movements])),
        spread_m=spread_m,
        effective_distance_m=length_m,
        effective_width_m=_WIDTH_OF_SD * spread_m,
        effective_bits=bits,
        throughput_bps=bits / time_s,
    )


def submovements(times_s: FloatArray, places_m: FloatArray, began_s: float, ended_s: float) -> int:
    """Count the peaks of the tip's speed in the target plane between two moments.

    A movement that needs no correction has one. Moving out of the plane and into it again is none.
    The grid of 20 Hz begins with the movement, so that users and people are measured alike,
    whatever the frame rate of their logs.

    Args:
        times_s: (N,) of the log's rows, ascending.
        places_m: (N, 2) of the tip in the target plane.
        began_s: of the movement.
        ended_s: of the movement.

    Returns:
        at least 1.
    """
    count = max(2, round((ended_s - began_s) / _GRID_S) + 1)
    grid = np.linspace(began_s, ended_s, count)
    way = np.stack([np.interp(grid, times_s, axis) for axis in places_m.T], 1)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1) / (grid[1] - grid[0])
    # It begins and ends at rest, or is cut there.
    padded = np.concatenate([[0.0], speed, [0.0]])
    return max(1, len(find_peaks(padded, prominence=PROMINENCE_MPS)[0]))


# --- the law --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Difficulty:
    """A user's blocks of one distance and width, over all rounds.

    Attributes:
        distance_m: nominal.
        width_m: nominal.
        bits: nominal index of difficulty.
        movements: number of movements.
        movement_time_s: mean over the movements.
        error_rate: proportion of the movements that ended beside the target.
        spread_m: standard deviation along the task axis: root of the mean variance of the blocks.
        effective_bits: mean over the blocks.
        throughput_bps: mean over the blocks.
        submovements: mean over the movements; None if the tip's path is unknown.
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
class AimedRound:
    """The movements of one round.

    Attributes:
        taps: its targets.
        movements: from one selection to the next.
        submovements: of each movement; None without the tip's way.
    """

    taps: Sequence[Tap]
    movements: Sequence[Movement]
    submovements: Sequence[int] | None


@dataclass(frozen=True)
class AimedPerson:
    """One person's movements, of all rounds.

    Attributes:
        targets: that came up.
        timeouts: of them.
        difficulties: in the order of their indices.
        throughput_bps: mean over distances and widths of the means over blocks, as the standard
            has it for one person.
        line: movement times of the difficulties by their nominal indices.
        effective_line: the same by their effective indices.
        error_rate: of all movements.
    """

    targets: int
    timeouts: int
    difficulties: tuple[Difficulty, ...]
    throughput_bps: float
    line: FittedLine | None
    effective_line: FittedLine | None
    error_rate: float

    def values(self) -> dict[str, float]:
        """Return the measures by name, without those that there are not."""
        rows = self.difficulties
        counts = [each.submovements for each in rows if each.submovements is not None]
        found: dict[str, float] = {
            "throughput": self.throughput_bps,
            "aimed_time": float(np.mean([each.movement_time_s for each in rows])),
            "endpoint_spread": float(1e3 * np.mean([each.spread_m for each in rows])),
            "aimed_errors": self.error_rate,
            "timeouts": self.timeouts / self.targets,
        }
        if counts:
            found["submovements"] = float(np.mean(counts))
        for end, line in (("", self.line), ("_effective", self.effective_line)):
            if line is not None:
                numbers = (line.a_s, line.b_s_per_bit, line.r2)
                found |= {
                    f"fitts_{x}{end}": n for x, n in zip(("a", "b", "r2"), numbers, strict=True)
                }
        return found


def aimed_round(session: Session) -> AimedRound:
    """Return the movements of a round.

    Raises:
        InputError: it is none of pointing.
    """
    taps = taps_of(session)
    movements = movements_of(taps)
    pieces = None
    if session.objects:
        if _TIP not in session.objects:
            expected = "the log of a round of pointing"
            raise InputError(session.name, f"no column {_TIP}_pos_x", expected)
        tip, times_s = session.objects[_TIP][:, :2], session.time_ns / 1e9
        pieces = [
            submovements(times_s, tip, move.began_s, move.began_s + move.time_s)
            for move in movements
        ]
    return AimedRound(taps, movements, pieces)


def aimed_person(rounds: Sequence[AimedRound], name: str) -> AimedPerson:
    """Return the numbers of a person's rounds.

    Raises:
        InputError: no block has effective numbers.
    """
    blocks: dict[tuple[float, float], list[Block]] = defaultdict(list)
    pieces: dict[tuple[float, float], list[int]] = defaultdict(list)
    movements: dict[tuple[float, float], list[Movement]] = defaultdict(list)
    for played in rounds:
        for block in blocks_of(played.movements):
            blocks[block.distance_m, block.width_m].append(block)
        for k, movement in enumerate(played.movements):
            key = movement.distance_m, movement.width_m
            movements[key].append(movement)
            if played.submovements is not None:
                pieces[key].append(played.submovements[k])
    difficulties = [_difficulty(blocks[key], movements[key], pieces[key]) for key in blocks]
    if not difficulties:
        raise InputError(name, "no block with two movements that differ", "rounds that were played")
    difficulties.sort(key=lambda one: one.bits)
    every = [movement for group in movements.values() for movement in group]
    times_s = [one.movement_time_s for one in difficulties]
    taps = [tap for played in rounds for tap in played.taps]
    return AimedPerson(
        targets=len(taps),
        timeouts=sum(tap.outcome == "miss" for tap in taps),
        difficulties=tuple(difficulties),
        throughput_bps=float(np.mean([one.throughput_bps for one in difficulties])),
        line=fit_line([one.bits for one in difficulties], times_s),
        effective_line=fit_line([one.effective_bits for one in difficulties], times_s),
        error_rate=float(np.mean([not movement.hit for movement in every])),
    )


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


@dataclass(frozen=True)
class Spread:
    """A number of several persons.

    Attributes:
        mean: over them.
        sd: standard deviation (ddof 1); None of one.
        low: least.
        high: greatest.
    """

    mean: float
    sd: float | None
    low: float
    high: float

    @classmethod
    def of(cls, values: Iterable[float | None]) -> Spread | None:
        """Return the statistics of the existing numbers; None if there are none."""
        known = [value for value in values if value is not None]
        if not known:
            return None
        sd = float(np.std(known, ddof=1)) if len(known) > 1 else None
        return cls(float(np.mean(known)), sd, min(known), max(known))


@dataclass(frozen=True)
class LawRow:
    """One distance and width, over the persons who have it.

    Attributes:
        distance_m: nominal.
        width_m: nominal.
        bits: nominal index of difficulty.
        persons: number of persons.
        movement_time_s: of every person's mean.
        throughput_bps: of every person's.
        error_rate: of every person's.
        spread_m: of every person's standard deviation of end points along the task axis.
        submovements: of every person's mean; None if the tip's path is unknown.
    """

    distance_m: float
    width_m: float
    bits: float
    persons: int
    movement_time_s: Spread
    throughput_bps: Spread
    error_rate: Spread
    spread_m: Spread
    submovements: Spread | None


@dataclass(frozen=True)
class Law:
    """Fitts' law of a user or of people.

    Attributes:
        rows: in the order of their indices.
        line: of the means over persons, as studies report it.
    """

    rows: tuple[LawRow, ...]
    line: FittedLine | None


def law_of(persons: Sequence[AimedPerson]) -> Law:
    """Return the table of a user's distances and widths, and the line through their means."""
    found: dict[tuple[float, float], list[Difficulty]] = {}
    for person in persons:
        for each in person.difficulties:
            found.setdefault((each.distance_m, each.width_m), []).append(each)
    rows = []
    for own in found.values():
        spreads: dict[str, Any] = {
            key: Spread.of(getattr(one, key) for one in own)
            for key in (
                *("movement_time_s", "throughput_bps", "error_rate", "spread_m", "submovements"),
            )
        }
        first = own[0]
        rows.append(LawRow(first.distance_m, first.width_m, first.bits, len(own), **spreads))
    rows.sort(key=lambda row: row.bits)
    line = fit_line([row.bits for row in rows], [row.movement_time_s.mean for row in rows])
    return Law(tuple(rows), line)


# --- published -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Study:
    """A published group of people who select targets within reach in VR, by hand or device.

    Numbers are given only if the text that reports them was available.

    Attributes:
        citation: authors, title, place and year.
        people: number of people; None if the available text does not report it.
        task: task and device.
        a_s: intercept of MT = a + b ID; None if it is unknown here, as below.
        b_s_per_bit: slope.
        r2: of that line.
        throughput_bps: effective, as in the standard.
        note: source of the numbers, and gaps.
    """

    citation: str
    people: int | None
    task: str
    a_s: float | None = None
    b_s_per_bit: float | None = None
    r2: float | None = None
    throughput_bps: float | None = None
    note: str = ""

    @property
    def label(self) -> str:
        """Authors and year."""
        return f"{self.citation.partition(', *')[0]} {self.citation[-4:]}"


STUDIES = (
    Study(
        citation="Triantafyllidis et al., *Metrics for 3D object pointing and manipulation in "
        "virtual reality*, IEEE Robotics & Automation Magazine 29 (1), 2022",
        people=None,
        task="discrete reaching within arm's length in three dimensions, hand tracked optically, "
        "no controller",
        a_s=0.453,
        b_s_per_bit=0.557,
        r2=0.859,
        note="experiment 1, pointing (figure 6, page 87); the figure's seven models have slopes "
        "of 0.41 to 0.58 s/bit. This one is taken for Shannon's form: it is the fourth, as the "
        "form is in the text, and equals the fifth, which adds a direction that the experiment "
        "has not",
    ),
    Study(
        citation="arXiv 2510.18625, *Effects of virtual controller representation and virtuality "
        "on selection performance in extended reality*, 2025",
        people=40,
        task="rings of 13 targets, touched with a 1 cm ball on a Meta Quest 3 controller and "
        "confirmed with the trigger; the nearest to this game",
        note="only its beginning was at hand",
    ),
    Study(
        citation="University of Rijeka, *Empirical validation of Fitts' law in virtual reality*, "
        "Multimodal Technologies and Interaction 10 (5) 49, 2026",
        people=32,
        task="ISO 9241 pointing, Meta Quest 3 controller and bare hand; distances of 20 to 50 cm, "
        "targets of 2.5 to 5 cm",
        note="only its beginning was at hand",
    ),
    Study(
        citation="Batmaz et al., *Hitting the wall: mid-air interaction for eye-hand "
        "coordination*, VRST, 2019",
        people=12,
        task="touching targets in mid-air with and without a controller, and on a soft wall",
        note="slower, and with lower throughput, against the wall; only its beginning was at hand",
    ),
    Study(
        citation="Batmaz, Mutasim and Stuerzlinger, *Precision vs. power grip: a comparison of pen "
        "grip styles for selection in virtual reality*, IEEE VR Workshops, 2020",
        people=12,
        task="a pen at three depths",
        note="no effect of depth; fewer errors with a precision grip; only its beginning was at "
        "hand",
    ),
    Study(
        citation="Clark, Bhagat and Riggs, *Extending Fitts' law in three-dimensional virtual "
        "environments with current low-cost virtual reality technology*, International Journal of "
        "Human-Computer Studies, 2020",
        people=None,
        task="discrete reaching within arm's length, Oculus Rift controller",
        note="only its abstract was at hand",
    ),
)
