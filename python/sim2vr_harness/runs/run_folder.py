"""The folder of one training run: what is in it and where.

::

    config.yaml        the complete configuration
    run.json           versions, git commit, and every session that worked on the run
    metrics.jsonl      one JSON object per iteration
    imagined/, teacher/, student/   the first stages of ``recipe: distill``
    checkpoints/       step_000080000.zip, ...: also readable by stable_baselines3; files that
                       a training has set aside end in .aside
    .lock              held by the training that works on the run
    tensorboard/       the same metrics for TensorBoard
    evaluation/        what ``sim2vr-harness evaluate`` writes
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from sim2vr_harness import __version__
from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError, closest
from sim2vr_harness.base.file_lock import is_temporary
from sim2vr_harness.base.files import file_name, naming, read_json, write_atomically
from sim2vr_harness.client import Measure
from sim2vr_harness.runs.config import (
    TrainingConfig,
    apply_overrides,
    parse_config,
    read_mapping,
    to_yaml,
)

STAGE_FOLDERS = ("imagined", "student")
"""Folders of the stages in a run's folder; the last stage works in the run's own."""

_PACKAGES = ("mujoco", "stable-baselines3", "torch", "gymnasium", "numpy", "scipy")


def read_rows(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a log, one JSON object a line; one cut off by a crash is left out."""
    rows: list[dict[str, Any]] = []
    if file.is_file():
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            with suppress(json.JSONDecodeError, RecursionError):
                row = json.loads(line)
                if isinstance(row, dict):
                    rows.append(row)
    return rows


def append_row(file: Path, row: Mapping[str, Any]) -> None:
    """Add a row to a log, which is opened for each, so that a crash loses none."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with naming(file), file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(row) + "\n")


def keep_rows(file: Path, wanted: Callable[[dict[str, Any]], bool]) -> None:
    """Delete the other rows of a log, which belong to steps that a resumed run will repeat."""
    if file.is_file():
        text = "".join(json.dumps(row) + "\n" for row in read_rows(file) if wanted(row))
        write_atomically(file, text.encode())


def step_of(checkpoint: Path) -> int:
    """User steps after which a checkpoint was written, by its name."""
    return int(checkpoint.stem.removeprefix("step_"))


def checkpoints_in(folder: Path) -> list[Path]:
    """Return all checkpoints of a folder, the oldest first."""
    found = folder.glob("step_*.zip")
    return sorted(
        (file for file in found if file.stem.removeprefix("step_").isdecimal()), key=step_of
    )


def versions() -> dict[str, str]:
    """Return the versions of this package, Python and the packages that decide a result."""
    found = {"sim2vr-harness": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def git_commit() -> str | None:
    """Return the checkout's commit, ``-dirty`` appended if files differ; None without git."""
    root = paths.checkout_dir()
    if root is None or shutil.which("git") is None:
        return None
    done = subprocess.run(
        ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40"],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.strip() or None


class RunFolder:
    """The files of one run.

    Args:
        path: The folder; made by :meth:`create`.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.config_file = self.path / "config.yaml"
        self.run_file = self.path / "run.json"
        self.metrics_file = self.path / "metrics.jsonl"
        self.lock_file = self.path / ".lock"
        self.checkpoint_dir = self.path / "checkpoints"
        self.tensorboard_dir = self.path / "tensorboard"
        self.evaluation_dir = self.path / "evaluation"

    @property
    def exists(self) -> bool:
        """Return whether the folder holds a run."""
        return self.config_file.is_file()

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> RunFolder:
        """Open the folder of an existing run.

        Raises:
            InputError: There is no such folder, or it is not a run's.
        """
        folder = cls(path)
        if not folder.path.exists():
            expected = f"the folder of a run{_nearest_run(folder.path)}"
            raise InputError("RUN", f"{str(path)!r}, which does not exist", expected)
        if not folder.exists:
            raise InputError(
                "RUN",
                f"{str(path)!r}, which holds no config.yaml",
                "a folder that sim2vr-harness train has written",
            )
        return folder

    def create(self, config: TrainingConfig, overwrite: bool = False) -> None:
        """Start a new run in this folder.

        Args:
            config: Its configuration.
            overwrite: Whether a run that is here may be deleted.

        Raises:
            InputError: The folder holds a run (and ``overwrite`` is False) or other files.
        """
        if not overwrite:
            self.require_free()
        if not self.exists:
            self._require_place()
        # A run that was killed in its first write leaves traces, too; files of others stay.
        self.config_file.unlink(missing_ok=True)
        for file in (self.run_file, self.metrics_file):
            file.unlink(missing_ok=True)
        stages = (self.path / name for name in STAGE_FOLDERS)
        for folder in (self.checkpoint_dir, self.tensorboard_dir, self.evaluation_dir, *stages):
            shutil.rmtree(folder, ignore_errors=True)
        self.checkpoint_dir.mkdir(parents=True, exist_ok=True)
        write_atomically(self.run_file, json.dumps({"sessions": []}, indent=2).encode())
        write_atomically(self.config_file, to_yaml(config).encode())

    def require_free(self) -> None:
        """Check that a new run can begin in this folder.

        Raises:
            InputError: The folder holds a run or other files, or is none.
        """
        if self.exists:
            raise InputError(
                "--out",
                f"{str(self.path)!r}, which holds a run",
                "a new folder, or --resume to continue that run, or --overwrite to delete it",
            )
        self._require_place()

    def _require_place(self) -> None:
        """Check that the folder is empty, or contains only files of a run that never began."""
        if self.path.exists() and not self.path.is_dir():
            raise InputError("--out", f"{str(self.path)!r}, which is a file", "a folder")
        if self.path.is_dir() and not all(map(self._is_trace, self.path.iterdir())):
            raise InputError(
                "--out", f"{str(self.path)!r}, which holds other files", "a new or empty folder"
            )

    def _is_trace(self, file: Path) -> bool:
        """Return whether a training killed before it wrote config.yaml may have left this file."""
        if file == self.checkpoint_dir:
            return file.is_dir() and not any(file.iterdir())
        return file in (self.run_file, self.lock_file) or is_temporary(file)

    def load_config(self, overrides: Sequence[str] = ()) -> TrainingConfig:
        """Read the run's configuration; overrides as in :func:`.config.load_config`."""
        try:
            tree = read_mapping(self.config_file)
            return parse_config(apply_overrides(tree, overrides))
        except InputError as error:
            if overrides:  # the file itself could be read before
                raise
            raise InputError(f"{self.config_file}: {error.field}", error.got, error.expected) from (
                error
            )

    def store_config(self, config: TrainingConfig) -> None:
        """Replace the run's configuration."""
        write_atomically(self.config_file, to_yaml(config).encode())

    # --- run.json -------------------------------------------------------------------------------

    def metadata(self) -> dict[str, Any]:
        """Return the content of run.json."""
        if not self.run_file.is_file():
            return {"sessions": []}
        expected = "what a training has written; without the file a new one is begun"
        content = read_json(self.run_file, expected)
        if not isinstance(content.get("sessions"), list):
            raise InputError(file_name(self.run_file), "no list of sessions", expected)
        return content

    def begin_session(self, start_step: int, **details: Any) -> None:
        """Write a new session into run.json, with the process that works on the run."""
        content = self.metadata()
        content["sessions"].append(
            {
                "started": datetime.now(UTC).isoformat(timespec="seconds"),
                "start_step": start_step,
                "versions": versions(),
                "git_commit": git_commit(),
                "python": sys.executable,
                "machine": platform.platform(),
                "cores": len(os.sched_getaffinity(0)),
                **details,
            }
        )
        write_atomically(self.run_file, json.dumps(content, indent=2).encode())

    def note(self, **values: Any) -> None:
        """Set top-level values of run.json."""
        write_atomically(self.run_file, json.dumps(self.metadata() | values, indent=2).encode())

    def note_session(self, **details: Any) -> None:
        """Write values on the session into run.json; do nothing if no session was begun."""
        content = self.metadata()
        if content["sessions"]:
            content["sessions"][-1] |= details
            write_atomically(self.run_file, json.dumps(content, indent=2).encode())

    def end_session(self, **details: Any) -> None:
        """Note in run.json how the last session ended."""
        self.note_session(ended=datetime.now(UTC).isoformat(timespec="seconds"), **details)

    # --- checkpoints and metrics ----------------------------------------------------------------

    def checkpoint_file(self, step: int) -> Path:
        """Return where the checkpoint after ``step`` user steps belongs."""
        return self.checkpoint_dir / f"step_{step:09d}.zip"

    def checkpoints(self) -> list[Path]:
        """Return all checkpoints, the oldest first."""
        return checkpoints_in(self.checkpoint_dir)

    @property
    def step(self) -> int:
        """User steps of the newest checkpoint; 0 if there is none."""
        files = self.checkpoints()
        return step_of(files[-1]) if files else 0

    def latest_checkpoint(self) -> Path:
        """Return the newest checkpoint.

        Raises:
            InputError: There is none yet.
        """
        files = self.checkpoints()
        if not files:
            raise InputError(
                "RUN", f"{str(self.path)!r}, which has no checkpoint yet", "a run with a checkpoint"
            )
        return files[-1]

    def metrics(self) -> list[dict[str, Any]]:
        """Return the rows of metrics.jsonl; a last line cut off by a crash is left out."""
        return read_rows(self.metrics_file)

    def drop_metrics_after(self, step: int) -> None:
        """Forget rows of steps that a resumed run will take again."""
        keep_rows(self.metrics_file, lambda row: row.get("step", 0) <= step)


def metric_key(measure: Measure) -> str:
    """Return the column of a game's measure in a run's progress, per episode."""
    return f"ep_{measure.name}" if measure.rate_with else f"ep_{measure.log_key}_mean"


def _nearest_run(path: Path) -> str:
    """Return a hint at the run with the most similar name, beside ``path`` or in ``runs``."""
    configs = [*path.parent.glob("*/config.yaml"), *Path("runs").glob("*/config.yaml")]
    runs = {config.parent.name: config.parent for config in configs}
    near = closest(path.name, runs)
    return f" (did you mean {str(runs[near])!r}?)" if near else ""
