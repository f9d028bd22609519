"""Tidy tables of evaluations: episodes, events, steps and frames."""

from sim2vr_harness.evaluation.data.columns import Column
from sim2vr_harness.evaluation.data.folder import DataFolder, EvaluationData, read_data
from sim2vr_harness.evaluation.data.opensim import export_opensim
from sim2vr_harness.evaluation.data.sessions import session_of_steps

__all__ = [
    "Column",
    "DataFolder",
    "EvaluationData",
    "export_opensim",
    "read_data",
    "session_of_steps",
]
