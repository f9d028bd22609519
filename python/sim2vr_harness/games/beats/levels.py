"""The levels that imagined rounds play, as tensors: those of the true game."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.client.base import OptionValue, plain_options
from sim2vr_harness.client.runtime import load_runtime
from sim2vr_harness.games.beats.rules import (
    BOX_HALF_M,
    CELL_HEIGHT_M,
    CELL_WIDTH_M,
    COLUMNS,
    DIRECTIONS,
    LINK_HALF_M,
    MIDDLE_ROW,
    MIDDLE_ROW_M,
    WALL_DEPTH_M,
    middle_m,
)

NEVER_S = 1e6
"""Time of what fills up the tensors of levels with less in them."""


@dataclass(frozen=True)
class Levels:
    """P levels in parallel; times in s from a level's first beat, places in m from the origin.

    Attributes:
        condition: (P,) which one each belongs to.
        length: (P,) s.
        speed: (P,) m/s.
        approach: (P,) s.
        box_time: (P, N).
        box: (P, N, 2) x and y of the middles.
        box_hand: (P, N) 0 left, 1 right.
        box_cut: (P, N, 2) x and y of the demanded direction; 0, 0 for any.
        box_half: (P, N) half of an edge, m.
        mine_time: (P, M).
        mine: (P, M, 2).
        wall_start: (P, W) and
        wall_end: (P, W) when front and back are at the head plane.
        wall: (P, W, 4) left, right, bottom and top, m.
    """

    condition: Tensor
    length: Tensor
    speed: Tensor
    approach: Tensor
    box_time: Tensor
    box: Tensor
    box_hand: Tensor
    box_cut: Tensor
    box_half: Tensor
    mine_time: Tensor
    mine: Tensor
    wall_start: Tensor
    wall_end: Tensor
    wall: Tensor

    @staticmethod
    def joined(parts: Sequence[Levels], least: int = 1) -> Levels:
        """Return all levels of all parts, padded with objects that never appear.

        The result has at least one object of each kind.

        Args:
            parts: one level or several each.
            least: boxes, mines and walls of the result.
        """
        joined = {}
        for field in fields(Levels):
            values = [getattr(part, field.name) for part in parts]
            if values[0].dim() > 1:
                most = max(least, 1 + max(value.shape[1] for value in values))
                fill = NEVER_S if values[0].dim() == 2 and values[0].is_floating_point() else 0
                values = [_filled(value, most, fill) for value in values]
            joined[field.name] = torch.cat(values)
        return Levels(**joined)


def _filled(value: Tensor, most: int, fill: float) -> Tensor:
    shape = (value.shape[0], most - value.shape[1], *value.shape[2:])
    return torch.cat([value, torch.full(shape, fill, dtype=value.dtype)], 1)


def game_level(options: Mapping[str, OptionValue], seed: int) -> Mapping[str, Any]:
    """Return a level of the true game as plain data: what a round with this seed plays."""
    runtime: Any = load_runtime()
    told = json.loads(runtime.game_timeline("beats", json.dumps(plain_options(options)), seed))
    level: Mapping[str, Any] = told["level"]
    return level


def made_of(level: Mapping[str, Any], condition: int) -> Levels:
    """Return one level as tensors."""
    boxes, mines, walls = level["boxes"], level["mines"], level["walls"]
    speed = float(level["speed_mps"])
    cut = _rows([DIRECTIONS[int(b["cut"])] for b in boxes], 2)
    turn = _row([b["angle_offset_deg"] for b in boxes]).deg2rad()
    x, y = cut.unbind(-1)
    cut = torch.stack([x * turn.cos() - y * turn.sin(), x * turn.sin() + y * turn.cos()], -1)
    sides = []
    for wall in walls:
        left = (wall["column"] - COLUMNS / 2.0) * CELL_WIDTH_M
        bottom = MIDDLE_ROW_M + (wall["row"] - MIDDLE_ROW - 0.5) * CELL_HEIGHT_M
        right, top = left + wall["width"] * CELL_WIDTH_M, bottom + wall["height"] * CELL_HEIGHT_M
        sides.append((left, right, bottom, top))
    ends = [w["time_s"] + max(w["duration_s"], WALL_DEPTH_M / speed) for w in walls]
    return Levels(
        condition=torch.tensor([condition]),
        length=torch.tensor([float(level["length_s"])]),
        speed=torch.tensor([speed]),
        approach=torch.tensor([float(level["approach_s"])]),
        box_time=_row([b["time_s"] for b in boxes]),
        box=_rows([middle_m(b["column"], b["row"]) for b in boxes], 2),
        box_hand=torch.tensor([[int(b["hand"]) for b in boxes]], dtype=torch.long),
        box_cut=cut,
        box_half=_row([LINK_HALF_M if b["link"] else BOX_HALF_M for b in boxes]),
        mine_time=_row([m["time_s"] for m in mines]),
        mine=_rows([middle_m(m["column"], m["row"]) for m in mines], 2),
        wall_start=_row([w["time_s"] for w in walls]),
        wall_end=_row(ends),
        wall=_rows(sides, 4),
    )


def _row(values: Sequence[float]) -> Tensor:
    return torch.tensor([[float(value) for value in values]])


def _rows(values: Sequence[tuple[float, ...]], width: int) -> Tensor:
    return torch.tensor(values, dtype=torch.float32).reshape(1, len(values), width)
