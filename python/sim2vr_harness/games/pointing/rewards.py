"""Pointing's reward for one target (docs/reference/games/pointing.md, Reward), as formulas."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim2vr_harness.games.rewards import Formula, RewardTerms, Term


def reward_terms(options: Mapping[str, Any]) -> RewardTerms:
    """Return the terms under these options of the game."""
    terms = [Term("hits", "arrival", Formula(10.0))]
    if not options.get("sparse", False):
        terms.append(Term("target closeness", "step", Formula("(exp(-10 * x) - 1) / 10")))
    return RewardTerms("pointing", tuple(terms), start_m=0.2, reached_m=0.015, seconds=1.0)
