"""Evaluate an app with a user that needs no training: idle, random, or scripted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.progress import progress_of_part
from sim2vr_harness.client import (
    Condition,
    GameFacts,
    Measure,
    OptionValue,
    TaskedApp,
    TaskMoment,
    check_task,
    load_task,
)
from sim2vr_harness.client.tasks.events import EVENT_VALUE
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.evaluation.conditions import (
    asked_conditions,
    chosen_conditions,
    condition_groups,
)
from sim2vr_harness.evaluation.evaluate import batch_for
from sim2vr_harness.evaluation.expectations import Planned
from sim2vr_harness.evaluation.results import EvaluationResults
from sim2vr_harness.play.environment import make_simulation
from sim2vr_harness.play.exertion import ExertionRecorder, FatigueRecorder
from sim2vr_harness.play.film import RoundFilmer
from sim2vr_harness.play.player import Job, Watcher, jobs_for, play
from sim2vr_harness.play.round import Round, summarise
from sim2vr_harness.policies.protocol import Policy
from sim2vr_harness.policies.scripted import (
    ScriptedPolicy,
    StepOutcome,
    is_script,
    scripted_policy,
    with_inputs,
)

_PARALLEL = 2
"""Rounds at once."""


@dataclass(frozen=True)
class BaselineRun:
    """What the evaluation of a baseline found.

    Attributes:
        summaries: means by condition, as of an evaluation.
        facts: what the app publishes.
        files: results and films.
        problems: what is wrong with the app or its task, a sentence each.
        steps: of a script, the outcomes of its steps: a list per round.
    """

    summaries: Mapping[str, dict[str, Any]]
    facts: GameFacts
    files: list[Path]
    problems: list[str]
    steps: list[list[StepOutcome]]


def evaluate_baseline(
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
    watchers: Sequence[Watcher] = (),
    on_progress: Callable[[float], None] = lambda share: None,
    on_plan: Callable[[Planned], None] | None = None,
) -> BaselineRun:
    """Let an untrained user play, measure it, and check the app's task against the rounds.

    Args:
        env: users and app.
        user: of :data:`~sim2vr_harness.policies.scripted.USERS`.
        conditions: names of those to play; none: the app's default.
        named: options of the game that win over the conditions' own.
        episodes: rounds per condition.
        seed: of the first one.
        record: whether to film the first round.
        out: folder for results and films; None writes nothing.
        overwrite: whether to begin with new results where there are others.
        on_plan: called with conditions and measures before anything is played.

    Raises:
        InputError: a number or the user cannot be used.
    """
    _require_playable(episodes, record, out)
    env = with_inputs(env, user)
    facts = _with_steps(game_facts(env.app), user)
    asked = asked_conditions(env.app, conditions, typed=True)
    chosen = chosen_conditions(facts, asked, [facts.default_condition], named)
    if on_plan is not None:
        on_plan(Planned.of_evaluation(facts, chosen, env.user))
    groups = condition_groups(env, chosen)
    baseline = _Baseline(user, facts)
    with closing(RoundFilmer(out, facts)) if record and out else nullcontext() as filmer:
        films = [] if filmer is None else [filmer]
        rounds = baseline.play(groups, episodes, seed, [*watchers, *films], on_progress)
    settings = _settings(env, user, episodes, seed)
    scripts = [[step.as_dict() for step in steps] for steps in baseline.steps]
    summaries = {one.name: _summary(one.name, rounds, facts, scripts) | settings for one in chosen}
    files = [] if out is None else [_saved(summaries, settings, out, overwrite=overwrite)]
    files += [file for film in films for file in film.files]
    return BaselineRun(summaries, facts, files, baseline.problems(env, summaries), baseline.steps)


def _require_playable(episodes: int, record: bool, out: Path | None) -> None:
    if episodes < 1:
        raise InputError("--episodes", str(episodes), "at least 1")
    if record and out is None:
        raise InputError("--record", "it without --out", "a folder for the film, --out FOLDER")


STEP_MEASURES = (
    Measure("steps_done", "Steps done", better="higher", digits=0),
    Measure("steps_failed", "Steps not done", better="lower", digits=0),
)
"""Of a script; steps that were not begun count as not done."""


def _with_steps(facts: GameFacts, user: str) -> GameFacts:
    """Return facts with the measures of a script."""
    if not is_script(user):
        return facts
    return replace(facts, measures=(*facts.measures, *STEP_MEASURES))


class _Baseline:
    """An untrained user at play, and what its rounds say of the app and its task."""

    def __init__(self, user: str, facts: GameFacts) -> None:
        self._user, self._facts = user, facts
        self._judge: TaskedApp | None = None
        self._script: _ScriptWatcher | None = None

    @property
    def steps(self) -> list[list[StepOutcome]]:
        """Outcomes of a script's steps, a list per round."""
        return [] if self._script is None else self._script.steps

    def play(
        self,
        groups: Sequence[tuple[EnvConfig, Sequence[Condition]]],
        episodes: int,
        seed: int,
        watchers: Sequence[Watcher],
        on_progress: Callable[[float], None],
    ) -> list[Round]:
        """Return the rounds of all groups, each with apps of its own."""
        rounds: list[Round] = []
        if is_script(self._user):
            self._script = _ScriptWatcher(self._facts)
            watchers = [self._script, *watchers]
        watchers = [ExertionRecorder(), FatigueRecorder(), *watchers]
        for number, (config, conditions) in enumerate(groups):
            rounds += play(
                partial(self._make, config),
                self._policy,
                jobs_for(conditions, episodes, seed),
                self._facts,
                deterministic=False,
                batch=batch_for(config, _PARALLEL if self._script is None else 1),
                watchers=watchers,
                on_progress=progress_of_part(on_progress, number, len(groups)),
            )
        return rounds if self._script is None else self._script.with_steps(rounds)

    def _make(self, config: EnvConfig, n: int) -> Any:
        users = make_simulation(config, n)
        if self._judge is None and isinstance(users.apps[0], TaskedApp):
            self._judge = users.apps[0]
            self._judge.record()
        return users

    def _policy(self, simulation: Any) -> Policy:
        policy = scripted_policy(self._user, simulation)
        if self._script is not None and isinstance(policy, ScriptedPolicy):
            self._script.policy = policy
        return policy

    def problems(self, env: EnvConfig, summaries: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Return what is wrong with the app or its task, a sentence each."""
        found = []
        if self._judge is not None and env.app.task is not None:
            wrong = check_task(load_task(env.app.task), _first_round(self._judge))
            found = [f"the task: {one}" for one in wrong]
        score = self._facts.score
        arrived = any(one.arrived_s is not None for steps in self.steps for one in steps)
        if arrived and score and all(one.get(score) == 0 for one in summaries.values()):
            found.append(_arrived_for_nothing(self._user, score))
        return found


class _ScriptWatcher(Watcher):
    """Passes the values of the app to a script, and keeps what its steps did."""

    def __init__(self, facts: GameFacts) -> None:
        self._facts = facts
        self._values: frozenset[str] = frozenset()
        self.policy: ScriptedPolicy | None = None
        self.steps: list[list[StepOutcome]] = []

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """See :class:`Watcher`; the task's values are watched, of a game those of its measures."""
        app = simulation.apps[0]
        keys = {key for one in self._facts.scalars for key in (one.log_key, one.rate_with) if key}
        if isinstance(app, TaskedApp):
            keys |= {name for name in app.task.values if not name.startswith(EVENT_VALUE)}
        self._values = frozenset(keys)

    def stepped(self, reward: Any, infos: Sequence[Mapping[str, Any]]) -> None:
        """See :class:`Watcher`."""
        log = infos[0].get("log")
        if self.policy is not None and log is not None:
            values = {name: value for name, value in log.items() if name in self._values}
            self.policy.episodes[-1].take(values)

    def ended(self, index: int, result: Round) -> None:
        """See :class:`Watcher`."""
        assert self.policy is not None
        self.steps.append(self.policy.episodes[-1].ended())

    def with_steps(self, rounds: Sequence[Round]) -> list[Round]:
        """Return the rounds with the measures of the script."""
        found = []
        for result, steps in zip(rounds, self.steps, strict=True):
            done = float(sum(step.done for step in steps))
            counts = {"steps_done": done, "steps_failed": len(steps) - done}
            found.append(replace(result, values={**result.values, **counts}))
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


def _summary(
    condition: str,
    rounds: list[Round],
    facts: GameFacts,
    scripts: Sequence[list[dict[str, Any]]],
) -> dict[str, Any]:
    """Return the means of a condition's rounds, and the rounds, with what a script's steps did."""
    played = [result for result in rounds if result.condition == condition]
    content = [result.as_dict() for result in rounds]
    for one, steps in zip(content, scripts, strict=False):
        one["script"] = steps
    return {
        **summarise(played, facts),
        "game": facts.name,
        "rounds": [one for one in content if one["condition"] == condition],
    }


def _arrived_for_nothing(user: str, score: str) -> str:
    return (
        f"{user}: it arrived, and {score} stayed at 0; another object may count, a faster touch or "
        "another input, or the page looks at another controller: where the task names one device, "
        "that is the page's first input source"
    )


def _first_round(judge: TaskedApp) -> list[TaskMoment]:
    moments = judge.moments or []
    starts = [k for k, moment in enumerate(moments) if moment.step_s == 0.0]
    return moments[: starts[1]] if len(starts) > 1 else moments
