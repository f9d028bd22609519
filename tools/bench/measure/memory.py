"""Memory per user: the growth between two numbers of users, each in a fresh process.

Run as a program it is such a process: settings come in as JSON, the peak goes out.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence

from measure.processes import peak_memory_mb
from measure.rows import BenchRow
from measure.scene import IN_PROCESS
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.runs.config import TrainingConfig

_STEPS = 3


def memory_rows(
    config: TrainingConfig,
    numbers: Sequence[int],
    threads: int,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> list[BenchRow]:
    """Peak memory of processes that hold N users each, and what one more user adds.

    Args:
        config: of the users.
        numbers: of users; at least two for memory per user.
        threads: of physics and apps.
        on_stage: called with what is measured now.

    Returns:
        A row per number, with ``extra["memory_mb_per_user"]``: the growth since the next
        smaller number, divided by the users added. Python, MuJoCo and the GL driver themselves thus
        do not count.

    Raises:
        RuntimeError: a process failed.
    """
    rows: list[BenchRow] = []
    before: tuple[int, float] | None = None
    for n in sorted(set(numbers)):
        on_stage(f"memory, N={n}")
        peak_mb = _peak_in_fresh_process(config.env, n, threads)
        extra = {}
        if before is not None:
            extra["memory_mb_per_user"] = round((peak_mb - before[1]) / (n - before[0]), 3)
        before = (n, peak_mb)
        rows.append(
            BenchRow("memory", IN_PROCESS, n, threads, unit="MB", memory_mb=peak_mb, extra=extra)
        )
    return rows


def _peak_in_fresh_process(config: EnvConfig, n: int, threads: int) -> float:
    settings = {"env": config.model_dump(mode="json"), "n": n, "threads": threads}
    done = subprocess.run(
        [sys.executable, "-m", "measure.memory"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        input=json.dumps(settings),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        raise RuntimeError(f"memory: the process with {n} users failed: {last}")
    return float(json.loads(done.stdout)["peak_mb"])


def _hold_users() -> None:
    """Holds users for a few steps and writes the peak of this process's memory."""
    import numpy as np

    from sim2vr_harness.envs.simulation import Simulation

    settings = json.load(sys.stdin)
    config = EnvConfig(**settings["env"]).model_copy(update={"cores": settings["threads"]})
    simulation = Simulation(config, settings["n"])
    simulation.reset(seeds=list(range(settings["n"])))
    shape = simulation.action_space.shape
    assert shape is not None
    for _ in range(_STEPS):
        simulation.step(np.zeros((settings["n"], *shape)))
        simulation.observation()
    json.dump({"peak_mb": peak_memory_mb()}, sys.stdout)
    simulation.close()


if __name__ == "__main__":
    _hold_users()
