"""Does a study's tasks: what is not done yet, each cell after its training."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.studies.hashes import require_whole_cell
from sim2vr_harness.studies.jobs import TRAININGS, CellTask, Task, folder_of, is_done
from sim2vr_harness.studies.pool import Done, Pool


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        done: Tasks that are done, those of earlier sessions included.
        total: All tasks: trainings and cells.
        label: The one that has just ended; empty at first.
        error: Why that one failed; None: it did not.
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
