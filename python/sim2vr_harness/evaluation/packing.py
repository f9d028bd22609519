"""Packs a trained user and measures what was packed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sim2vr_harness.envs.simulation import observation_space_of
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.player import new_policy
from sim2vr_harness.training.run_folder import RunFolder, write_atomically
from sim2vr_harness.training.trained_users import TrainedUser, find_user, pack

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
        details: further entries of the card; what the run says of itself need not be given.

    Returns:
        The card.

    Raises:
        InputError: The run or a number cannot be used.
    """
    user = find_user(run)
    details = {**_of_the_run(user), **details}
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


def _of_the_run(user: TrainedUser) -> dict[str, Any]:
    """What a run's folder says of how the user was trained; empty for a packed user."""
    folder = RunFolder(user.source.parent.parent)
    if not folder.exists:
        return {}
    config, told = user.config, folder.metadata()
    sessions = [session for session in told["sessions"] if "ended" in session]
    stages = {stage: seconds / 60.0 for stage, seconds in told.get("stage_seconds", {}).items()}
    stages["from pixels"] = sum(map(_minutes, sessions))
    details: dict[str, Any] = {
        "recipe": config.recipe,
        "seeds": [config.seed],
        "minutes": round(sum(stages.values()), 1),
        "stage_minutes": {stage: round(minutes, 1) for stage, minutes in stages.items()},
    }
    if config.recipe == "distill":
        teacher, imagination = config.teacher, config.teacher.imagination
        plays = imagination.first_play_steps + (imagination.cycles - 1) * imagination.play_steps
        practice = plays * teacher.ppo.n_envs if imagination.cycles else 0
        details["teacher_steps"] = practice + teacher.total_timesteps
        details["student_frames"] = config.student.frames
    if sessions:
        details["machine"] = f"{sessions[-1]['cores']} processor cores, {sessions[-1]['device']}"
    return details


def _minutes(session: Mapping[str, Any]) -> float:
    started, ended = (datetime.fromisoformat(session[key]) for key in ("started", "ended"))
    return (ended - started).total_seconds() / 60.0


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return round(value, 4) if isinstance(value, float) else value
