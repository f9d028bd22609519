"""A first look at an app without a trained user: somebody who sits still, or moves at random."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.errors import InputError, unknown_name
from sim2vr_harness.evaluation.metrics import summarise
from sim2vr_harness.evaluation.results import Results
from sim2vr_harness.evaluation.rollouts import Act, jobs_for, play
from sim2vr_harness.evaluation.video import RoundFilmer

__all__ = ["USERS", "act_of", "look"]

USERS = ("still", "random")
"""Who can play without having learned anything."""


def act_of(user: str, actions: int) -> Act:
    """Return what somebody who has learned nothing does.

    Args:
        user: of :data:`USERS`: ``still`` keeps all activations as they are; ``random`` changes them
            at random, as a policy before its training.
        actions: how many there are.

    Raises:
        InputError: there is no such user.
    """
    if user not in USERS:
        raise unknown_name("--user", user, USERS)

    def act(observation: dict[str, Any], rng: np.random.Generator | None) -> Any:
        if user == "still" or rng is None:
            return np.zeros(actions, np.float32)
        return np.clip(rng.standard_normal(actions), -1.0, 1.0).astype(np.float32)

    return act


def look(
    env: EnvConfig,
    user: str,
    *,
    episodes: int = 2,
    seed: int = 1,
    record: bool = False,
    out: Path | None = None,
    overwrite: bool = False,
    batch: int = 2,
    on_progress: Callable[[float], None] = lambda share: None,
    simulation: Callable[..., Any] | None = None,
) -> tuple[Mapping[str, dict[str, Any]], GameFacts, list[Path]]:
    """Let somebody play who has learned nothing, and measure it.

    Args:
        env: users and app.
        user: of :data:`USERS`.
        episodes: rounds.
        seed: of the first one.
        record: whether to film the first round.
        out: folder for results and films; None writes nothing.
        overwrite: whether to begin with new results where there are others.
        batch: rounds side by side at most.
        on_progress: called with the share of the work done.
        simulation: how to make the users: (EnvConfig, n) -> simulation.

    Returns:
        Means by condition, what the app publishes, and the files.

    Raises:
        InputError: a number or the user cannot be used.
    """
    if episodes < 1:
        raise InputError("--episodes", str(episodes), "at least 1")
    if record and out is None:
        raise InputError("--record", "it without --out", "a folder for the film, --out FOLDER")
    if simulation is None:
        from sim2vr_harness.envs.simulation import Simulation

        simulation = Simulation
    made = simulation
    facts = game_facts(env.app)
    condition = facts.condition(facts.default_condition)
    filmer = RoundFilmer(out, facts) if record and out is not None else None
    with closing(filmer) if filmer is not None else nullcontext():
        rounds = play(
            lambda n: made(env, n),
            lambda users: act_of(user, users.action_space.shape[0]),
            jobs_for([condition], episodes, seed),
            facts,
            deterministic=False,
            batch=batch,
            watchers=[] if filmer is None else [filmer],
            on_progress=on_progress,
        )
    settings = {
        "user": user,
        "episodes": episodes,
        "seed": seed,
        "deterministic": False,
        "overrides": [],
        "app": env.app.model_dump(mode="json", exclude_defaults=True),
        "trained_steps": 0,
    }
    summary = {
        **summarise(rounds, facts),
        **settings,
        "game": facts.name,
        "rounds": [result.as_dict() for result in rounds],
    }
    summaries = {condition.name: summary}
    files = list(filmer.files) if filmer is not None else []
    if out is not None:
        results = Results(out)
        if not overwrite:
            results.require_room(list(summaries), settings)
        files.insert(0, results.add(summaries, overwrite=overwrite))
    return summaries, facts, files
