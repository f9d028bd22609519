"""Trials of a search: what was tried, what came of it, and which are the best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from sim2vr_harness.studies.search.config import OptimiseConfig, Value


@dataclass(frozen=True)
class Trial:
    """Parameters, and what came of them.

    Attributes:
        number: From 1, in the order in which they were chosen.
        values: Parameter -> number, or label.
        measures: Of objectives and constraints, means over players of means over their rounds;
            None where no round has one.
        violations: By how much it is beyond each limit; 0 or less: it keeps it.
        state: ``measured``; ``stopped``: its training was, early; ``unmeasured``: no round has the
            numbers that it is judged by.
        reports: User step and number of the training's reports that it was compared by.
        chosen: Whether it is the best, or one of the best compromises.
    """

    number: int
    values: Mapping[str, Value]
    measures: Mapping[str, float | None]
    violations: Sequence[float] = ()
    state: Literal["measured", "stopped", "unmeasured"] = "measured"
    reports: Sequence[tuple[int, float]] = ()
    chosen: bool = False

    @property
    def keeps(self) -> bool:
        """Whether it was measured and keeps all limits."""
        return self.state == "measured" and all(beyond <= 0.0 for beyond in self.violations)

    @property
    def label(self) -> str:
        """The level of the factor ``trial`` that it is in the study's tables."""
        return str(self.number)


def judged(
    search: OptimiseConfig,
    number: int,
    values: Mapping[str, Value],
    measures: Mapping[str, float | None],
    reports: Sequence[tuple[int, float]] = (),
) -> Trial:
    """Return a trial that was played."""
    trial = Trial(number, values, measures, reports=reports)
    if any(measures[name] is None for name in search.measures):
        return replace(trial, state="unmeasured")
    beyond: list[float] = []
    for name, limits in search.constraints.items():
        value = measures[name]
        assert value is not None
        beyond += limits.violations(value)
    return replace(trial, violations=tuple(beyond))


def chosen(search: OptimiseConfig, trials: Sequence[Trial]) -> list[Trial]:
    """Return all trials with the best of those that keep the limits marked.

    With one objective that is the first of the best; with several all that no other is better than
    in one and at least as good as in all.
    """
    kept = [trial for trial in trials if trial.keeps]
    costs = {trial.number: _costs(search, trial) for trial in kept}
    best = [trial for trial in kept if not _is_beaten(trial, costs)]
    if len(search.objectives) == 1:
        best = best[:1]
    numbers = {trial.number for trial in best}
    return [replace(trial, chosen=trial.number in numbers) for trial in trials]


def _costs(search: OptimiseConfig, trial: Trial) -> tuple[float, ...]:
    found: list[float] = []
    for name, way in search.objectives.items():
        value: Any = trial.measures[name]
        found.append(value if way == "min" else -value)
    return tuple(found)


def _is_beaten(trial: Trial, costs: Mapping[int, tuple[float, ...]]) -> bool:
    own = costs[trial.number]
    return any(
        all(a <= b for a, b in zip(other, own, strict=True)) and other != own
        for other in costs.values()
    )
