"""Targets of a round, by the events of any app: when each came up, and how it ended."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.sessions import SessionEvent

FloatArray = NDArray[np.float64]

_KINDS = {
    "spawn": ("spawn", "target_spawn", "box_spawn"),
    "hit": ("hit", "target_hit", "box_slice"),
    "miss": ("miss", "target_miss", "box_miss", "box_wrong_hand", "box_wrong_direction"),
}
_BOX = {"good": "hit", "bad": "miss", "miss": "miss"}
"""Outcomes of Beat Saber's boxes; they have the time of their spawn."""
_NUMBERS = ("target_id", "number", "value")
"""How events call the number of their target; without one, the oldest target ends first."""

_ELSEWHERE = (0.0, 0.0)


@dataclass(frozen=True)
class Targets:
    """The targets of a round, in the order in which they came up; T of them.

    Attributes:
        spawn_s: (T,) when each came up, game time.
        end_s: (T,) when it was hit or missed; NaN if the round ended first.
        hit: (T,) whether it was hit.
        missed: (T,) whether it went away unhit.
        cell: (T,) where it was, as a number.
        place_m: (T, 2) where it was, x and y in the plane.
        logged_speed_mps: (T,) speed that the game logged with the hit; NaN without.
    """

    spawn_s: FloatArray
    end_s: FloatArray
    hit: NDArray[np.bool_]
    missed: NDArray[np.bool_]
    cell: NDArray[np.int64]
    place_m: FloatArray
    logged_speed_mps: FloatArray

    @property
    def n(self) -> int:
        """How many came up."""
        return len(self.spawn_s)


@dataclass
class _Target:
    """A target while events are read; NaN and None: not yet, or never."""

    spawn_s: float
    cell: int
    end_s: float = np.nan
    hit: bool | None = None
    speed_mps: float = np.nan


def ending(event: SessionEvent) -> str | None:
    """Return ``hit`` or ``miss`` for an event that ends a target."""
    if event.kind == "box":
        return _BOX.get(str(event.data.get("outcome")))
    return next((kind for kind in ("hit", "miss") if event.kind in _KINDS[kind]), None)


def targets_of(
    events: Sequence[SessionEvent], places_m: Mapping[int, tuple[float, float]] | None = None
) -> Targets:
    """Return targets in the order of their spawns.

    Without spawns, each comes up as the one before ends. A target of which no spawn was recorded
    has none: NaN.

    Args:
        events: Of the app.
        places_m: Cell -> x and y in the plane; all in one place where there are none.
    """
    places = places_m or {}
    spawned = any(event.kind in _KINDS["spawn"] for event in events)
    up: dict[object, list[_Target]] = defaultdict(list)
    found: list[_Target] = []
    before_s = np.nan
    for event in events:
        time_s, how = event.time_ns / 1e9, ending(event)
        number = next((event.data[name] for name in _NUMBERS if name in event.data), None)
        cell = int(event.data["grid_id"]) if places else 0
        if event.kind in _KINDS["spawn"]:
            found.append(_Target(time_s, cell))
            up[number].append(found[-1])
        if how is None:
            continue
        if not up[number]:
            spawn_s = event.data.get("spawn_s", np.nan if spawned else before_s)
            found.append(_Target(float(spawn_s), cell))
            up[number].append(found[-1])
        target = up[number].pop(0)
        target.end_s, target.hit, before_s = time_s, how == "hit", time_s
        if target.hit and "velocity" in event.data:
            target.speed_mps = float(np.linalg.norm(event.data["velocity"]))
    cells = [target.cell for target in found]
    return Targets(
        spawn_s=np.array([target.spawn_s for target in found], dtype=np.float64),
        end_s=np.array([target.end_s for target in found], dtype=np.float64),
        hit=np.array([target.hit is True for target in found], dtype=np.bool_),
        missed=np.array([target.hit is False for target in found], dtype=np.bool_),
        cell=np.array(cells, dtype=np.int64),
        place_m=np.array([places.get(cell, _ELSEWHERE) for cell in cells]).reshape(-1, 2),
        logged_speed_mps=np.array([target.speed_mps for target in found], dtype=np.float64),
    )
