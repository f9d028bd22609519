"""Worker of a study: runs one task at a time, on any machine."""

import io
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.finite import NotFinite
from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.evaluation.request import Request
from sim2vr_harness.runs.config import parse_config
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.runs.trust import answered
from sim2vr_harness.studies.jobs import (
    CELLS,
    HASHES,
    TRAININGS,
    CellTask,
    Task,
    TrainingTask,
    folder_of,
    hashes_of,
    mark_of,
)
from sim2vr_harness.studies.search import Watch
from sim2vr_harness.training.run import trainer


def do(task: Task, root: Path, cores: int) -> None:
    """Do a task; its folder appears when it is done, or, of a training, is gone on with.

    Args:
        task: What to do.
        root: The study's folder.
        cores: How many to use.

    Raises:
        InputError: Something cannot be used.
        OSError: Something cannot be written; names the file.
    """
    if isinstance(task, CellTask):
        _play(task, root, cores)
    else:
        _train(task, root, cores)


def _play(task: CellTask, root: Path, cores: int) -> None:
    place = folder_of(task, root)
    working = place.with_name(f".{task.key}.{os.getpid()}.part")
    shutil.rmtree(working, ignore_errors=True)
    user = task.user
    if user is None:
        assert task.training is not None
        user = str(root / TRAININGS / task.training)
    answered(task.env)
    request = Request(
        conditions=[task.condition],
        episodes=task.episodes,
        seed=task.seed,
        people=task.people,
        deterministic=task.deterministic,
        steps=task.steps,
        log=task.logs,
        record=task.film_seconds > 0.0,
        film_seconds=task.film_seconds,
        out=working,
        overrides=task.overrides,
        trust_app=task.trust_app,
        cores=cores,
    )
    try:
        evaluate(user, request)
        about = {**asdict(task), "overrides": list(task.overrides)}
        about.pop("cell")  # the study's name for it, which may change
        del about["env"], about["trust_app"]
        about[HASHES] = hashes_of(working)
        write_atomically(working / mark_of(task), (json.dumps(about, indent=2) + "\n").encode())
        shutil.rmtree(place, ignore_errors=True)
        working.rename(place)
    finally:
        shutil.rmtree(working, ignore_errors=True)


def _train(task: TrainingTask, root: Path, cores: int) -> None:
    import yaml

    place = folder_of(task, root)
    config = parse_config(yaml.safe_load(task.config))
    answered(config.env)  # when the study was planned
    cored = config.model_copy(update={"env": config.env.model_copy(update={"cores": cores})})
    console = Console(file=io.StringIO())
    folder = RunFolder(place)
    watch = Watch(task.pruning, folder.metrics()) if task.pruning is not None else None
    try:
        result = trainer.train(
            cored,
            place,
            resume=folder.exists,
            console=console,
            report=None if watch is None else watch.report,
            stop=None if watch is None else watch.stop,
        )
    except NotFinite as error:
        if not task.may_diverge:
            raise
        _mark(task, place, {"checkpoint": None, "stopped_at": folder.step, "reason": str(error)})
        return
    stopped_at = None if watch is None else watch.stopped_at
    if result.checkpoint is None or (result.interrupted and stopped_at is None):
        got = f"a training that was stopped in stage {result.stage!r}"
        raise InputError(f"training {task.label}", got, "the study to be run again")
    mark: dict[str, Any] = {"checkpoint": result.checkpoint.name}
    if stopped_at is not None:
        mark["stopped_at"] = stopped_at
    _mark(task, place, mark)


def _mark(task: TrainingTask, place: Path, mark: Mapping[str, Any]) -> None:
    """Say that a training is done, and what came of it."""
    write_atomically(place / mark_of(task), (json.dumps(mark) + "\n").encode())


def clear_away(root: Path) -> None:
    """Remove what killed workers were playing; trainings go on from what they saved."""
    for left in (root / CELLS).glob(".*.part"):
        shutil.rmtree(left, ignore_errors=True)
