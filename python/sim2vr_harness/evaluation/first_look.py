"""A first look at an app without a trained user.

Someone sits still, moves at random, or reaches for an object.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.client import (
    GameFacts,
    OptionValue,
    TaskedApp,
    TaskMoment,
    WebXRApp,
    check_task,
    load_task,
)
from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.evaluation.conditions import (
    asked_conditions,
    chosen_conditions,
    condition_groups,
)
from sim2vr_harness.evaluation.environment import make_simulation
from sim2vr_harness.evaluation.evaluate import batch_for
from sim2vr_harness.evaluation.expectations import Planned
from sim2vr_harness.evaluation.metrics import RoundResult, summarise
from sim2vr_harness.evaluation.results import EvaluationResults
from sim2vr_harness.evaluation.rollouts import Job, Watcher, jobs_for, play
from sim2vr_harness.evaluation.video import RoundFilmer
from sim2vr_harness.policies.protocol import Act
from sim2vr_harness.users.kinematics.reach_controller import ReachController

__all__ = ["USERS", "BaselineRun", "act_of", "look"]

USERS = ("still", "random", "reach NAME")
"""Who can play without having learned anything."""

_REACH = "reach "
_PARALLEL = 2
"""Rounds at once."""
_NEAR_M = 0.05
"""As near as a hand comes that can get there."""


def act_of(user: str, simulation: Any, gaps_m: list[float] | None = None) -> Act:
    """Return what someone who has learned nothing does.

    Args:
        user: of :data:`USERS`: ``still`` keeps all activations as they are; ``random`` changes them
            at random, as a policy before its training; ``reach NAME`` moves the hand to where the
            object of that name is.
        simulation: of the users; of one, who reaches.
        gaps_m: gets how far the hand of one who reaches is from the object, at every step.

    Raises:
        InputError: there is no such user, or the app cannot say where an object is.
    """
    if user.startswith(_REACH):
        return _reaching(user.removeprefix(_REACH).strip(), simulation, gaps_m)
    if user not in USERS[:2]:
        raise unknown_name("--user", user, USERS)
    actions = simulation.action_space.shape[0]

    def act(observation: dict[str, Any], rng: np.random.Generator | None) -> Any:
        if user == "still" or rng is None:
            return np.zeros(actions, np.float32)
        return np.clip(rng.standard_normal(actions), -1.0, 1.0).astype(np.float32)

    return act


def _reaching(name: str, simulation: Any, gaps_m: list[float] | None) -> Act:
    worn = [
        one for one in ("controller_right", "controller_left") if one in simulation.body.devices
    ]
    if not worn:
        raise InputError("--user", f"'reach {name}' without a controller", "a body that wears one")
    reacher = ReachController(simulation.body, worn[0])
    if not isinstance(_page_of(simulation), WebXRApp):
        raise InputError("--user", f"'reach {name}'", "--page with it: other apps name no objects")
    actions = simulation.action_space.shape[0]

    def act(observation: dict[str, Any], rng: np.random.Generator | None) -> Any:
        users, action = simulation.users, np.zeros(actions, np.float32)
        goal = position_to_mujoco(_page_of(simulation).locate(name))
        body = reacher.action(users.qpos[0], users.qvel[0], users.act[0], goal)
        action[: len(body)] = body
        if gaps_m is not None:
            gaps_m.append(reacher.gap_m)
        return action

    return act


def _page_of(simulation: Any) -> Any:
    """The app, which a replacement may have become, below its task if there is one."""
    return getattr(simulation.apps[0], "app", simulation.apps[0])


@dataclass(frozen=True)
class BaselineRun:
    """What a first look found.

    Attributes:
        summaries: means by condition, as of an evaluation.
        facts: what the app publishes.
        files: results and films.
        problems: what is wrong with the app or its task, a sentence each.
    """

    summaries: Mapping[str, dict[str, Any]]
    facts: GameFacts
    files: list[Path]
    problems: list[str]


def look(
    env: EnvConfig,
    user: str,
    *,
    conditions: Sequence[str] = (),
    named: Mapping[str, OptionValue] | None = None,
    episodes: int = 2,
    seed: int = 1,
    record: bool = False,
    out: Path | None = None,
    overwrite: bool = False,
    on_progress: Callable[[float], None] = lambda share: None,
    on_plan: Callable[[Planned], None] | None = None,
) -> BaselineRun:
    """Let an untrained user play, measure it, and check the app's task against the rounds.

    Args:
        env: users and app.
        user: of :data:`USERS`.
        conditions: names of those to play; none: the app's default.
        named: options of the game that win over the conditions' own.
        episodes: rounds per condition.
        seed: of the first one.
        record: whether to film the first round.
        out: folder for results and films; None writes nothing.
        overwrite: whether to begin with new results where there are others.
        on_progress: called with the share of the work done.
        on_plan: called with conditions and measures before anything is played.

    Raises:
        InputError: a number or the user cannot be used.
    """
    if episodes < 1:
        raise InputError("--episodes", str(episodes), "at least 1")
    if record and out is None:
        raise InputError("--record", "it without --out", "a folder for the film, --out FOLDER")
    facts = game_facts(env.app)
    asked = asked_conditions(env.app, conditions, typed=True)
    chosen = chosen_conditions(facts, asked, [facts.default_condition], named)
    if on_plan is not None:
        on_plan(Planned.of_evaluation(facts, chosen, env.user))
    jobs = [
        (config, jobs_for(group, episodes, seed)) for config, group in condition_groups(env, chosen)
    ]
    baseline = _Baseline(user)
    files: list[Path] = []
    with ExitStack() as stack:
        watchers = []
        if record and out is not None:
            filmer = stack.enter_context(closing(RoundFilmer(out, facts)))
            watchers, files = [filmer], filmer.files
        rounds = baseline.play(jobs, facts, watchers, on_progress)
    settings = _settings(env, user, episodes, seed)
    summaries = {one.name: _summary(one.name, rounds, facts) | settings for one in chosen}
    if out is not None:
        files = [_saved(summaries, settings, out, overwrite=overwrite), *files]
    return BaselineRun(summaries, facts, files, baseline.problems(env, facts, summaries))


class _Baseline:
    """An untrained user at play, and what its rounds say of the app and its task."""

    def __init__(self, user: str) -> None:
        self._user = user
        self._judge: TaskedApp | None = None
        self._gaps_m: list[float] = []

    def play(
        self,
        groups: Sequence[tuple[EnvConfig, Sequence[Job]]],
        facts: GameFacts,
        watchers: Sequence[Watcher],
        on_progress: Callable[[float], None],
    ) -> list[RoundResult]:
        """Return the rounds of all groups, each with apps of its own."""
        rounds: list[RoundResult] = []
        for number, (config, jobs) in enumerate(groups):

            def advance(share: float, done: int = number) -> None:
                on_progress((done + share) / len(groups))

            rounds += play(
                partial(self._make, config),
                lambda users: act_of(self._user, users, self._gaps_m),
                jobs,
                facts,
                deterministic=False,
                batch=batch_for(config, 1 if self._user.startswith(_REACH) else _PARALLEL),
                watchers=watchers,
                on_progress=advance,
            )
        return rounds

    def _make(self, config: EnvConfig, n: int) -> Any:
        users = make_simulation(config, n)
        if self._judge is None and isinstance(users.apps[0], TaskedApp):
            self._judge = users.apps[0]
            self._judge.record()
        return users

    def problems(
        self, env: EnvConfig, facts: GameFacts, summaries: Mapping[str, Mapping[str, Any]]
    ) -> list[str]:
        """Return what is wrong with the app or its task, a sentence each."""
        found = []
        if self._judge is not None:
            wrong = check_task(load_task(env.app.task), _first_round(self._judge))
            found = [f"the task: {one}" for one in wrong]
        score, gaps_m = facts.score, self._gaps_m
        if gaps_m and score and all(one.get(score) == 0 for one in summaries.values()):
            found.append(_reached_for_nothing(self._user, min(gaps_m), score))
        return found


def _settings(env: EnvConfig, user: str, episodes: int, seed: int) -> dict[str, Any]:
    """Return what the results say of how they were played."""
    return {
        "user": user,
        "episodes": episodes,
        "seed": seed,
        "deterministic": False,
        "overrides": [],
        "app": env.app.model_dump(mode="json", exclude_defaults=True),
        "trained_steps": 0,
    }


def _saved(
    summaries: dict[str, dict[str, Any]], settings: dict[str, Any], out: Path, *, overwrite: bool
) -> Path:
    """Write results into a folder and return their file."""
    results = EvaluationResults(out)
    if not overwrite:
        results.require_room(list(summaries), settings)
    return results.add(summaries, overwrite=overwrite)


def _summary(condition: str, rounds: list[RoundResult], facts: GameFacts) -> dict[str, Any]:
    """Return the means of a condition's rounds, and the rounds."""
    played = [result for result in rounds if result.condition == condition]
    return {
        **summarise(played, facts),
        "game": facts.name,
        "rounds": [result.as_dict() for result in played],
    }


def _reached_for_nothing(user: str, gap_m: float, score: str) -> str:
    if gap_m > _NEAR_M:
        why = "the body cannot get there (sim2vr-harness reach)"
    else:
        why = (
            "something else may count now, or another input; or the page looks at another "
            "controller: where the task "
            "names one device, that is the page's first input source"
        )
    return f"{user}: the hand came as near as {gap_m:.2f} m, and {score} stayed at 0; {why}"


def _first_round(judge: TaskedApp) -> list[TaskMoment]:
    moments = judge.moments or []
    starts = [k for k, moment in enumerate(moments) if moment.step_s == 0.0]
    return moments[: starts[1]] if len(starts) > 1 else moments
