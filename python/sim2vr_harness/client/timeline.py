"""Timeline of a round: the items of a game's level, for figures and summaries.

Games publish it in C++ (``Game::timelineJson`` in ``rl/game.hpp``).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sim2vr_harness.client.base import OptionValue, plain_options
from sim2vr_harness.client.runtime import checked_seed, load_runtime


@dataclass(frozen=True)
class TimelineItem:
    """A thing that comes at a time.

    Attributes:
        time_s: When, s after the round's start.
        lane: Where, counted from the lowest lane; may lie between two.
        shape: ``box``, ``disc``, ``dot`` or ``bar``.
        color: ``#rrggbb``.
        kind: For the legend.
        duration_s: Of a bar.
        lanes: Of a bar, upwards from ``lane``.
        arrow_deg: Direction of an arrow on it, counter-clockwise from right; None: it has none.
        marked: Something is wrong with it.
    """

    time_s: float
    lane: float
    shape: str
    color: str
    kind: str
    duration_s: float = 0.0
    lanes: float = 1.0
    arrow_deg: float | None = None
    marked: bool = False


@dataclass(frozen=True)
class Timeline:
    """What comes when in a round.

    Attributes:
        name: The level's.
        length_s: Of the round, s.
        lanes: Their names, bottom up.
        beats_s: Times of the beats, s.
        items: In no order.
        facts: Label and text or number, in the order of display.
        level: The level as the game has it, for those who play it elsewhere.
    """

    name: str
    length_s: float
    lanes: tuple[str, ...]
    beats_s: tuple[float, ...]
    items: tuple[TimelineItem, ...]
    facts: Mapping[str, Any]
    level: Mapping[str, Any] = field(default_factory=dict)


def describe_level(game: str, options: Mapping[str, OptionValue], seed: int) -> Timeline:
    """What comes when in the round that these options and this seed start.

    Raises:
        ValueError: There is no such game, it has no levels, or it refuses the options.
    """
    text = json.dumps(plain_options(options))
    told = json.loads(load_runtime().game_timeline(game, text, checked_seed(seed)))
    return Timeline(
        name=told["name"],
        length_s=told["length_s"],
        lanes=tuple(told["lanes"]),
        beats_s=tuple(told["beats_s"]),
        items=tuple(TimelineItem(**item) for item in told["items"]),
        facts=told["facts"],
        level=told["level"],
    )
