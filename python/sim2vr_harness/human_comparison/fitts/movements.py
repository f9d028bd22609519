"""Movements from one selection to the next, and the effective numbers of a block.

After R. W. Soukoreff and I. S. MacKenzie, "Towards a standard for pointing device evaluation",
International Journal of Human-Computer Studies 61 (2004) 751-789: errors count like hits, a
movement's length and the spread of its end are taken along the task axis, from the target before
to the one aimed at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np

from sim2vr_harness.human_comparison.fitts.taps import Tap

_WIDTH_OF_SD = 4.133
"""Standard deviations that hold 96 % of normally spread selections."""
_LEAST_SD_M = 1e-6


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
    """The movements of a round; none begins or ends with a target that went away."""
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
    """Movements of one distance and width in a row.

    Attributes:
        distance_m: nominal.
        width_m: nominal.
        movements: how many.
        movement_time_s: their mean.
        error_rate: share of them that ended beside the target.
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
    """The blocks of a round that have effective numbers: two movements that differ, at least."""
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
