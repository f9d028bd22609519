"""What the benchmark needs of Stable-Baselines3."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from multiprocessing import forkserver

import gymnasium
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import SubprocVecEnv

__all__ = ["silent_logger", "subprocess_vec_env"]

_PRELOADED = ["sim2vr_harness.envs.simulation", "stable_baselines3.common.vec_env.subproc_vec_env"]


def silent_logger() -> Logger:
    """A logger that writes nothing."""
    return Logger(folder=None, output_formats=[])


def subprocess_vec_env(makers: Sequence[Callable[[], gymnasium.Env]]) -> SubprocVecEnv:
    """Environments in a process each, as the reference trains on them.

    The processes are forked from one that has imported the packages already, so that a hundred of
    them start in seconds.

    Args:
        makers: one per environment; picklable.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    # Ctrl-C goes to every process of the terminal, and the parent alone shall answer it: those
    # that are started now inherit that it is ignored.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, before)
    return SubprocVecEnv(list(makers), start_method="forkserver")
