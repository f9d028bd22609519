"""Runs a study: what is not done yet, then its tables and comparisons."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sim2vr_harness.base.cores import available
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.file_lock import sole_training
from sim2vr_harness.base.files import read_json, write_atomically
from sim2vr_harness.base.notices import notice_once
from sim2vr_harness.base.signals import sigterm_interrupts
from sim2vr_harness.evaluation.expectations import Planned
from sim2vr_harness.studies.config import StudyConfig, content_hash, load_study, parse_study
from sim2vr_harness.studies.data import (
    STATISTICS_FILE,
    STUDY_FILE,
    StudyData,
    open_study,
    write_data,
)
from sim2vr_harness.studies.jobs import CELLS, HASHES, Task
from sim2vr_harness.studies.plan import StudyPlan, plan_of
from sim2vr_harness.studies.pool import Executor, Here, Pool, Processes, StudyProgress
from sim2vr_harness.studies.search import Found, search
from sim2vr_harness.studies.worker import clear_away

__all__ = ["StudyProgress", "StudyResult", "run_study"]

_STATISTICS = ("scipy", "statsmodels")
"""Packages that compute the statistics."""


@dataclass(frozen=True)
class StudyResult:
    """Result of a study's run.

    Attributes:
        data: The study's tables.
        played: Number of cells and trainings that this run completed.
        found: Number of those that were complete before.
    """

    data: StudyData
    played: int
    found: int


def run_study(
    study: StudyConfig | Mapping[str, Any] | str | Path,
    out: str | Path | None = None,
    *,
    jobs: int | None = None,
    ray: str | None = None,
    storage: str | None = None,
    trust_app: bool = False,
    replay_damaged: bool = False,
    on_progress: Callable[[StudyProgress], None] = lambda progress: None,
    make_pool: Callable[[Path, int], Pool] | None = None,
    on_plan: Callable[[Planned], None] | None = None,
) -> StudyResult:
    """Run a study, or go on with it: what is done is not done again.

    Args:
        study: The study, its YAML file, or the contents of one.
        out: Its folder; None: ``studies/NAME``.
        jobs: Cells and trainings at a time; None: one per two cores, at least two.
        ray: Address of a Ray cluster that does them instead, or ``auto``.
        storage: With ``ray``: where workers leave results that do not see the study's folder.
        trust_app: Whether programs and Python that its files name may run without having run here.
        replay_damaged: Whether finished cells whose files have changed are played again; else they
            are refused.
        on_progress: Called after every task.
        make_pool: Workers by folder and number of tasks at once; None: local processes.
        on_plan: Called with cells and measures before anything is played; not of a search.

    Raises:
        InputError: Something of the study cannot be used (nothing is played then), it names code
            that this user has not agreed to run, a file of a finished cell has changed, or cells
            failed (the others are kept).
    """
    study, beside = _read(study)
    if storage is not None and ray is None:
        raise InputError("--storage", "it without --ray", "it together with --ray")
    root = Path(out) if out is not None else Path("studies") / study.name
    make = make_pool or partial(_pool, jobs=_jobs(jobs), ray=ray, storage=storage)
    _require_own(root, study)
    plan = _planned(study, beside, on_plan, trust_app=trust_app)
    if study.comparisons and find_spec("statsmodels") is None:
        expected = "it: pip install 'sim2vr-harness[studies]'"
        raise InputError("comparisons", "no statsmodels in this installation", expected)
    (root / CELLS).mkdir(parents=True, exist_ok=True)
    with sole_training(root, root / ".lock", "study"), sigterm_interrupts():
        clear_away(root)
        with Executor(root, make, on_progress, replay_damaged=replay_damaged) as doing:
            plan, found = _done(study, plan, beside, doing, trust_app=trust_app)
        clear_away(root)  # what machines left that were lost on the way
        write_data(plan, root, found)
        from sim2vr_harness.studies.comparisons import compare_all, summaries

        data = open_study(root)
        compare_found = {
            "summaries": summaries(data, plan.measures),
            "results": compare_all(data, plan.measures),
            "versions": {
                name: version(name) for name in _STATISTICS if find_spec(name) is not None
            },
        }
        text = json.dumps(compare_found | {HASHES: content_hash(compare_found)}, indent=2)
        write_atomically(root / STATISTICS_FILE, (text + "\n").encode())
    return StudyResult(open_study(root), doing.played, doing.found)


def _read(
    study: StudyConfig | Mapping[str, Any] | str | Path,
) -> tuple[StudyConfig, Path | None]:
    """Return a study and the folder of its file; None: it is not from a file."""
    if isinstance(study, (str, Path)):
        return load_study(study), Path(study).parent
    return (study if isinstance(study, StudyConfig) else parse_study(study)), None


def _planned(
    study: StudyConfig,
    beside: Path | None,
    on_plan: Callable[[Planned], None] | None,
    *,
    trust_app: bool,
) -> StudyPlan | None:
    """Plan a study, and say which cells are the same; None of a search, which plans as it goes."""
    if study.optimise is not None:
        if on_plan is not None:
            raise InputError("--expect, --against", "a study with optimise", "one with factors")
        return None
    plan = plan_of(study, folder=beside, trust_app=trust_app)
    for names in plan.alike:
        notice_once(
            f"note: cells {', '.join(names[:-1])} and {names[-1]} are the same: they have the "
            "same user, configuration and seeds, so their rounds are the same"
        )
    if on_plan is not None:
        on_plan(plan.planned)
    return plan


def _done(
    study: StudyConfig,
    plan: StudyPlan | None,
    beside: Path | None,
    doing: Executor,
    *,
    trust_app: bool,
) -> tuple[StudyPlan, Found | None]:
    """Do a plan, or a search without one; return the plan, and what the search found."""
    if plan is None:
        assert study.optimise is not None  # a study without it has a plan
        found = search(study, study.optimise, beside, doing, trust_app=trust_app)
        return found.plan, found
    tasks: list[Task] = [*plan.trainings, *plan.tasks]
    doing.expect(len({task.key for task in tasks}))
    doing.do(tasks)
    return plan, None


def _pool(root: Path, tasks: int, *, jobs: int, ray: str | None, storage: str | None) -> Pool:
    """Return the pool of workers for this number of parallel tasks."""
    if ray is not None:
        from sim2vr_harness.studies.cluster import OnRay

        return OnRay(root, ray, 1, storage=storage)
    count = min(jobs, tasks)
    if count == 1:
        return Here(root, available())
    return Processes(root, count, max(1, available() // count))


def _jobs(jobs: int | None) -> int:
    if jobs is None:
        return max(min(2, available()), available() // 2)
    if not 1 <= jobs <= 1024:
        raise InputError("--jobs", str(jobs), "1 to 1024")
    return jobs


def _require_own(root: Path, study: StudyConfig) -> None:
    """Refuse the folder of another study, and of something else."""
    if (root / STUDY_FILE).is_file():
        there = read_json(root / STUDY_FILE, "a study's, or another --out").get("study")
        name = there.get("name") if isinstance(there, dict) else None
        if name != study.name:
            expected = f"another folder for {study.name!r}"
            raise InputError("--out", f"{str(root)!r}, which has the study {name!r}", expected)
    elif root.is_dir() and not (root / CELLS).is_dir() and any(root.iterdir()):
        raise InputError("--out", f"{str(root)!r}, which has other files", "a folder of its own")
