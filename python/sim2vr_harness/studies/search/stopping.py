"""Trainings of a search that are stopped early, by what earlier ones reported at the same step.

As Google Vizier's and Optuna's median rules, but a training is compared with trials of earlier
batches only: they are over when it begins, so that no one has to wait, workers need not hear of
each other, and the result does not depend on who was how fast.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim2vr_harness.studies.jobs import Limits
from sim2vr_harness.studies.search.config import StopConfig
from sim2vr_harness.studies.search.trials import Trial


def reports_of(rows: Sequence[Mapping[str, Any]], stop: StopConfig | Limits) -> dict[int, float]:
    """Return the best report so far at each step that is judged and was reached.

    Args:
        rows: Of metrics.jsonl.
        stop: Which steps, and which report.
    """
    found: dict[int, float] = {}
    best = None
    steps = list(stop.at)
    for row in rows:
        value = row.get(stop.report)
        if isinstance(value, (int, float)):
            better = max if stop.better == "higher" else min
            best = float(value) if best is None else better(best, float(value))
        while steps and row.get("step", 0) >= steps[0]:
            step = steps.pop(0)
            if best is not None:
                found[step] = best
    return found


def limits_of(stop: StopConfig, earlier: Sequence[Trial]) -> Limits | None:
    """Return what a training must have reached at which steps, or None: anything will do.

    Args:
        stop: When and by what.
        earlier: Trials that are over.
    """
    limits: list[tuple[int, float]] = []
    for step in stop.at:
        values = [dict(trial.reports)[step] for trial in earlier if step in dict(trial.reports)]
        if len(values) >= stop.earlier:
            share = 1.0 - stop.keep if stop.better == "higher" else stop.keep
            limits.append((step, float(np.quantile(values, share))))
    return Limits(stop.report, stop.better, tuple(limits)) if limits else None


class Watch:
    """Follows a training and says when it has to stop.

    Args:
        limits: What it must have reached.
        rows: What it reported before this session.
    """

    def __init__(self, limits: Limits, rows: Sequence[Mapping[str, Any]]) -> None:
        self._limits, self._rows = limits, [dict(row) for row in rows]
        self.stopped_at: int | None = None
        self._judge()

    def report(self, report: Any) -> None:
        """Take in a report of the training; those of stages before the last do not count."""
        if report.number == report.stages:
            self._rows.append({**report.values, "step": int(report.done)})
            self._judge()

    def _judge(self) -> None:
        found = reports_of(self._rows, self._limits)
        for step, limit in self._limits.limits:
            behind = step in found and (
                found[step] < limit if self._limits.better == "higher" else found[step] > limit
            )
            if behind and self.stopped_at is None:
                self.stopped_at = step

    def stop(self) -> bool:
        """Whether it has to."""
        return self.stopped_at is not None
