"""Studies: factors, cells, comparisons; played on a pool of processes, kept, and put to tests."""

from sim2vr_harness.studies.config import StudyConfig, load_study
from sim2vr_harness.studies.data import StudyData, read_study
from sim2vr_harness.studies.runner import StudyResult, run_study

__all__ = ["StudyConfig", "StudyData", "StudyResult", "load_study", "read_study", "run_study"]
