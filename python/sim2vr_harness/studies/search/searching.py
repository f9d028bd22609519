"""Runs a search: batch after batch is chosen, played and told."""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.files import read_json
from sim2vr_harness.base.optional import needed
from sim2vr_harness.client import Measure
from sim2vr_harness.evaluation.data.folder import FOLDER, read_table
from sim2vr_harness.runs.config import parse_config
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.studies.config import StudyConfig
from sim2vr_harness.studies.executor import Executor
from sim2vr_harness.studies.factors import FactorConfig
from sim2vr_harness.studies.jobs import CELLS, TRAININGS, CellTask
from sim2vr_harness.studies.plan import StudyPlan, plan_of
from sim2vr_harness.studies.policy_selection import Users
from sim2vr_harness.studies.search.config import OptimiseConfig, ParameterConfig, Value
from sim2vr_harness.studies.search.stopping import limits_of, reports_of
from sim2vr_harness.studies.search.trials import Trial, chosen, judged

_CONSTRAINTS = "constraints"


class Optimiser:
    """Chooses the parameters of trials from what earlier ones gave.

    Args:
        search: What is searched for.
        seed: Of its choices.

    Raises:
        InputError: Optuna is not installed.
    """

    def __init__(self, search: OptimiseConfig, seed: int) -> None:
        optuna = needed("optuna", "studies", "optimise")
        self._optuna, self._search = optuna, search
        self._space = {
            name: _distribution(optuna, parameter) for name, parameter in search.parameters.items()
        }
        directions = {"min": "minimize", "max": "maximize"}
        with _quiet(optuna):
            self._study = optuna.create_study(
                directions=[directions[way] for way in search.objectives.values()],
                sampler=_sampler(optuna, search, seed),
            )
        for values in search.begin:
            self._study.enqueue_trial(
                {name: search.parameters[name].check(name, value) for name, value in values.items()}
            )
        self._asked: list[Any] = []

    @property
    def version(self) -> str:
        """Optuna's."""
        return str(self._optuna.__version__)

    def ask(self, count: int) -> list[dict[str, Value]]:
        """Return the parameters of the next trials, chosen together."""
        with _quiet(self._optuna):
            asked = [self._study.ask(self._space) for _ in range(count)]
        self._asked = asked
        return [self._values(trial.params) for trial in asked]

    def _values(self, params: Mapping[str, Any]) -> dict[str, Value]:
        parameters = self._search.parameters
        return {
            name: params[name] if parameters[name].levels else parameters[name].rounded(value)
            for name, value in params.items()
        }

    def tell(self, trials: Sequence[Trial]) -> None:
        """Say what came of the trials of the last :meth:`ask`, in their order."""
        states = self._optuna.trial.TrialState
        with _quiet(self._optuna):
            for asked, trial in zip(self._asked, trials, strict=True):
                if trial.state == "measured":
                    asked.set_user_attr(_CONSTRAINTS, list(trial.violations))
                    self._study.tell(asked, [trial.measures[m] for m in self._search.objectives])
                elif trial.state == "stopped" and trial.reports:
                    asked.set_user_attr(_CONSTRAINTS, [])
                    step, value = trial.reports[-1]
                    # A report with the sign that makes it good where the objective is.
                    assert self._search.stop is not None
                    (way,) = self._search.objectives.values()
                    same = (way == "max") == (self._search.stop.better == "higher")
                    as_objective = value if same else -value
                    asked.report(as_objective, step)
                    self._study.tell(asked, state=states.PRUNED)
                else:
                    self._study.tell(asked, state=states.FAIL)


class _quiet:
    """Optuna tells of each trial on the standard error stream, and warns of what is new in it."""

    def __init__(self, optuna: Any) -> None:
        self._logging = optuna.logging
        self._warnings = warnings.catch_warnings()

    def __enter__(self) -> None:
        self._before = self._logging.get_verbosity()
        self._logging.set_verbosity(self._logging.ERROR)
        self._warnings.__enter__()
        warnings.simplefilter("ignore")

    def __exit__(self, *exception: Any) -> None:
        self._warnings.__exit__(*exception)
        self._logging.set_verbosity(self._before)


def _distribution(optuna: Any, parameter: ParameterConfig) -> Any:
    kinds = optuna.distributions
    if parameter.levels is not None:
        return kinds.CategoricalDistribution(list(parameter.factor.levels))
    low, high = parameter.low, parameter.high
    assert low is not None and high is not None
    if parameter.whole:
        step = 1 if parameter.log else round(parameter.spacing)
        return kinds.IntDistribution(round(low), round(high), log=parameter.log, step=step)
    if parameter.log:
        return kinds.FloatDistribution(low, high, log=True)
    # Optuna wants an end that steps reach.
    steps = int((high - low) / parameter.spacing + 1e-9)
    return kinds.FloatDistribution(
        low, parameter.rounded(low + steps * parameter.spacing), step=parameter.spacing
    )


def _sampler(optuna: Any, search: OptimiseConfig, seed: int) -> Any:
    def constraints(trial: Any) -> Sequence[float]:
        return list(trial.user_attrs[_CONSTRAINTS])

    known = constraints if search.constraints else None
    samplers = optuna.samplers
    make: dict[str, Callable[[], Any]] = {
        # What is asked together lies apart (constant_liar).
        "tpe": lambda: samplers.TPESampler(
            seed=seed, multivariate=True, constant_liar=True, constraints_func=known
        ),
        "gp": lambda: samplers.GPSampler(
            seed=seed, deterministic_objective=False, constraints_func=known
        ),
        # Several generations even of the few trials that rounds of minutes allow; not by how many
        # trials there are, so that more of them go on with the same ones.
        "nsga2": lambda: samplers.NSGAIISampler(
            seed=seed, population_size=max(8, 2 * search.at_once), constraints_func=known
        ),
        "random": lambda: samplers.RandomSampler(seed=seed),
    }
    return make[search.sampler]()


TRIAL = "trial"
"""The factor of a search's tables: its levels are the numbers of the trials."""
_EXPECTED = "what a training of this study wrote"


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes:
        search: What was searched for.
        plan: The study that it became: a cell for each trial that was played.
        trials: All of them, in order.
        sampler: Who chose, with its version.
    """

    search: OptimiseConfig
    plan: StudyPlan
    trials: tuple[Trial, ...]
    sampler: str


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
        self._trust_app = trust_app
        self._study, self._wanted, self._folder, self._doing = study, wanted, folder, doing
        self._users = Users(code=trust_app)
        self._optimiser = Optimiser(wanted, study.seed)
        self._trials: list[Trial] = []
        self._plans: list[StudyPlan] = []

    def run(self) -> Found:
        wanted = self._wanted
        trained = self._probe()
        self._doing.expect(wanted.trials * (2 if trained else 1), wanted.at_once)
        while len(self._trials) < wanted.trials:
            count = min(wanted.at_once, wanted.trials - len(self._trials))
            self._batch(self._optimiser.ask(count))
        if not self._plans:
            expected = "trials whose rounds have the measures that they are judged by"
            raise InputError("optimise", f"{len(self._trials)} trials without a number", expected)
        trials = chosen(wanted, self._trials)
        sampler = f"Optuna {self._optimiser.version} ({wanted.sampler})"
        return Found(wanted, self._whole(), tuple(trials), sampler)

    # --- before anything is played ---------------------------------------------------------------

    def _probe(self) -> bool:
        """Check both ends of every range and all levels; return whether trials are trained."""
        parameters = self._wanted.parameters
        first: dict[str, Value] = {name: p.ends[0] for name, p in parameters.items()}
        plan = None
        for name, parameter in parameters.items():
            levels = {
                value if isinstance(value, str) else f"{value:g}": self._wanted.settings(
                    {**first, name: value}
                )
                for value in parameter.ends
            }
            plan = self._plan(name, levels)
        assert plan is not None
        known = plan.known
        self._check_measures(known)
        for training in plan.trainings:
            stop = self._wanted.stop
            import yaml

            config_of = parse_config(yaml.safe_load(training.config))
            total = config_of.total_timesteps
            if stop is not None and stop.at[-1] >= total:
                got = f"{stop.at[-1]} with a training of {total} user steps"
                raise InputError("optimise.stop.at", got, f"steps below {total}")
        return bool(plan.trainings)

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

    # --- a batch ---------------------------------------------------------------------------------

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

    def _batch(self, asked: Sequence[Mapping[str, Value]]) -> None:
        first = len(self._trials) + 1
        values = {first + k: dict(one) for k, one in enumerate(asked)}
        stop = self._wanted.stop
        plan = self._plan(
            TRIAL,
            {str(number): self._wanted.settings(one) for number, one in values.items()},
            limits=None if stop is None else limits_of(stop, self._trials),
            may_diverge=True,
        )
        self._doing.do(plan.trainings)
        reports = [self._reports(task) for task in plan.tasks]
        stopped = [self._stopped(task) for task in plan.tasks]
        played = [task for task, end in zip(plan.tasks, stopped, strict=True) if not end]
        self._doing.forgo(len({t.key for t in plan.tasks}) - len({t.key for t in played}))
        self._doing.do(played)
        found = []
        for (number, one), task, report, end in zip(
            values.items(), plan.tasks, reports, stopped, strict=True
        ):
            if end:
                nothing = dict.fromkeys(self._wanted.measures)
                found.append(Trial(number, one, nothing, (), "stopped", report))
            else:
                # Means over players of means over their rounds, of those whose app did not fail.
                table = read_table(
                    self._doing.root / CELLS / task.key / FOLDER / "episodes.parquet"
                )
                rows = table.to_pandas()
                rows = rows[rows["ended"] != "app_failed"]
                measured_found: dict[str, float | None] = {}
                for name in self._wanted.measures:
                    measured_found[name] = None
                    if name in rows:
                        people = rows["person"].fillna(-1)
                        mean = float(rows.groupby(people)[name].mean().mean())
                        measured_found[name] = mean if np.isfinite(mean) else None
                measures = measured_found
                found.append(judged(self._wanted, number, one, measures, report))
        self._optimiser.tell(found)
        self._trials += found
        if played:
            keep = [k for k, end in enumerate(stopped) if not end]
            self._plans.append(
                replace(
                    plan,
                    cells=tuple(plan.cells[k] for k in keep),
                    tasks=tuple(plan.tasks[k] for k in keep),
                )
            )

    def _reports(self, task: CellTask) -> list[tuple[int, float]]:
        stop = self._wanted.stop
        if stop is None or task.training is None:
            return []
        rows = RunFolder(self._doing.root / TRAININGS / task.training).metrics()
        known = sorted({key for row in rows for key in row} - {"step", "time"})
        if rows and stop.report not in known:
            raise unknown_name("optimise.stop.report", stop.report, known)
        return list(reports_of(rows, stop).items())

    def _stopped(self, task: CellTask) -> bool:
        if task.training is None:
            return False
        mark = self._doing.root / TRAININGS / task.training / "trained.json"
        return "stopped_at" in read_json(mark, _EXPECTED)

    # --- all of it -------------------------------------------------------------------------------

    def _whole(self) -> StudyPlan:
        cells = tuple(cell for plan in self._plans for cell in plan.cells)
        first = self._plans[0]
        study = self._as_study(
            TRIAL,
            {
                cell.levels[TRIAL]: self._wanted.settings(
                    self._trials[int(cell.levels[TRIAL]) - 1].values
                )
                for cell in cells
            },
        )
        trainings = {task.key: task for plan in self._plans for task in plan.trainings}
        measures = [*self._wanted.measures]
        measures += [name for name in first.measures if name not in measures]
        return StudyPlan(
            study,
            cells,
            tuple(task for plan in self._plans for task in plan.tasks),
            tuple(trainings.values()),
            first.facts,
            tuple(measures),
            first.known,
        )


def _range_of(measure: Measure) -> tuple[float, float]:
    """What a measure can be, as far as its unit or its kind says it."""
    if measure.rate_with is not None:
        return 0.0, 1.0
    match = re.fullmatch(r"(\d+)-(\d+)", measure.unit)
    return (float(match[1]), float(match[2])) if match else (-np.inf, np.inf)
