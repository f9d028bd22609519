"""Studies: factors, cells, comparisons; played on a pool of processes, kept, and put to tests.

Workers import their own modules only: what stands here is loaded when someone asks.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim2vr_harness.studies.config import StudyConfig, load_study
    from sim2vr_harness.studies.data import StudyData, read_study
    from sim2vr_harness.studies.runner import StudyResult, run_study

__all__ = ["StudyConfig", "StudyData", "StudyResult", "load_study", "read_study", "run_study"]

_LAZY = {
    "StudyConfig": "config",
    "StudyData": "data",
    "StudyResult": "runner",
    "load_study": "config",
    "read_study": "data",
    "run_study": "runner",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
