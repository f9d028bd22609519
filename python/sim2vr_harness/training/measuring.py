"""What the benchmark needs of Stable-Baselines3."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence

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
    return SubprocVecEnv(list(makers), start_method="forkserver")
