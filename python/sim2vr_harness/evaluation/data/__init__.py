"""Tidy tables of evaluations: episodes, events, steps and frames."""

from sim2vr_harness.evaluation.data.columns import Column
from sim2vr_harness.evaluation.data.folder import DataFolder, EvaluationData, read_data
from sim2vr_harness.evaluation.data.opensim import export_opensim

__all__ = ["Column", "DataFolder", "EvaluationData", "export_opensim", "read_data"]
