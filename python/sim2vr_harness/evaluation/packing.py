"""Packs a trained user and measures what was packed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sim2vr_harness.envs.simulation import observation_space_of
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.player import new_policy
from sim2vr_harness.training.run_folder import write_atomically
from sim2vr_harness.training.trained_users import find_user, pack

__all__ = ["pack_measured"]

MEASURED: tuple[str, ...] = (
    *("episodes", "hits", "misses", "contacts", "hit_rate", "hit_speed_mps", "hammer_depth_m"),
    *("max_fatigued", "action_change", "effort", "game_return", "return", "seed"),
    *("return_terms", "cell_hit_rates"),
)
"""What of an evaluation's summary goes on the card."""


def pack_measured(
    run: str | Path,
    name: str,
    folder: Path,
    *,
    conditions: Sequence[str] | None,
    episodes: int,
    details: Mapping[str, Any],
) -> dict[str, Any]:
    """Write the user of a run into ``folder`` and its card with measured results.

    Args:
        run: as of :func:`~sim2vr_harness.training.trained_users.find_user`.
        name: what it will be called.
        folder: where it goes.
        conditions: to measure; None takes those of the run's configuration.
        episodes: rounds per condition.
        details: further entries of the card.

    Returns:
        The card.

    Raises:
        InputError: The run or a number cannot be used.
    """
    user = find_user(run)
    policy = new_policy(user, observation_space_of(user.config.env))
    card = pack(user, policy, folder, name, details)
    with TemporaryDirectory() as scratch:
        request = Request(conditions=conditions, episodes=episodes, out=Path(scratch))
        found = evaluate(folder, request)
    card["results"] = {
        condition: {key: _rounded(summary.get(key)) for key in MEASURED}
        for condition, summary in found.summaries.items()
    }
    write_atomically(folder / "card.json", (json.dumps(card, indent=2) + "\n").encode())
    return card


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return round(value, 4) if isinstance(value, float) else value
