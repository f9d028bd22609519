"""Whac-A-Mole's reward for one target (docs/reference/games/whacamole.md, Reward), as formulas."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim2vr_harness.games.rewards import Formula, RewardTerms, Term

_STRIKE_MPS = 0.8
_UNCONSTRAINED = "-unconstrained"


def reward_terms(options: Mapping[str, Any]) -> RewardTerms:
    """Return the terms under these options of the game."""
    paper = options.get("reward", "reference") == "paper"
    condition = str(options.get("condition", "medium"))
    speed = f" if v >= {_STRIKE_MPS} else 0" if not condition.endswith(_UNCONSTRAINED) else ""
    terms = [Term("hits", "arrival", Formula(f"10{speed}"))]
    if not options.get("sparse", False):
        closeness = "exp(-10 * x) - 1" if paper else "(exp(-10 * x) - 1) / 10"
        terms.append(Term("target closeness", "step", Formula(closeness)))
        if speed:
            sign = "-" if paper else ""
            slow = f"{sign}2 * max(0, v) / {_STRIKE_MPS} if v < {_STRIKE_MPS} else 0"
            terms.append(Term("slow contacts", "arrival", Formula(slow)))
    return RewardTerms("whacamole", tuple(terms), start_m=0.5, reached_m=0.025, seconds=1.0)
