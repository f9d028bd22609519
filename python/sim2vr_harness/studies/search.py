"""Runs a search: batch after batch is chosen by Optuna, played and told.

Optuna's journal in the study's folder keeps what was chosen and told, so that a killed search, and
one with more trials, goes on with it. Each choice has a seed of its own, from that of the study and
the number of the trial: the choices of a search that was killed are those of one that was not.
"""

import json
import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml

from sim2vr_harness.base.errors import InputError, reason, unknown_name
from sim2vr_harness.base.files import file_name, read_json
from sim2vr_harness.base.optional import needed
from sim2vr_harness.client import Measure
from sim2vr_harness.evaluation.data import Column
from sim2vr_harness.evaluation.data.columns import column_name, row_table
from sim2vr_harness.evaluation.data.folder import FOLDER, read_table
from sim2vr_harness.runs.config import parse_config
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.studies.config import (
    FactorConfig,
    OptimiseConfig,
    ParameterConfig,
    StopConfig,
    StudyConfig,
    Value,
    content_hash,
)
from sim2vr_harness.studies.jobs import CELLS, TRAININGS, CellTask, Pruning
from sim2vr_harness.studies.plan import StudyPlan, plan_of
from sim2vr_harness.studies.policy_selection import Users
from sim2vr_harness.studies.pool import Executor

TRIAL = "trial"
"""The factor of a search's tables: its levels are the numbers of the trials, from 1."""
JOURNAL = "search.journal"


@dataclass(frozen=True)
class Found:
    """Result of a search.

    Attributes:
        search: Objectives and parameters of the search.
        plan: Plan with a cell for each trial that was played.
        trials: Table ``trials``.
        sampler: Name and version of the sampler that suggested the trials.
    """

    search: OptimiseConfig
    plan: StudyPlan
    trials: pa.Table
    sampler: str


@contextmanager
def _quiet(optuna: Any) -> Iterator[None]:
    """Optuna tells of each trial on the standard error stream, and warns of what is new in it."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        optuna.logging.set_verbosity(before)


# --- trainings that are stopped early ----------------------------------------------------------


def reports_of(rows: Sequence[Mapping[str, Any]], stop: StopConfig) -> dict[int, float]:
    """Return the best report so far at each step that is judged and was reached.

    Args:
        rows: Of metrics.jsonl.
        stop: Which steps, and which report.
    """
    found: dict[int, float] = {}
    best = None
    steps = list(stop.at)
    better = max if stop.better == "higher" else min
    for row in rows:
        value = row.get(stop.report)
        if isinstance(value, (int, float)):
            best = float(value) if best is None else better(best, float(value))
        while steps and row.get("step", 0) >= steps[0]:
            step = steps.pop(0)
            if best is not None:
                found[step] = best
    return found


class Watch:
    """Follows a training, and says when Optuna's percentile pruner stops it.

    It is compared with trials of earlier batches only: they are over when it begins, so that no one
    has to wait, workers need not hear of each other, and the result does not depend on who was how
    fast.

    Args:
        pruning: What it is compared with.
        rows: What it reported before this session.
    """

    def __init__(self, pruning: Pruning, rows: Sequence[Mapping[str, Any]]) -> None:
        optuna = needed("optuna", "studies", "optimise")
        self._stop, self._rows = pruning.stop, [dict(row) for row in rows]
        pruner = optuna.pruners.PercentilePruner(
            100.0 * self._stop.keep, n_startup_trials=0, n_min_trials=self._stop.earlier
        )
        direction = "maximize" if self._stop.better == "higher" else "minimize"
        with _quiet(optuna):
            study = optuna.create_study(direction=direction, pruner=pruner)
            study.add_trials(
                [
                    optuna.create_trial(value=0.0, intermediate_values=dict(reports))
                    for reports in pruning.earlier
                ]
            )
            self._trial = study.ask()
        self._judged: set[int] = set()
        self.stopped_at: int | None = None
        self._judge()

    def report(self, report: Any) -> None:
        """Take in a report of the training; those of stages before the last do not count."""
        if report.number == report.stages:
            self._rows.append({**report.values, "step": int(report.done)})
            self._judge()

    def _judge(self) -> None:
        for step, value in reports_of(self._rows, self._stop).items():
            if self.stopped_at is None and step not in self._judged:
                self._judged.add(step)
                self._trial.report(value, step)
                if self._trial.should_prune():
                    self.stopped_at = step

    def stop(self) -> bool:
        """Return whether the training has to stop."""
        return self.stopped_at is not None


# --- the search ----------------------------------------------------------------------------------


def search(
    study: StudyConfig,
    wanted: OptimiseConfig,
    folder: Path | None,
    doing: Executor,
    *,
    trust_app: bool = False,
) -> Found:
    """Search; what is done of it already is not done again.

    Args:
        wanted: Its search.
        folder: Where its file is.
        doing: Who does the trials.
        trust_app: As of :func:`.plan_of`.

    Raises:
        InputError: A parameter, measure or limit cannot be used (nothing is played then), or trials
            failed (the others are kept).
    """
    return _Search(study, wanted, folder, doing, trust_app).run()


class _Search:
    def __init__(
        self,
        study: StudyConfig,
        wanted: OptimiseConfig,
        folder: Path | None,
        doing: Executor,
        trust_app: bool,
    ) -> None:
        self._study, self._wanted, self._folder, self._doing = study, wanted, folder, doing
        self._trust_app, self._users = trust_app, Users(code=trust_app)
        self._optuna = needed("optuna", "studies", "optimise")
        self._kept: Any = None
        self._plans: list[StudyPlan] = []

    def run(self) -> Found:
        wanted = self._wanted
        probes = self._probe()
        self._kept = self._opened(probes)
        trained = bool(probes[0].trainings)
        self._doing.expect(wanted.trials * (2 if trained else 1), wanted.at_once)
        for first in range(0, wanted.trials, wanted.at_once):
            # Whole batches, also of the last one: a search with more trials chooses the same.
            with _quiet(self._optuna):
                batch = [self._trial(first + k) for k in range(wanted.at_once)]
            self._play(first, batch[: wanted.trials - first])
        if not self._plans:
            expected = "trials whose rounds have the measures that they are judged by"
            raise InputError("optimise", f"{wanted.trials} trials without a number", expected)
        return Found(
            wanted,
            self._whole(),
            self._table(),
            f"Optuna {self._optuna.__version__} ({wanted.sampler})",
        )

    # --- before anything is played ---------------------------------------------------------------

    def _probe(self) -> list[StudyPlan]:
        """Plan, and thereby check, both ends of every range and all levels."""
        parameters = self._wanted.parameters
        first: dict[str, Value] = {name: p.ends[0] for name, p in parameters.items()}
        plans = []
        for name, parameter in parameters.items():
            levels = {
                value if isinstance(value, str) else f"{value:g}": self._wanted.settings(
                    {**first, name: value}
                )
                for value in parameter.ends
            }
            plans.append(self._plan(name, levels))
        self._check_measures(plans[-1].known)
        for training in plans[-1].trainings:
            total = parse_config(yaml.safe_load(training.config)).total_timesteps
            stop = self._wanted.stop
            if stop is not None and stop.at[-1] >= total:
                got = f"{stop.at[-1]} with a training of {total} user steps"
                raise InputError("optimise.stop.at", got, f"steps below {total}")
        return plans

    def _check_measures(self, known: Sequence[Measure]) -> None:
        by_name = {measure.name: measure for measure in known}
        for place, names in (
            ("objectives", self._wanted.objectives),
            ("constraints", self._wanted.constraints),
        ):
            for name in names:
                if name not in by_name:
                    raise unknown_name(f"optimise.{place}", name, by_name)
        for name, limits in self._wanted.constraints.items():
            low, high = _range_of(by_name[name])
            for key, value, beyond in (
                ("least", limits.least, limits.least is not None and limits.least > high),
                ("most", limits.most, limits.most is not None and limits.most < low),
            ):
                if beyond:
                    field = f"optimise.constraints.{name}"
                    got = f"{key} {value:g}, which nothing can keep"
                    raise InputError(field, got, f"a limit between {low:g} and {high:g}")

    def _plan(self, factor: str, levels: Mapping[str, Any], **more: Any) -> StudyPlan:
        return plan_of(
            self._as_study(factor, levels),
            folder=self._folder,
            users=self._users,
            trust_app=self._trust_app,
            **more,
        )

    def _as_study(self, factor: str, levels: Mapping[str, Any]) -> StudyConfig:
        """The study as one that says itself what its cells are."""
        factors = {factor: FactorConfig(levels=dict(levels))}
        return self._study.model_copy(update={"optimise": None, "factors": factors})

    # --- Optuna ----------------------------------------------------------------------------------

    def _opened(self, probes: Sequence[StudyPlan]) -> Any:
        """Open the journal; what is searched for otherwise, or in other cells, begins anew."""
        optuna, file = self._optuna, self._doing.root / JOURNAL
        if file.is_file():
            # Killed while it was written: the study's own lock says that no one else writes.
            os.truncate(file, file.read_bytes().rfind(b"\n") + 1)
        Path(f"{file}.lock").unlink(missing_ok=True)
        identity = {
            "optimise": self._wanted.model_dump(mode="json", exclude={"trials"}),
            "seed": self._study.seed,
            "cells": [task.key for plan in probes for task in plan.tasks],
        }
        backend = optuna.storages.journal.JournalFileBackend(str(file))
        directions = {"min": "minimize", "max": "maximize"}
        try:
            with _quiet(optuna):
                kept = optuna.create_study(
                    storage=optuna.storages.JournalStorage(backend),
                    study_name=content_hash(identity),
                    directions=[directions[way] for way in self._wanted.objectives.values()],
                    load_if_exists=True,
                )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            expected = "Optuna's journal of this search; without the file its trials are chosen "
            expected += "anew, and cells that are the same are not played again"
            raise InputError(file_name(file), f"it damaged ({reason(error)})", expected) from error
        with _quiet(optuna):
            for values in self._wanted.begin[len(kept.get_trials(deepcopy=False)) :]:
                known = self._wanted.parameters
                kept.enqueue_trial({n: known[n].check(n, value) for n, value in values.items()})
        return kept

    def _trial(self, number: int) -> Any:
        """Choose the parameters of a trial, where an earlier session has not."""
        states = self._optuna.trial.TrialState
        seed = [self._study.seed, number]
        self._kept.sampler = _sampler(self._optuna, self._wanted, seed)
        trials = self._kept.get_trials(deepcopy=False)
        if number < len(trials) and trials[number].state.is_finished():
            return trials[number]
        if number < len(trials) and trials[number].state == states.RUNNING:
            # Of a session that was killed: values that it has not chosen yet are chosen now.
            trial = self._optuna.trial.Trial(self._kept, trials[number]._trial_id)
        else:
            trial = self._kept.ask()
        for k, (name, parameter) in enumerate(self._wanted.parameters.items()):
            # A value of its own must not depend on which ones before it are kept already.
            self._kept.sampler = _sampler(self._optuna, self._wanted, [*seed, k])
            _suggest(trial, name, parameter)
        return trial

    def _tell(self, trial: Any, task: CellTask, reports: Mapping[int, float], ended: bool) -> None:
        """Say what came of a trial.

        Args:
            ended: Whether its training was stopped.
        """
        wanted, states = self._wanted, self._optuna.trial.TrialState
        trial.set_user_attr("reported", json.dumps(reports) if reports else None)
        trial.set_user_attr("stopped", ended)
        if ended:
            for step, value in list(reports.items())[-1:]:
                # A report with the sign that makes it good where the objective is.
                assert wanted.stop is not None
                (way,) = wanted.objectives.values()
                same = (way == "max") == (wanted.stop.better == "higher")
                trial.report(value if same else -value, step)
            self._kept.tell(trial, state=states.PRUNED if reports else states.FAIL)
            return
        measures = self._measured(task)
        trial.set_user_attr("measures", measures)
        numbers = {name: value for name, value in measures.items() if value is not None}
        if len(numbers) < len(measures):
            self._kept.tell(trial, state=states.FAIL)
            return
        for name, limits in wanted.constraints.items():
            for k, beyond in enumerate(limits.violations(numbers[name])):
                trial.set_constraint(f"{name} {k}", beyond)
        self._kept.tell(trial, [numbers[name] for name in wanted.objectives])

    # --- a batch ---------------------------------------------------------------------------------

    def _play(self, first: int, batch: Sequence[Any]) -> None:
        stop = self._wanted.stop
        plan = self._plan(
            TRIAL,
            {str(trial.number + 1): self._wanted.settings(trial.params) for trial in batch},
            pruning=None if stop is None else self._pruning(stop, first),
            may_diverge=True,
        )
        self._doing.do(plan.trainings)
        reports = [self._reports(task) for task in plan.tasks]
        stopped = [self._stopped(task) for task in plan.tasks]
        played = [task for task, end in zip(plan.tasks, stopped, strict=True) if not end]
        self._doing.forgo(len({t.key for t in plan.tasks}) - len({t.key for t in played}))
        self._doing.do(played)
        with _quiet(self._optuna):
            for trial, task, report, end in zip(batch, plan.tasks, reports, stopped, strict=True):
                if isinstance(trial, self._optuna.trial.Trial):  # others ended in a session before
                    self._tell(trial, task, report, end)
        if played:
            keep = [k for k, end in enumerate(stopped) if not end]
            cells = tuple(plan.cells[k] for k in keep)
            self._plans.append(replace(plan, cells=cells, tasks=tuple(plan.tasks[k] for k in keep)))

    def _pruning(self, stop: StopConfig, first: int) -> Pruning | None:
        """Return what trainings of a batch are compared with; None: too few trials are complete."""
        earlier = tuple(
            tuple((int(step), value) for step, value in json.loads(reported).items())
            for trial in self._kept.get_trials(deepcopy=False)[:first]
            if trial.state == self._optuna.trial.TrialState.COMPLETE
            and (reported := trial.user_attrs["reported"]) is not None
        )
        return Pruning(stop, earlier) if len(earlier) >= stop.earlier else None

    def _measured(self, task: CellTask) -> dict[str, float | None]:
        """Means over players of means over their rounds, of those whose app did not fail."""
        file = self._doing.root / CELLS / task.key / FOLDER / "episodes.parquet"
        rows = read_table(file).to_pandas()
        rows = rows[rows["ended"] != "app_failed"]
        known = [name for name in self._wanted.measures if name in rows]
        means = rows.groupby(rows["person"].fillna(-1))[known].mean().mean()
        return {
            name: float(means[name]) if name in known and np.isfinite(means[name]) else None
            for name in self._wanted.measures
        }

    def _reports(self, task: CellTask) -> dict[int, float]:
        stop = self._wanted.stop
        if stop is None or task.training is None:
            return {}
        rows = RunFolder(self._doing.root / TRAININGS / task.training).metrics()
        known = sorted({key for row in rows for key in row} - {"step", "time"})
        if rows and stop.report not in known:
            raise unknown_name("optimise.stop.report", stop.report, known)
        return reports_of(rows, stop)

    def _stopped(self, task: CellTask) -> bool:
        if task.training is None:
            return False
        mark = self._doing.root / TRAININGS / task.training / "trained.json"
        return "stopped_at" in read_json(mark, "what a training of this study wrote")

    # --- all of it -------------------------------------------------------------------------------

    def _whole(self) -> StudyPlan:
        first = self._plans[0]
        cells = tuple(cell for plan in self._plans for cell in plan.cells)
        trainings = {task.key: task for plan in self._plans for task in plan.trainings}
        levels = {
            label: plan.study.factors[TRIAL].levels[label]
            for plan in self._plans
            for label in (cell.levels[TRIAL] for cell in plan.cells)
        }
        return replace(
            first,
            study=self._as_study(TRIAL, levels),
            cells=cells,
            tasks=tuple(task for plan in self._plans for task in plan.tasks),
            trainings=tuple(trainings.values()),
            measures=tuple(dict.fromkeys([*self._wanted.measures, *first.measures])),
            alike=(),
        )

    def _table(self) -> pa.Table:
        """The table ``trials``, a row each."""
        wanted, known = self._wanted, {measure.name: measure for measure in self._plans[0].known}
        columns = [
            Column("trial", "integer", "", "Number of the trial; a key"),
            Column("design_cell", "text", "", "Its cell; none where its training was stopped"),
        ]
        for name, parameter in wanted.parameters.items():
            what = f"Sets {parameter.key}" if parameter.key else "Level that sets several keys"
            kind: Any = "text" if parameter.levels is not None else "number"
            columns.append(Column(parameter_column(name), kind, "", what))
        for name in wanted.measures:
            what = f"{known[name].label}, mean over players and their rounds"
            columns.append(Column(name, "number", known[name].unit, what))
        became = "measured, stopped (its training) or unmeasured"
        kept = "Whether it was measured and keeps all constraints"
        best = "Whether it is the best, or one of the best compromises"
        reported = "JSON object: step of the training -> best report so far"
        columns += [
            Column("state", "text", "", became),
            Column("keeps_limits", "boolean", "", kept),
            Column("chosen", "boolean", "", best),
            Column("reported", "text", "", reported),
        ]
        trials = self._kept.get_trials(deepcopy=False)[: wanted.trials]
        with _quiet(self._optuna):
            among = self._optuna.create_study(directions=self._kept.directions)
            among.add_trials(trials)
            chosen = [trial.number for trial in among.best_trials]
        chosen = chosen[:1] if len(wanted.objectives) == 1 else chosen
        rows = []
        for trial in trials:
            complete = trial.state == self._optuna.trial.TrialState.COMPLETE
            stopped = trial.user_attrs["stopped"]
            rows.append(
                {
                    "trial": trial.number + 1,
                    "design_cell": None if stopped else f"{TRIAL}={trial.number + 1}",
                    **{parameter_column(n): v for n, v in wanted.values(trial.params).items()},
                    **trial.user_attrs.get("measures", dict.fromkeys(wanted.measures)),
                    "state": "measured" if complete else "stopped" if stopped else "unmeasured",
                    "keeps_limits": complete and all(v <= 0.0 for v in trial.constraints.values()),
                    "chosen": trial.number in chosen,
                    "reported": trial.user_attrs["reported"],
                }
            )
        return row_table(rows, columns)


def parameter_column(name: str) -> str:
    """Return the column name of a parameter in the table."""
    return f"parameter_{column_name(name)}"


def _suggest(trial: Any, name: str, parameter: ParameterConfig) -> None:
    if parameter.levels is not None:
        trial.suggest_categorical(name, list(parameter.factor.levels))
        return
    low, high = parameter.low, parameter.high
    assert low is not None and high is not None
    if parameter.whole:
        step = 1 if parameter.log else round(parameter.spacing)
        trial.suggest_int(name, round(low), round(high), log=parameter.log, step=step)
    elif parameter.log:
        trial.suggest_float(name, low, high, log=True)
    else:
        # Optuna wants an end that steps reach.
        steps = int((high - low) / parameter.spacing + 1e-9)
        end = parameter.rounded(low + steps * parameter.spacing)
        trial.suggest_float(name, low, end, step=parameter.spacing)


def _sampler(optuna: Any, search: OptimiseConfig, seed: Sequence[int]) -> Any:
    samplers = optuna.samplers
    own = int(np.random.SeedSequence(seed).generate_state(1)[0])
    match search.sampler:
        case "tpe":  # what is asked together lies apart (constant_liar)
            return samplers.TPESampler(seed=own, multivariate=True, constant_liar=True)
        case "gp":
            return samplers.GPSampler(seed=own, deterministic_objective=False)
        case "nsga2":
            # Several generations even of the few trials that rounds of minutes allow; not by how
            # many trials there are, so that more of them go on with the same ones.
            size = max(8, 2 * search.at_once)
            return samplers.NSGAIISampler(seed=own, population_size=size)
    return samplers.RandomSampler(seed=own)


def _range_of(measure: Measure) -> tuple[float, float]:
    """Return the possible range of a measure, as far as its unit or kind defines it."""
    if measure.rate_with is not None:
        return 0.0, 1.0
    match = re.fullmatch(r"(\d+)-(\d+)", measure.unit)
    return (float(match[1]), float(match[2])) if match else (-np.inf, np.inf)
