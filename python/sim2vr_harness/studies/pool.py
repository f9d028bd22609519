"""Processes of this machine that do a study's tasks, any of which may die."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol

from sim2vr_harness.base.errors import InputError, reason
from sim2vr_harness.studies.jobs import (
    TRAININGS,
    CellTask,
    Task,
    folder_of,
    is_done,
    require_whole_cell,
)

Work = Callable[[Task, Path, int], None]
"""Task, the study's folder, cores."""

_ATTEMPTS = 3
"""Workers that may die of one task before it is given up."""
_GRACE_S = 30.0
"""For trainings to save when a study is stopped."""


@dataclass(frozen=True)
class Done:
    """A task that has ended.

    Attributes:
        error: Why it failed, in a line; None: it did not.
    """

    task: Task
    error: str | None = None


class Pool(Protocol):
    """Does tasks, in whatever order."""

    def submit(self, task: Task) -> None:
        """Take a task."""

    def next(self) -> Done:
        """Wait for one of those that were submitted."""

    def close(self) -> None:
        """Stop whatever is being done; idempotent."""


class Here:
    """This process, one task after the other, when someone waits for it."""

    def __init__(self, root: Path, cores: int) -> None:
        self._root, self._cores = root, cores
        self._tasks: deque[Task] = deque()

    def submit(self, task: Task) -> None:
        self._tasks.append(task)

    def next(self) -> Done:
        return done_by(self._tasks.popleft(), self._root, self._cores)

    def close(self) -> None:
        self._tasks.clear()


def play_or_train(task: Task, root: Path, cores: int) -> None:
    """Do a task as it is meant, see :func:`sim2vr_harness.studies.worker.do`."""
    from sim2vr_harness.studies.worker import do  # loads all that plays and learns

    do(task, root, cores)


def done_by(task: Task, root: Path, cores: int, work: Work = play_or_train) -> Done:
    """Do a task, whatever comes of it."""
    try:
        work(task, root, cores)
    except Exception as error:
        return Done(task, in_a_line(error))
    return Done(task)


def in_a_line(error: BaseException) -> str:
    """Return an error as one line, for a report over several tasks."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {reason(error)}"
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"


class _Worker:
    """A process and the task that it has."""

    def __init__(self, root: Path, cores: int, work: Work) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process: Any = context.Process(
            target=_serve, args=(theirs, str(root), cores, work), daemon=False
        )
        self.process.start()
        theirs.close()
        self.task: Task | None = None


def _serve(pipe: Connection, root: str, cores: int, work: Work) -> None:
    """Run a worker until the study ends or its connection closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the study's, which tells its workers
    threading.Thread(target=_end_with_the_study, daemon=True).start()
    with suppress(EOFError, OSError):
        while (task := pipe.recv()) is not None:
            pipe.send(done_by(task, Path(root), cores, work))
    os._exit(0)  # threads of renderers and of torch are not waited for


def _end_with_the_study() -> None:
    """Stop this worker when the study was killed: it would hold its training's lock for hours."""
    study = multiprocessing.parent_process()
    assert study is not None  # this is a worker
    study.join()
    os.kill(os.getpid(), signal.SIGTERM)  # a training saves
    time.sleep(_GRACE_S)
    os._exit(1)


class Processes:
    """A fixed number of processes; a task whose process dies is done again in another one.

    Args:
        root: The study's folder.
        count: How many.
        cores: How many each uses.
        work: What they do with a task; it must not depend on anything but its arguments.
    """

    def __init__(self, root: Path, count: int, cores: int, work: Work = play_or_train) -> None:
        self._root, self._count, self._cores, self._work = root, count, cores, work
        self._workers: list[_Worker] = []
        self._tasks: deque[Task] = deque()
        self._deaths: dict[str, int] = {}

    def submit(self, task: Task) -> None:
        self._tasks.append(task)
        self._assign()

    def _assign(self) -> None:
        for worker in self._workers:
            if self._tasks and worker.task is None:
                self._give(worker)
        while self._tasks and len(self._workers) < self._count:
            self._workers.append(_Worker(self._root, self._cores, self._work))
            self._give(self._workers[-1])

    def _give(self, worker: _Worker) -> None:
        worker.task = self._tasks.popleft()
        with suppress(OSError):  # it is dead, which `next` finds out
            worker.pipe.send(worker.task)

    def next(self) -> Done:
        while True:
            self._assign()
            busy = {worker.pipe: worker for worker in self._workers if worker.task is not None}
            ready = wait([*busy, *(worker.process.sentinel for worker in busy.values())])
            for worker in busy.values():
                if worker.pipe in ready or worker.process.sentinel in ready:
                    done = self._take(worker)
                    if done is not None:
                        return done

    def _take(self, worker: _Worker) -> Done | None:
        task = worker.task
        assert task is not None
        with suppress(EOFError, OSError):
            if worker.pipe.poll():
                done: Done = worker.pipe.recv()
                worker.task = None
                return done
        worker.process.join()
        self._workers.remove(worker)
        deaths = self._deaths[task.key] = self._deaths.get(task.key, 0) + 1
        if deaths >= _ATTEMPTS:
            code = worker.process.exitcode
            return Done(task, f"its process died {deaths} times, at last with exit code {code}")
        self._tasks.appendleft(task)
        return None

    def close(self) -> None:
        for worker in self._workers:
            if worker.task is None:
                with suppress(OSError):
                    worker.pipe.send(None)
            else:
                worker.process.terminate()  # of a training: it saves
        for worker in self._workers:
            worker.process.join(_GRACE_S)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.pipe.close()
        self._workers.clear()
        self._tasks.clear()


# --- the study that they do -------------------------------------------------------------------


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study.

    Attributes:
        done: Number of completed tasks, those of earlier sessions included.
        total: Number of all tasks: trainings and cells.
        label: Label of the task that has just ended; empty at first.
        error: Reason why that task failed; None: it did not fail.
    """

    done: int
    total: int
    label: str = ""
    error: str | None = None


class Executor:
    """A study that is being done; its workers begin when something is left to do.

    Args:
        root: The study's folder.
        make_pool: Who does the tasks, given the folder and how many there are at once.
        on_progress: Told after every task.
        replay_damaged: Whether finished cells whose files have changed are played again; otherwise
            they are an error.
    """

    def __init__(
        self,
        root: Path,
        make_pool: Callable[[Path, int], Pool],
        on_progress: Callable[[StudyProgress], None],
        *,
        replay_damaged: bool = False,
    ) -> None:
        self.root, self._replay_damaged = root, replay_damaged
        self._make_pool, self._on_progress = make_pool, on_progress
        self._pool: Pool | None = None
        self._total, self._at_once = 0, 1
        self._begun = False
        self.played = 0
        """Tasks that were done now."""
        self.found = 0
        """Tasks that were done already."""

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.close()

    def expect(self, total: int, at_once: int = 1) -> None:
        """Say how many tasks there will be, and at least how many of them at once."""
        self._total, self._at_once = total, at_once

    def forgo(self, tasks: int) -> None:
        """Say that so many of them are not needed."""
        self._total -= tasks

    def do(self, tasks: Sequence[Task]) -> None:
        """Do what is left of some tasks; a cell waits for its training.

        Raises:
            InputError: Some failed (the others are kept), or a file of a finished cell has changed.
        """
        wanted = {task.key: task for task in tasks}
        left = [task for task in wanted.values() if not self._is_done(task)]
        found = len(wanted) - len(left)
        self.found += found
        if found or not self._begun:
            self._tell()
        self._begun = True
        if not left:
            return
        if self._pool is None:
            self._pool = self._make_pool(self.root, max(len(left), self._at_once))
        waiting = [work_task for work_task in left if self._waits(work_task)]
        failed: list[Done] = []
        submitted = len(left) - len(waiting)
        for work_task in left:
            if work_task not in waiting:
                self._pool.submit(work_task)
        while submitted:
            ended = self._pool.next()
            submitted -= 1
            if ended.error is None:
                self.played += 1
            else:
                failed.append(ended)
            self._tell(_label(ended.task), ended.error)
            for work_task in [work_task for work_task in waiting if not self._waits(work_task)]:
                waiting.remove(work_task)
                self._pool.submit(work_task)
                submitted += 1
        if failed:
            more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
            kept = f"{self.played + self.found} of {self._total} tasks are kept"
            raise InputError(
                _label(failed[0].task),
                f"{failed[0].error}{more}",
                f"every cell to be played; {kept}, run the study again to go on",
            )

    def _is_done(self, task: Task) -> bool:
        if not is_done(task, self.root):
            return False
        if isinstance(task, CellTask):
            try:
                require_whole_cell(task.cell, folder_of(task, self.root))
            except InputError:
                if not self._replay_damaged:
                    raise
                return False
        return True

    def _tell(self, label: str = "", error: str | None = None) -> None:
        self._on_progress(StudyProgress(self.played + self.found, self._total, label, error))

    def _waits(self, task: Task) -> bool:
        if not isinstance(task, CellTask) or task.training is None:
            return False
        return not (self.root / TRAININGS / task.training / "trained.json").is_file()


def _label(task: Task) -> str:
    return f"cell {task.cell}" if isinstance(task, CellTask) else f"training {task.label}"
