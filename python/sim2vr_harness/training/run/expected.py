"""Devices of a run's stages, and how long they are expected to take."""

import math
import time
from collections.abc import Sequence

import numpy as np
from stable_baselines3.common.utils import get_device

from sim2vr_harness.base.cores import budget, free
from sim2vr_harness.base.progress import duration
from sim2vr_harness.games.registry import imagined_game
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.training.run.stage import Stage

_SORTING_S = 0.74e-3
"""Processor time of :func:`slowness`'s sorting on the core that the figures below are from, an AMD
EPYC; `whacamole_constrained_distill` was measured."""
_USER_STEP_S, _SEEN_STEP_S = 0.6e-3, 0.9e-3
"""Processor time of a user step without and with images."""
_SAMPLE_S, _SAMPLE_GPU_S = 0.4e-3, 0.03e-3
"""Time of learning from a sample of what a user sees; on a processor, on a GPU."""
_FIT_S, _FIT_GPU_S = 19e-3, 1e-3
"""A minibatch of the body model."""
_UPDATE_S, _UPDATE_GPU_S = 0.25, 0.06
"""An update of imagined rollouts with 256 users and windows of 16 user steps."""
_CORES_OF_UPDATES = 1.4
"""Cores that imagined rollouts can use: half of their time is starting operations."""


def slowness() -> float:
    """Return how much longer this core takes than the one of the figures; by processor time."""
    values = np.random.default_rng(0).standard_normal(65_536)
    fastest = math.inf
    for _ in range(6):
        began = time.thread_time()
        np.sin(np.sort(values))
        fastest = min(fastest, time.thread_time() - began)
    return max(0.2, min(5.0, fastest / _SORTING_S))


def device_of(stage: str, config: TrainingConfig) -> str:
    """Return the device that a stage learns on."""
    if stage in ("student", "ppo"):
        return get_device(config.device).type
    game = imagined_game(config.env.app.game)
    if stage == "imagined" and game is not None and game.on_gpu:
        return get_device(config.device).type
    return "cpu"


def expected_seconds(stage: str, config: TrainingConfig, cores: float, slow: float) -> float | None:
    """Return about how long a stage takes; None: it says so itself once it is known.

    Args:
        stage: its name.
        config: of the run.
        cores: that it gets.
        slow: see :func:`slowness`.
    """
    gpu = device_of(stage, config) == "cuda"
    sample_s = _SAMPLE_GPU_S if gpu else _SAMPLE_S * slow / cores
    seen_s = _SEEN_STEP_S * slow / cores
    if stage == "imagined":
        imagined = config.teacher.imagined
        later = imagined.cycles - 1
        users = (imagined.users / 256) * (imagined.window_steps / 16)
        steps = (imagined.first_play_steps + later * imagined.play_steps) * imagined.n_envs
        fits = imagined.first_fit_minibatches + later * imagined.fit_minibatches
        updates = imagined.cycles * imagined.updates
        few = min(cores, _CORES_OF_UPDATES)
        fit_s = _FIT_GPU_S if gpu else _FIT_S * slow / few
        update_s = _UPDATE_GPU_S if gpu else _UPDATE_S * users * slow / few
        return steps * _USER_STEP_S * slow / cores + fits * fit_s + updates * update_s
    if stage == "student":
        student = config.student
        return student.frames * (seen_s + student.samples_per_frame * sample_s)
    if stage == "ppo" and config.env.app.transport == "in_process":
        return config.total_timesteps * (seen_s + config.ppo.n_epochs * sample_s)
    return None


def plan_lines(stages: Sequence[Stage], config: TrainingConfig) -> list[str]:
    """Return for people: devices and expected times of the stages, and whether cores are free."""
    wanted, idle = budget(config.env.cores), free()
    cores = float(min(wanted, idle))
    lines = []
    if wanted > idle:
        lines.append(
            f"Note: {wanted} cores are requested and about {idle} are free, as other programs run "
            f"here; --cores {idle} takes no more than these."
        )
    slow = slowness()
    parts, known = [], []
    for stage in stages:
        seconds = expected_seconds(stage.name, config, cores, slow)
        known.append(seconds)
        about = "" if seconds is None else f", about {duration(seconds)}"
        parts.append(f"{stage.name} on {_named(device_of(stage.name, config))}{about}")
    lines.append(f"Stages: {'; '.join(parts)}.")
    whole = [seconds for seconds in known if seconds is not None]
    if len(whole) == len(known) > 1:
        lines.append(f"Expected: about {duration(sum(whole))} on {cores:.0f} cores.")
    return lines


def _named(device: str) -> str:
    return "the GPU" if device == "cuda" else "the processor"
