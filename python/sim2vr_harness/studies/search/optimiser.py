"""Optuna, requested one batch of trials after another: the same answers to the same results.

The state of its samplers is rebuilt by asking and telling again from the first trial on, which
costs milliseconds beside what is played, and needs no file that a kill could spoil.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from sim2vr_harness.base.optional import needed
from sim2vr_harness.studies.search.config import OptimiseConfig, ParameterConfig, Value
from sim2vr_harness.studies.search.trials import Trial

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
