"""A study's tasks on a Ray cluster: the same tasks, the same bytes, on many machines."""

import re
import socket
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError, reason, shown
from sim2vr_harness.base.optional import needed
from sim2vr_harness.studies.jobs import TRAININGS, CellTask, Task, folder_of, mark_of
from sim2vr_harness.studies.pool import Done, Work, done_by, play_or_train

_ATTEMPTS = 3
"""Of a task whose worker, or machine, is lost."""
_ANSWER_S = 5.0
"""For the cluster's port to accept a connection: Ray itself waits for minutes."""
_ADDRESS = re.compile(r"(?:ray://)?([^\s:/]+):([0-9]{1,5})")


class OnRay:
    """Tasks of a study as Ray's tasks; those of a lost machine run again on another.

    Args:
        root: The study's folder. Without ``storage`` all machines see it under this path.
        address: Of a running cluster: ``auto`` (as Ray finds it), HOST:PORT, ray://HOST:PORT.
        cores: How many a task takes.
        storage: Where workers leave results that do not see ``root``: any place that fsspec knows,
            such as s3://BUCKET/STUDY. They are fetched from there.
        work: What is done with a task.

    Raises:
        InputError: Ray is not installed, or there is no cluster.
    """

    def __init__(
        self,
        root: Path,
        address: str,
        cores: int,
        *,
        storage: str | None = None,
        work: Work = play_or_train,
    ) -> None:
        ray = needed("ray", "ray", "--ray")
        expected = "auto, or HOST:PORT of a running Ray cluster (ray start --head)"
        if address != "auto":
            match = _ADDRESS.fullmatch(address)
            if match is None:
                raise InputError("--ray", repr(address), expected)
            try:
                socket.create_connection((match[1], int(match[2])), _ANSWER_S).close()
            except (OSError, OverflowError) as error:
                got = f"{address!r}, where no one answers ({reason(error)})"
                raise InputError("--ray", got, expected) from error
        try:
            ray.init(address=address, log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise InputError("--ray", f"{address!r} ({reason(error)})", expected) from error
        self._ray, self._storage = ray, storage
        self._root = root.resolve()
        run = ray.remote(_run).options(num_cpus=cores, max_retries=0, scheduling_strategy="SPREAD")
        where = str(self._root) if storage is None else storage
        self._start: Callable[[Task], Any] = lambda task: run.remote(
            task, where, storage is not None, cores, work
        )
        self._tasks: dict[Any, Task] = {}
        self._losses: dict[str, int] = {}

    def submit(self, task: Task) -> None:
        if self._storage is not None and isinstance(task, CellTask) and task.training is not None:
            _send(self._root / TRAININGS / task.training, self._storage, TRAININGS, "trained.json")
        self._tasks[self._start(task)] = task

    def next(self) -> Done:
        lost = self._ray.exceptions
        while True:
            (ready,), _ = self._ray.wait(list(self._tasks), num_returns=1)
            task = self._tasks.pop(ready)
            try:
                done: Done = self._ray.get(ready)
            except (lost.WorkerCrashedError, lost.NodeDiedError, lost.ObjectLostError) as error:
                losses = self._losses[task.key] = self._losses.get(task.key, 0) + 1
                if losses >= _ATTEMPTS:
                    return Done(task, f"its worker was lost {losses} times: {reason(error)}")
                self.submit(task)
                continue
            if done.error is None and self._storage is not None:
                _fetch(self._storage, folder_of(task, self._root), mark_of(task))
            return done

    def close(self) -> None:
        for ref in self._tasks:
            self._ray.cancel(ref, force=True)
        self._tasks.clear()
        self._ray.shutdown()


def _run(task: Task, where: str, stored: bool, cores: int, work: Work) -> Done:
    """Do a task on whatever machine this is."""
    if not stored:
        return done_by(task, Path(where), cores, work)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        if isinstance(task, CellTask) and task.training is not None:
            _fetch(where, root / TRAININGS / task.training, "trained.json")
        done = done_by(task, root, cores, work)
        if done.error is None:
            place = folder_of(task, root)
            _send(place, where, place.parent.name, mark_of(task))
        return done


def _send(folder: Path, storage: str, kind: str, mark: str) -> None:
    """Put a folder into the storage, the file that says it is whole last."""
    import fsspec

    system, base = fsspec.core.url_to_fs(storage)
    to = f"{base}/{kind}/{folder.name}"
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != ".lock"]
    for file in sorted(files, key=lambda file: file == folder / mark):
        name = f"{to}/{file.relative_to(folder).as_posix()}"
        system.makedirs(name.rpartition("/")[0], exist_ok=True)
        system.put_file(str(file), name)


def _fetch(storage: str, folder: Path, mark: str) -> None:
    """Get a folder from the storage, the file that says it is whole last."""
    import fsspec

    system, base = fsspec.core.url_to_fs(storage)
    here = f"{base}/{folder.parent.name}/{folder.name}"
    if not system.exists(f"{here}/{mark}"):
        got = f"no {folder.parent.name}/{folder.name} in it"
        raise InputError("--storage", f"{storage!r}, {got}", "a place that all machines see")
    names = [name for name in system.find(here) if not name.endswith("/.lock")]
    for name in sorted(names, key=lambda name: name.endswith(f"{here}/{mark}")):
        file = folder / _name_inside(name, f"{folder.parent.name}/{folder.name}/", storage)
        file.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(name, str(file))


def _name_inside(listed: str, folder: str, storage: str) -> str:
    """Return a file's name below a folder of the storage, as the storage lists it.

    Raises:
        InputError: The name leads out of the folder, on this system or on another.
    """
    name = listed.partition(folder)[2]
    if any(part in ("", ".", "..") for part in name.split("/")) or set(name) & {"\\", ":", "\0"}:
        got = f"{storage!r}, which lists the file {shown(listed)}"
        raise InputError("--storage", got, f"names of files inside {folder}")
    return name
