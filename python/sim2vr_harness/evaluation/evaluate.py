"""``sim2vr-harness evaluate``: play rounds with a user, and measure its behaviour."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_json, write_atomically
from sim2vr_harness.base.progress import progress_of_part
from sim2vr_harness.client import (
    GameFacts,
    TaskedApp,
    check_task,
    load_task,
)
from sim2vr_harness.client.tasks import names_code
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation.conditions import (
    asked_conditions,
    chosen_conditions,
    condition_groups,
    facts_of_chosen,
    named_options,
)
from sim2vr_harness.evaluation.data.columns import Column, number_table
from sim2vr_harness.evaluation.data.episodes import episode_columns, episode_rows
from sim2vr_harness.evaluation.data.folder import FOLDER, DataFolder, EvaluationData
from sim2vr_harness.evaluation.data.items import events_of_episode, item_columns
from sim2vr_harness.evaluation.data.steps import StepRecorder, pose_columns
from sim2vr_harness.evaluation.expectations import Planned
from sim2vr_harness.evaluation.request import Request
from sim2vr_harness.evaluation.training_distribution import met, unpractised
from sim2vr_harness.play.environment import make_simulation
from sim2vr_harness.play.exertion import ExertionRecorder, FatigueRecorder
from sim2vr_harness.play.film import RoundFilmer
from sim2vr_harness.play.player import Watcher, jobs_for, play
from sim2vr_harness.play.recorders import RoundLogs
from sim2vr_harness.play.round import Round, summarise
from sim2vr_harness.play.users import SimulatedUser, doing_nothing_pays
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy
from sim2vr_harness.policies.hierarchical.pointing import apart, rays_of
from sim2vr_harness.policies.protocol import Policy
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.sessions.state_log import read_state_log
from sim2vr_harness.users import effort_weight

_ROUNDING_S = 1e-4
"""Logged times are binary32."""


def frame_table(episode: str, folder: Path, step_s: float) -> Any:
    """Return the poses that the app logged of a round, tool included; None without a log.

    Args:
        folder: With the round's ``states.csv``.
        step_s: Length of a user step.

    Raises:
        InputError: The log cannot be read.
    """
    file = folder / "states.csv"
    if not file.is_file():
        return None
    log = read_state_log(file)
    poses = {"head": log.head, "right": log.right, "left": log.left, **log.others}
    columns = [
        column
        for name in poses
        for column in pose_columns(name, f"what the app's log calls {name!r}")
    ]
    times_s = log.times_s - log.times_s[0]
    steps = [math.ceil((time_s - _ROUNDING_S) / step_s) for time_s in times_s]
    counts = [
        (Column("frame", "integer", "", "Frame of the app, from 0; a key"), range(len(times_s))),
        (
            Column("step", "integer", "", "The user step that it is part of; 0: before the first"),
            np.maximum(0, steps),
        ),
        (Column("time_s", "number", "s", "Game time of the frame"), log.times_s),
    ]
    values = np.concatenate(list(poses.values()), axis=1, dtype=np.float32)
    return number_table(episode, counts, values, columns)


class DataRecorder:
    """Writes the tables of an evaluation into its folder ``data``.

    Args:
        out: Folder of the evaluation.
        env: Environment of the rounds.
        moments: True: steps and frames are written, too.
    """

    def __init__(self, out: Path, facts: GameFacts, env: EnvConfig, *, moments: bool) -> None:
        self.root = out / FOLDER
        self._out, self._facts, self._env, self._keep = out, facts, env, moments
        self._folder = DataFolder(self.root)
        self._events: list[dict[str, Any]] = []
        self.unread: list[str] = []
        """Logs of apps with a format of their own, and why they are not in the tables."""

    @property
    def watchers(self) -> list[Watcher]:
        """Return the recorders that receive every step of the rounds."""

        def write(result: Round, table: Callable[[str], Any]) -> None:
            self._folder.write_moments("steps", result.key, table(result.key))

        return [StepRecorder(self._facts, write)] if self._keep else []

    def clear(self) -> None:
        """Remove the tables of earlier evaluations."""
        self._folder.clear()

    def take_logs(self, rounds: Sequence[Round]) -> None:
        """Read the app's logs of the rounds, before they are deleted.

        Logs that cannot be read are left out: the rounds are valid, and apps may have other
        formats.

        Args:
            rounds: With their ``log_folder``.
        """
        for result in rounds:
            if result.log_folder is not None:
                folder = self._out / result.log_folder
                try:
                    self._events += events_of_episode(result.key, folder, self._facts)
                except InputError as error:
                    self.unread.append(str(error))
                if self._keep:
                    self._take_frames(result, self._out / result.log_folder)

    def _take_frames(self, result: Round, folder: Path) -> None:
        try:
            frames = frame_table(result.key, folder, 1.0 / self._env.action_frequency_hz)
        except InputError as error:
            self.unread.append(str(error))
            return
        if frames is not None:
            self._folder.write_moments("frames", result.key, frames)

    def finish(
        self, rounds: Sequence[Round], settings: Mapping[str, Any], effort_weight: float
    ) -> None:
        """Write the tables of episodes and events, and the data dictionary.

        Raises:
            InputError: An existing table cannot be read.
        """
        rows = episode_rows(rounds, settings, self._facts, self._env, effort_weight)
        self._folder.add(
            {
                "episodes": (rows, episode_columns(rows, self._facts)),
                "events": (self._events, item_columns(self._events)),
            }
        )


_WHO = ("user", "trained_steps")
_HOW = ("episodes", "seed", "deterministic", "overrides", "app")
_PLAYERS = "people"
"""A setting that results have only where several people played."""
_WORDS = {
    "people": "people",
    "user": "user",
    "trained_steps": "trained steps",
    "episodes": "rounds",
    "seed": "seed",
    "deterministic": "deterministic",
    "overrides": "changes",
    "app": "app",
}


class EvaluationResults:
    """``results.json`` of a folder: condition -> measured results of one user.

    Args:
        folder: Folder of the file, which need not exist.

    Raises:
        InputError: The file exists and cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self.file = folder / "results.json"
        self._there: dict[str, dict[str, Any]] = {}
        if self.file.exists() or self.file.is_symlink():
            expected = "results of an evaluation, or another --out"
            there = read_json(self.file, expected)
            for condition, summary in there.items():
                if not isinstance(summary, dict):
                    got = f"{shown(condition)} of {shown(summary, 40)}"
                    raise InputError(file_name(self.file), got, expected)
            self._there = there

    def require_room(self, conditions: Sequence[str], settings: Mapping[str, Any]) -> None:
        """Check that results with these settings can be added without losing others.

        Results of the same conditions and settings are the same numbers again, and are replaced.

        Args:
            conditions: To be added.
            settings: ``user``, ``trained_steps``, ``episodes``, ``seed``, ``deterministic``,
                ``overrides`` and ``app`` of all of them, and ``people`` where some were requested.

        Raises:
            InputError: There are results of another user, or of a condition with other settings.
        """
        for condition, summary in self._there.items():
            compared = (*_WHO, *_HOW, _PLAYERS) if condition in conditions else _WHO
            for key in compared:
                if (there := summary.get(key)) != (new := settings.get(key)):
                    texts = [
                        json.dumps(one) if isinstance(one, (list, dict)) else str(one)
                        for one in (there, new)
                    ]
                    before, now = (t if len(t) <= 60 else f"...{t[-57:]}" for t in texts)
                    raise InputError(
                        "--out",
                        f"{str(self.file.parent)!r}, which has results of {condition} with "
                        f"{_WORDS[key]} {before}, not {now}",
                        "another folder, the same settings, or --overwrite to lose those results",
                    )

    def add(self, summaries: Mapping[str, dict[str, Any]], *, overwrite: bool = False) -> Path:
        """Add these results to the file.

        Args:
            summaries: condition -> results.
            overwrite: Leave out all other results.
        """
        kept = {} if overwrite else self._there
        content = {**kept, **summaries}
        write_atomically(self.file, (json.dumps(content, indent=2) + "\n").encode())
        return self.file


_LONGEST_NAME = 120
"""Of a folder, in characters."""

_PASSING_LOGS = ".logs"
"""Folder of logs that are read, and not kept."""

_USER_BYTES = 2_000_000
"""Least memory of a round in addition to others: body, app and its share of the renderers."""

SimulationFactory = Callable[..., Any]
"""(ResolvedEnv, n, log_dir=Path | None) -> simulation."""


@dataclass(frozen=True)
class Evaluation:
    """Results of an evaluation.

    Attributes:
        summaries: condition -> means over its rounds, and ``rounds``, one entry each.
        facts: Facts that the game publishes.
        user: The user that played.
        step: User steps that the evaluated checkpoint was trained for.
        files: Results, tables, videos and logs that were written.
        rounds: Every round.
        unpractised: Settings that the user was not trained for, a line each.
        problems: Of a user without training: what is wrong with the app or its task, a sentence
            each.
        data: The tables, as data frames: of everything that is in the folder.
        unread: Logs of the app that the tables lack, and why, a line each.
    """

    summaries: dict[str, dict[str, Any]]
    facts: GameFacts
    user: SimulatedUser
    step: int
    files: list[Path]
    rounds: list[Round]
    unpractised: list[str]
    problems: list[str]
    data: EvaluationData
    unread: list[str]

    @property
    def episodes(self) -> Any:
        """Table with a row per episode; see :class:`EvaluationData`, as for the following."""
        return self.data.episodes

    @property
    def events(self) -> Any:
        """A row per item of a round."""
        return self.data.events

    @property
    def steps(self) -> Any:
        """A row per user step."""
        return self.data.steps()

    @property
    def frames(self) -> Any:
        """A row per frame of the app."""
        return self.data.frames()


def evaluate(
    run: str | Path,
    request: Request | None = None,
    *,
    on_progress: Callable[[float], None] = lambda share: None,
    simulation: SimulationFactory = make_simulation,
    on_plan: Callable[[Planned], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> Evaluation:
    """Play rounds with a user and measure it.

    Args:
        run: A run's folder, one of its checkpoints, ``pretrained:NAME``, ``still``, ``random`` or a
            script.
        request: The rounds to play.
        simulation: Makes the users.
        on_plan: Called with conditions and measures before anything is played.
        on_note: Called before a trained user plays, with a sentence if the idle baseline gets
            rewards; None: this is not measured.

    Raises:
        InputError: The run, a number, a condition or the place for the results cannot be used.
    """
    with ExitStack() as stack:
        plan = _Plan(run, request or Request(), stack)
        wanted, user, out = plan.request, plan.user, plan.out
        if on_plan is not None:
            on_plan(Planned.of_evaluation(plan.facts, plan.conditions, plan.env))
        trained = user.trained is not None
        if trained and on_note is not None and (note := doing_nothing_pays(plan.env)):
            on_note(note)
        # An app that is ours and started here logs by itself; it costs no one an argument.
        app = plan.env.config.app
        own = app.connect is None and app.executable is None and app.page is None
        logs = None
        if wanted.log or own:
            logs = RoundLogs(out / ("logs" if wanted.log else _PASSING_LOGS))
        stack.callback(shutil.rmtree, out / _PASSING_LOGS, ignore_errors=True)
        steps = wanted.steps and plan.kept
        recorder = DataRecorder(out, plan.facts, plan.env.config, moments=steps)
        watchers = [ExertionRecorder(), FatigueRecorder(), *recorder.watchers, *wanted.watchers]
        filmer = RoundFilmer(out, plan.facts, seconds=wanted.film_seconds)
        if wanted.record:
            watchers.append(stack.enter_context(closing(filmer)))
        watchers += [logs] if logs is not None else []
        rounds, judges = _play(plan, recorder, logs, watchers, simulation, on_progress)
        if logs is not None:
            settled = logs.settle(rounds, out)
            rounds = settled if wanted.log else rounds
            recorder.take_logs(settled)
        recorder.finish(rounds, plan.settings, plan.effort_weight)
        summaries = plan.summaries(rounds)
        files = [plan.results.add(summaries, overwrite=wanted.overwrite), recorder.root]
        files += filmer.files
        files += [out / "logs"] if wanted.log and logs is not None and logs.any else []
        return Evaluation(
            summaries,
            plan.facts,
            user,
            int(plan.settings["trained_steps"]),
            files if plan.kept else [],
            rounds,
            plan.unpractised,
            [] if trained else _problems(plan, rounds, judges),
            EvaluationData(recorder.root),
            recorder.unread,
        )


class _Plan:
    """Plan of an evaluation: a checked request, completed from the run's configuration.

    Attributes:
        kept: True if the files that are written stay.
        settings: of the results; gets ``trained_steps`` once the policy is loaded.
    """

    def __init__(self, run: str | Path, request: Request, stack: ExitStack) -> None:
        self.user = user = SimulatedUser.find(run)
        self.request, trained, usual = request, user.trained, user.config.evaluation
        self.episodes, self.seed, self.deterministic = (
            getattr(usual, key) if (given := getattr(request, key)) is None else given
            for key in ("episodes", "seed", "deterministic")
        )
        env = user.env(request.app, request.overrides, trust_app=request.trust_app)
        if request.people is not None:
            env = user.with_people(env, request.people, self.seed, request.overrides)
        if request.cores is not None:
            env = env.changed(cores=request.cores)
        if trained is None and not request.record:
            env = _undrawn(env)
        user.require_contract(env)
        self.env, app = env, env.config.app
        facts = user.facts(env.facts)
        named = named_options(env.config, request.overrides, request.app)
        typed = trained is None or bool(request.app.get("arguments"))
        asked = asked_conditions(app, request.conditions, typed=typed)
        played: Sequence[str] = [facts.default_condition]
        if trained is not None:
            played = usual.conditions or met(user.config, trained.env)
        self.conditions = chosen_conditions(facts, asked, played, named)
        self.facts = facts_of_chosen(facts, self.conditions)
        self.batch = 1 if app.connect is not None else request.batch  # one that runs already
        rounds = self.episodes * (request.people or 1) * len(self.conditions)
        _check_numbers(self.episodes, self.seed, min(self.batch, rounds))
        self.kept = trained is not None or request.out is not None
        for option in ("record", "log"):
            if getattr(request, option) and not self.kept:
                raise InputError(f"--{option}", "it without --out", "a folder, --out FOLDER")
        self.unpractised: list[str] = []
        if trained is None:
            self.out = Path(request.out or stack.enter_context(TemporaryDirectory()))
        else:
            folder = trained.evaluation_dir / _folder_of(user.config, request)
            self.out = Path(request.out or folder)
            names = [condition.name for condition in self.conditions]
            self.unpractised = unpractised(user.config, trained.env, env, names)
        self.results = EvaluationResults(self.out)
        self.settings: dict[str, Any] = {
            "user": user.name,
            "episodes": self.episodes,
            "seed": self.seed,
            "deterministic": self.deterministic,
            "overrides": list(request.overrides),
            "app": dict(request.app),
            **({} if request.people is None else {"people": request.people}),
        }

    @property
    def effort_weight(self) -> float:
        """The weight of effort in the reward."""
        return effort_weight(self.env.config.user.effort.model, self.env.config.user.effort.weight)

    def summaries(self, rounds: Sequence[Round]) -> dict[str, dict[str, Any]]:
        """Return means by condition, with settings and rounds."""
        found = {}
        for condition in self.conditions:
            own = [result for result in rounds if result.condition == condition.name]
            found[condition.name] = {
                **summarise(own, self.facts),
                **self.settings,
                "game": self.facts.name,
                "score_measure": self.facts.score,
                "effort_weight": self.effort_weight,
                "unpractised": self.unpractised,
                "rounds": [result.as_dict() for result in own],
            }
        return found


def _undrawn(env: ResolvedEnv) -> ResolvedEnv:
    """Return an environment without images, unless a renderer is set or the task is code."""
    app = env.config.app
    if names_code(app.task) or app.renderer != "automatic":
        return env
    return env.changed(app=app.model_copy(update={"renderer": "null"}))


def _play(
    plan: _Plan,
    recorder: DataRecorder,
    logs: RoundLogs | None,
    watchers: Sequence[Watcher],
    simulation: SimulationFactory,
    on_progress: Callable[[float], None],
) -> tuple[list[Round], list[TaskedApp]]:
    """Return the rounds, and the app of the first one if a task judges a user without training."""
    judges: list[TaskedApp] = []

    def make_policy(users: Any) -> Policy:
        policy, plan.settings["trained_steps"] = plan.user.policy(users, plan.facts)
        if isinstance(policy, HierarchicalPolicy) and (note := _another_ray(policy, users)):
            plan.unpractised[:] = [*dict.fromkeys([*plan.unpractised, note])]
        if plan.user.trained is None and not judges and isinstance(users.apps[0], TaskedApp):
            judges.append(users.apps[0])
            judges[0].record()
        if plan.request.overwrite:
            recorder.clear()
        else:
            plan.results.require_room([one.name for one in plan.conditions], plan.settings)
        return policy

    # Conditions that the same apps can play, together.
    rounds: list[Round] = []
    groups = condition_groups(plan.env, plan.conditions)
    for number, (env, conditions) in enumerate(groups):

        def make(n: int, env: ResolvedEnv = env) -> Any:
            return simulation(env, n, log_dir=logs.folder() if logs is not None else None)

        rounds += play(
            make,
            make_policy,
            jobs_for(conditions, plan.episodes, plan.seed, plan.request.people),
            plan.facts,
            deterministic=plan.deterministic,
            batch=plan.batch,
            watchers=watchers,
            on_progress=progress_of_part(on_progress, number, len(groups)),
        )
    return rounds, judges


def _problems(plan: _Plan, rounds: Sequence[Round], judges: Sequence[TaskedApp]) -> list[str]:
    """Return the problems of the app or its task, a sentence each.

    Args:
        plan: The plan of the evaluation.
        rounds: The results.
        judges: The app of the first round, which has recorded the inputs of its task, if any.
    """
    found, app, score = [], plan.env.config.app, plan.facts.score
    task = app.task
    moments = (judges[0].moments or []) if judges else []
    starts = [k for k, moment in enumerate(moments) if moment.step_s == 0.0]
    if moments and task is not None:
        moments = moments[: starts[1]] if len(starts) > 1 else moments  # of the first round
        found = [f"the task: {one}" for one in check_task(load_task(task), moments)]
    arrived = any(step.arrived_s is not None for result in rounds for step in result.script)
    values = [result.values.get(score) for result in rounds] if score else [1.0]
    if arrived and not any(values):
        stayed = "had no value" if None in values else "stayed at 0"
        first = "where the task names one device, that is the page's first input source"
        found.append(
            f"{plan.user.name}: it arrived, and {score} {stayed}; another object may count, a "
            "faster touch or another input, or the app looks at another controller"
            + (f": {first}" if app.page is not None else "")
        )
    return found


def _another_ray(policy: HierarchicalPolicy, users: Any) -> str:
    """Return a sentence if a page's ray differs from the user's; "": it does not, or no ray."""
    if "point" not in policy.values.options.placed or users.config.app.page is None:
        return ""
    off = apart(rays_of(users, policy.layer.hands), policy.rays)
    return off and f"pointing with the page's ray of today, {off} from that of its training"


def _folder_of(config: TrainingConfig, request: Request) -> str:
    """Return a folder name for differences from the run's own settings; empty if there are none."""
    usual = config.evaluation
    told = [override.strip().removeprefix("env.") for override in request.overrides]
    if request.people is not None:
        told.append(f"people={request.people}")
    for key in ("episodes", "seed", "deterministic"):
        value = getattr(request, key)
        if value is not None and value != getattr(usual, key):
            told.append(f"{key}={value}".lower())
    told += [f"{key}={value}" for key, value in request.app.items() if value]
    return re.sub(r"[^\w.,=-]+", "_", ",".join(told))[:_LONGEST_NAME]


def _check_numbers(episodes: int, seed: int, batch: int) -> None:
    if episodes < 1:
        raise InputError("--episodes", str(episodes), "at least 1")
    if not 0 <= seed < 2**31:
        raise InputError("--seed", str(seed), "0 to 2147483647")
    if batch < 1:
        raise InputError("--batch", str(batch), "at least 1")
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES")
    if batch * _USER_BYTES > have:
        raise InputError(
            "--batch",
            f"{batch:,} rounds in parallel, which need {batch * _USER_BYTES / 2**30:,.0f} GiB",
            f"at most {have // _USER_BYTES:,} with the memory that is free",
        )
