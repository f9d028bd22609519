"""What the processes of the pool's test do, importable by them."""

import os
import signal
import time
from pathlib import Path
from typing import Any


def work(task: Any, root: Path, cores: int) -> None:
    """Leave a file; the task's condition says what goes wrong."""
    attempts = root / f"{task.key}.attempts"
    with attempts.open("a") as stream:
        stream.write("x")
    if task.condition == "dies once" and attempts.stat().st_size == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if task.condition == "always dies":
        os._exit(3)
    if task.condition == "fails":
        raise ValueError("condition: got 'fails', expected another")
    if task.condition == "takes a while":
        time.sleep(2.0)
    if task.condition == "easy":  # of a study, which the test kills meanwhile
        (root / "worker").write_text(f"{os.getpid()}\n")
        time.sleep(60.0)
    (root / task.key).write_text(f"{os.getpid()}")


def folder(task: Any, root: Path, cores: int) -> None:
    """Leave a cell's folder."""
    place = root / "cells" / task.key
    (place / "data").mkdir(parents=True)
    (place / "data" / "x.csv").write_text("1")
    (place / "cell.json").write_text("{}")
