"""Processes that do tasks, and die of them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pool_tasks

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.studies.jobs import CellTask
from sim2vr_harness.studies.pool import Processes


def task(key: str, condition: str = "fine") -> CellTask:
    return CellTask(
        key=key,
        cell=key,
        user="somebody",
        training=None,
        condition=condition,
        overrides=(),
        env=EnvConfig(),
        trust_app=False,
        episodes=1,
        seed=1,
        people=None,
        deterministic=False,
        steps=False,
        logs=False,
        film_seconds=0.0,
    )


def test_a_lost_worker_s_task_is_done_again_and_the_others_go_on(tmp_path: Path) -> None:
    faults = {"a": "dies once", "b": "fine", "c": "fails", "d": "always dies", "e": "fine"}
    tasks = [task(key, fault) for key, fault in faults.items()]
    with closing(Processes(tmp_path, 2, 1, pool_tasks.work)) as pool:
        for one in tasks:
            pool.submit(one)
        done = {found.task.key: found.error for found in (pool.next() for _ in tasks)}
    assert done == {
        "a": None,
        "b": None,
        "c": "condition: got 'fails', expected another",
        "d": "its process died 3 times, at last with exit code 3",
        "e": None,
    }
    attempts = [(tmp_path / f"{key}.attempts").stat().st_size for key in "abcde"]
    assert attempts == [2, 1, 1, 3, 1]
    assert not (tmp_path / "d").exists()


_STUDY = """
import sys
import pool_tasks
from sim2vr_harness.studies import run_study
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.studies.pool import Processes

if __name__ == "__main__":
    study = {
        "name": "killed",
        "fixed": {"user": "whacamole_constrained"},
        "factors": {"condition": {"key": "condition", "levels": ["easy"]}},
    }
    made = lambda root, tasks: Processes(root, 1, 1, pool_tasks.work)
    run_study(study, sys.argv[1], make_pool=made)
"""


def test_workers_end_with_a_study_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "a_study.py"
    script.write_text(_STUDY)
    here = str(Path(pool_tasks.__file__).parent)
    path = f"{here}:{os.environ.get('PYTHONPATH', '')}"
    running = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.DEVNULL,
    )
    told = tmp_path / "out" / "worker"
    try:
        _wait_for(lambda: told.is_file() and told.read_text().endswith("\n"))
        worker = int(told.read_text())
        running.send_signal(signal.SIGKILL)
        running.wait(20.0)
        _wait_for(lambda: not Path(f"/proc/{worker}").exists())
    finally:
        running.kill()
        running.wait()


def _wait_for(come: Callable[[], bool], seconds: float = 60.0) -> None:
    until = time.monotonic() + seconds
    while not come():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.05)
