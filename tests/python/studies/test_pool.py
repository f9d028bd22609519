"""Processes that do tasks, and die of them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pool_tasks

from sim2vr_harness.studies.pool import Processes
from sim2vr_harness.studies.tasks import CellTask


def task(key: str, condition: str = "fine") -> CellTask:
    return CellTask(
        key=key,
        cell=key,
        user="somebody",
        training=None,
        condition=condition,
        overrides=(),
        episodes=1,
        seed=1,
        people=None,
        deterministic=False,
        steps=False,
        logs=False,
        film_seconds=0.0,
    )


def test_a_lost_worker_s_task_is_done_again_and_the_others_go_on(tmp_path: Path) -> None:
    tasks = [
        task("a", "dies once"),
        task("b"),
        task("c", "fails"),
        task("d", "always dies"),
        task("e"),
    ]
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
    assert {key: (tmp_path / f"{key}.attempts").stat().st_size for key in "abcde"} == {
        "a": 2,
        "b": 1,
        "c": 1,
        "d": 3,
        "e": 1,
    }
    assert not (tmp_path / "d").exists()
