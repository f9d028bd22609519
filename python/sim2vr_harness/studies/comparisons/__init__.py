"""Comparisons of a study's conditions; n counts persons or trainings, never rounds of one user."""

from sim2vr_harness.studies.comparisons.comparing import compare, compare_all
from sim2vr_harness.studies.comparisons.sample_size import (
    SampleSize,
    sample_sizes,
    wanted_differences,
)
from sim2vr_harness.studies.comparisons.summaries import summaries

__all__ = [
    "SampleSize",
    "compare",
    "compare_all",
    "sample_sizes",
    "summaries",
    "wanted_differences",
]
