"""What is measured of a round, and how rounds are summarised.

Definitions follow the released analysis of the user study, so that a simulated user's numbers
compare with people's:

- ``hits``, ``misses``, ``contacts``: events of one 60 s round. A miss is a target that expired; a
  contact is a touch of a living target that was too slow to count.
- ``hit_rate``: hits / (hits + misses), per round; targets still alive at the end count nowhere.
- ``hit_speed_mps``: mean over the hits of the norm of the (smoothed) velocity of the hammer's root.
- ``hammer_depth_m``: mean over the round of the striking face's position minus the target plane's
  origin, along the world's z; negative is in front of the plane, towards the player.
- ``max_fatigued``: mean over the muscles of the largest share of fatigued motor units.
- ``action_change``: mean over muscles and user steps of the absolute difference between an action
  and the one before it; 0 is smooth, 2 the most there is.
- ``effort``: summed cost of effort; ``return`` = ``game_return`` - ``effort``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

__all__ = ["METRICS", "RoundResult", "round_result", "summarise"]

METRICS = (
    "hits",
    "misses",
    "contacts",
    "hit_rate",
    "hit_speed_mps",
    "hammer_depth_m",
    "max_fatigued",
    "action_change",
    "effort",
    "game_return",
    "return",
)
"""Names of the numbers of a round, in the order of the tables."""


@dataclass(frozen=True)
class RoundResult:
    """One round of one user.

    Attributes:
        condition: The game's condition.
        episode: Number of the round within its condition, from 0.
        seed: Its seed.
        steps: User steps.
        ended: ``finished``, ``max_steps_reached``, ``diverged`` or ``app_failed``.
        values: The numbers named in :data:`METRICS`; None where a round has none.
        log: The game's last log.
    """

    condition: str
    episode: int
    seed: int
    steps: int
    ended: str
    values: dict[str, float | None]
    log: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        content = asdict(self)
        content |= content.pop("values")
        content["log"] = {key: _finite(value) for key, value in self.log.items()}
        return content


def round_result(
    *,
    condition: str,
    episode: int,
    seed: int,
    steps: int,
    game_return: float,
    effort: float,
    action_change: float | None = None,
    info: Mapping[str, Any],
    log: Mapping[str, float],
) -> RoundResult:
    """Work out the numbers of a finished round.

    A round whose app failed has none: it is cut short, and would not compare with the others.

    Args:
        condition: The game's condition.
        episode: Number of the round within its condition.
        seed: Its seed.
        steps: User steps taken.
        game_return: Sum of the game's rewards.
        effort: Sum of the costs of effort.
        action_change: Mean absolute difference of successive actions, if known.
        info: The last step's info.
        log: The game's last log.
    """
    hits, misses = log.get("Points"), log.get("Misses")
    rate = None
    if hits is not None and misses is not None and hits + misses > 0:
        rate = hits / (hits + misses)
    values = {
        "hits": hits,
        "misses": misses,
        "contacts": log.get("Contacts"),
        "hit_rate": rate,
        "hit_speed_mps": log.get("HitSpeed") if hits else None,
        "hammer_depth_m": log.get("HammerDepthZ"),
        "max_fatigued": info.get("max_fatigued"),
        "action_change": action_change,
        "effort": effort,
        "game_return": game_return,
        "return": game_return - effort,
    }
    ended = str(info.get("termination", "unknown"))
    if ended == "app_failed":
        values = dict.fromkeys(METRICS)
    return RoundResult(
        condition=condition,
        episode=episode,
        seed=seed,
        steps=steps,
        ended=ended,
        values={key: _finite(value) for key, value in values.items()},
        log=dict(log),
    )


def summarise(rounds: Sequence[RoundResult]) -> dict[str, Any]:
    """Return mean and standard deviation (ddof 1) of every number over rounds.

    ``hit_rate`` is the mean of the rounds' rates, as in the study; ``hit_rate_pooled`` divides the
    sums. Rounds without a number (no hit, no hit speed) are left out of its mean.
    ``return_terms`` splits the mean return: every number of the game's log that is called a reward,
    the rest of the game's return (Whac-A-Mole: hits), and effort as a cost. ``cell_hit_rates`` is
    pooled, by cell, for games that count ``hitsTarget0`` and so on; None where nothing came up.

    Args:
        rounds: At least one round.
    """
    summary: dict[str, Any] = {"episodes": len(rounds)}
    for name in METRICS:
        values = [result.values[name] for result in rounds]
        known = np.array([value for value in values if value is not None], dtype=np.float64)
        summary[name] = float(known.mean()) if len(known) else None
        summary[f"{name}_sd"] = float(known.std(ddof=1)) if len(known) > 1 else None
    hits = sum(result.values["hits"] or 0.0 for result in rounds)
    misses = sum(result.values["misses"] or 0.0 for result in rounds)
    summary["hit_rate_pooled"] = hits / (hits + misses) if hits + misses else None
    summary["return_terms"] = _return_terms(rounds)
    summary["cell_hit_rates"] = _cell_hit_rates(rounds)
    for end in ("diverged", "app_failed"):
        summary[end] = sum(result.ended == end for result in rounds)
    return summary


def _return_terms(rounds: Sequence[RoundResult]) -> dict[str, float]:
    played = [result for result in rounds if result.values["return"] is not None]
    if not played:
        return {}
    named = sorted({key for result in played for key in result.log if "Reward" in key})
    terms = {key: float(np.mean([result.log.get(key, 0.0) for result in played])) for key in named}
    game = float(np.mean([result.values["game_return"] or 0.0 for result in played]))
    effort = float(np.mean([result.values["effort"] or 0.0 for result in played]))
    return {"hits and the rest": game - sum(terms.values()), **terms, "effort": -effort}


def _cell_hit_rates(rounds: Sequence[RoundResult]) -> list[float | None]:
    def total(name: str, cell: int) -> float:
        return sum(result.log.get(f"{name}Target{cell}", 0.0) for result in rounds)

    cells = {
        int(key.removeprefix("hitsTarget"))
        for result in rounds
        for key in result.log
        if key.startswith("hitsTarget")
    }
    rates: list[float | None] = []
    for cell in range(max(cells, default=-1) + 1):
        hits, misses = total("hits", cell), total("misses", cell)
        rates.append(hits / (hits + misses) if hits + misses else None)
    return rates


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
