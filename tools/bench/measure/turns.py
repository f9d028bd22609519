"""Measuring several things in turns, so that other programs slow them all alike."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from measure.processes import cpu_seconds

TURNS = 5


@dataclass(frozen=True)
class Turn:
    """What one turn found.

    Attributes:
        rate_per_s: user steps (or frames) of all users per second of wall time.
        cpu_us: processor time per user step, us, of all threads and processes.
        parts: further rates of the same turn, by name.
    """

    rate_per_s: float
    cpu_us: float
    parts: Mapping[str, float] = field(default_factory=dict)


class Measurable(Protocol):
    """Something that can be run for a while.

    Attributes:
        most_turns: it needs no more turns than that.
    """

    most_turns: int

    def measure(self, seconds: float) -> Turn:
        """Runs for about ``seconds``, at least one step."""


def in_turns(
    scenes: Mapping[str, Measurable],
    seconds: float,
    turns: int = TURNS,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> dict[str, list[Turn]]:
    """Measures each scene ``turns`` times, one after the other and round again.

    Args:
        scenes: by name.
        seconds: for each scene, all of its turns together.
        turns: 1 or more.
        on_stage: called with what is measured now.

    Returns:
        By name, the turns in order: turn k of one scene ran next to turn k of the others.
    """
    found: dict[str, list[Turn]] = {name: [] for name in scenes}
    for turn in range(turns):
        for name, scene in scenes.items():
            if turn >= scene.most_turns:
                continue
            on_stage(f"{name} ({turn + 1} of {min(turns, scene.most_turns)})")
            found[name].append(scene.measure(seconds / turns))
    return found


def timed_turn(step: Callable[[], None], users: int, seconds: float) -> Turn:
    """Calls ``step`` for about ``seconds``.

    Args:
        step: moves ``users`` users on by a step. One more call, before the clock starts, warms the
            caches again.
        users: steps that a call counts for.
        seconds: of wall time; at least one call is measured.
    """
    step()
    count, cpu_began, began = 0, cpu_seconds(), time.perf_counter()
    while True:
        step()
        count += users
        elapsed_s = time.perf_counter() - began
        if elapsed_s >= seconds:
            cpu_s = cpu_seconds() - cpu_began
            return Turn(count / elapsed_s, 1e6 * cpu_s / count)


def paired_ratio(rates: list[float], others: list[float]) -> float:
    """Median over the turns of one scene's rate divided by another's in the same turn.

    Steadier than the ratio of the medians: what slowed one scene in a turn slowed its neighbour.
    """
    return float(np.median([a / b for a, b in zip(rates, others, strict=True)]))


def spread(rates: list[float]) -> float:
    """(largest - smallest) / median."""
    return float((max(rates) - min(rates)) / np.median(rates))
