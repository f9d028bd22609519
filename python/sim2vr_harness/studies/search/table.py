"""The table ``trials`` of a search."""

import json
from typing import Any

import pyarrow as pa

from sim2vr_harness.client import Measure
from sim2vr_harness.evaluation.data import Column
from sim2vr_harness.evaluation.data.columns import column_name, row_table
from sim2vr_harness.studies.search.config import ParameterConfig
from sim2vr_harness.studies.search.searching import TRIAL, Found


def parameter_column(name: str) -> str:
    """What a parameter is called in the table."""
    return f"parameter_{column_name(name)}"


def trials_table(found: Found) -> pa.Table:
    """Return a row per trial."""
    wanted = found.search
    known = {measure.name: measure for measure in found.plan.known}
    columns = [
        Column("trial", "integer", "", "Number of the trial; a key"),
        Column("design_cell", "text", "", "Its cell; none where its training was stopped"),
        *(_parameter(name, parameter) for name, parameter in wanted.parameters.items()),
        *(_measure(known[name]) for name in wanted.measures),
        Column("state", "text", "", "measured, stopped (its training) or unmeasured"),
        Column("keeps_limits", "boolean", "", "Whether it was measured and keeps all constraints"),
        Column("chosen", "boolean", "", "Whether it is the best, or one of the best compromises"),
        Column("reported", "text", "", "JSON object: step of the training -> best report so far"),
    ]
    return row_table([_row(found, k) for k in range(len(found.trials))], columns)


def _row(found: Found, k: int) -> dict[str, Any]:
    trial = found.trials[k]
    cell = f"{TRIAL}={trial.label}" if trial.state != "stopped" else None
    return {
        "trial": trial.number,
        "design_cell": cell,
        **{parameter_column(name): value for name, value in trial.values.items()},
        **trial.measures,
        "state": trial.state,
        "keeps_limits": trial.keeps,
        "chosen": trial.chosen,
        "reported": json.dumps(dict(trial.reports)) if trial.reports else None,
    }


def _parameter(name: str, parameter: ParameterConfig) -> Column:
    kind: Any = "text" if parameter.levels is not None else "number"
    what = f"Sets {parameter.key}" if parameter.key else "Level that sets several keys"
    return Column(parameter_column(name), kind, "", what)


def _measure(measure: Measure) -> Column:
    what = f"{measure.label}, mean over players and their rounds"
    return Column(measure.name, "number", measure.unit, what)
