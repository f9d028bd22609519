"""Beats' reward for one box, cut straight along (docs/reference/games/beats.md, Reward)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim2vr_harness.games.rewards import Formula, RewardTerms, Term


def reward_terms(options: Mapping[str, Any]) -> RewardTerms:
    """Return the terms under these options of the game."""
    slow = float(options.get("min_cut_speed_mps", 0.5))
    fast = float(options.get("full_cut_speed_mps", 5.0))
    share = f"max(0, min(1, (v - {slow}) / {fast - slow}))"
    terms = [Term("cuts", "arrival", Formula(f"125 + 75 * {share} if v >= {slow} else 0"))]
    if options.get("reward", "score") == "shaped":
        weight = float(options.get("approach_reward", 10.0))
        penalty = float(options.get("miss_penalty", 0.0))
        closeness = Formula(f"{weight} * dt * exp(-4 * x)")
        terms.append(Term("blade closeness", "step", closeness))
        if penalty:
            terms.append(Term("misses", "absence", Formula(-penalty)))
    return RewardTerms("beats", tuple(terms), start_m=0.8, reached_m=0.0, seconds=1.0)
