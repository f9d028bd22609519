"""Measures how much longer updates of imagined rollouts take beside busy processes.

Turns without and with them alternate in one run, so that what else the machine does meets both. On
C cores with B busy processes a fair share is C / (C - B / 2) times the quiet time or less.

Run: python tools/bench/neighbour.py --busy 1 --updates 30 --turns 3
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from sim2vr_harness.base.cores import available, settle_torch

settle_torch()  # before torch is loaded

from sim2vr_harness.base.torch_threads import FastestThreads  # noqa: E402
from sim2vr_harness.runs.config import TrainingConfig, load_config  # noqa: E402
from sim2vr_harness.training.model_based.stage import ImaginedStage  # noqa: E402
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer  # noqa: E402

_CONFIG = Path("configs/whacamole_constrained_distill.yaml")
_FEW = {"updates": 1, "first_play_steps": 30, "first_fit_minibatches": 20}
"""A first cycle that is over soon; what is learned does not matter."""


def main() -> None:
    """Measure, and print a row for each number of threads."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", nargs="?", type=Path, default=_CONFIG)
    parser.add_argument("--busy", type=int, default=1, help="processes beside, of equal priority")
    parser.add_argument("--updates", type=int, default=30, help="of a turn")
    parser.add_argument("--turns", type=int, default=3)
    given = parser.parse_args()
    print(f"{available()} cores, {given.busy} busy processes, load {os.getloadavg()[0]:.1f} before")
    print(f"{'threads':12}{'quiet':>10}{'beside':>10}{'ratio':>8}{'of processor time':>20}")
    with TemporaryDirectory() as folder:
        stage = ImaginedStage(_short(load_config(given.config, [])), Path(folder))
        stage.open()
        trainer = stage._learner
        assert trainer is not None
        trainer.step()
        measured = trainer._threads
        ways = {"measured": measured}
        ways |= {str(count): FastestThreads([count]) for count in measured._counts}
        for name, threads in ways.items():
            trainer._threads = threads
            print(_row(name, trainer, given.busy, given.updates, given.turns), flush=True)
        stage.close()


def _short(config: TrainingConfig) -> TrainingConfig:
    imagined = config.teacher.imagined.model_copy(update=_FEW)
    teacher = config.teacher.model_copy(update={"imagined": imagined})
    return config.model_copy(update={"teacher": teacher})


def _row(name: str, trainer: ModelBasedTrainer, busy: int, updates: int, turns: int) -> str:
    pairs = []
    for _ in range(turns):
        quiet = _turn(trainer, updates)
        with _busy(busy):
            pairs.append((*quiet, *_turn(trainer, updates)))
    wall, wall_beside = (median(pair[k] for pair in pairs) for k in (0, 2))
    ratio, of_cpu = (median(pair[k + 2] / pair[k] for pair in pairs) for k in (0, 1))
    seconds = f"{wall / updates:8.3f} s{wall_beside / updates:8.3f} s"
    return f"{name:12}{seconds}{ratio:8.2f}{of_cpu:20.2f}"


def _turn(trainer: ModelBasedTrainer, updates: int) -> tuple[float, float]:
    """Return wall and processor time, s, of updates as a cycle makes them."""
    trainer._threads.measure()
    wall, cpu = time.monotonic(), time.process_time()
    for _ in range(updates):
        with trainer._threads.turn():
            trainer._update()
    return time.monotonic() - wall, time.process_time() - cpu


@contextmanager
def _busy(count: int) -> Iterator[None]:
    with ExitStack() as stack:
        for _ in range(count):
            process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield


if __name__ == "__main__":
    main()
