"""``sim2vr-harness bench``: how fast this machine simulates, draws and learns.

Physics, rendering and the whole environment are measured in turns, several times, and the medians
are reported: other programs then slow them all alike.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
import torch

from sim2vr_harness.training import ppo
from sim2vr_harness.training.config import TrainingConfig
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.memory import keep_freed_memory
from sim2vr_harness.training.run_folder import versions
from sim2vr_harness.training.vec_env import SimulationVecEnv

__all__ = ["bench"]

ROUNDS = 3


def bench(
    config: TrainingConfig,
    *,
    n: int | None = None,
    seconds: float = 3.0,
    train_steps: int = 4000,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> dict[str, Any]:
    """Measure user steps per second.

    Args:
        config: What to measure; its network and batch size count, its number of steps does not.
        n: Number of users; None takes ``ppo.n_envs``.
        seconds: For each of physics, rendering and environment.
        train_steps: User steps of the measured training iteration; 0 leaves it out.
        on_stage: Told what is measured now.

    Returns:
        ``physics_only_steps_per_s`` (MuJoCo's Batch alone, 25 physics steps per user step, same
        model, threads, N and kind of actions), ``render_frames_per_s``, ``env_steps_per_s``,
        ``train_steps_per_s`` (rollout and update; None if left out) and how it was measured.

    Raises:
        InputError: A number is out of range.
    """
    from sim2vr_harness.envs.simulation import Simulation

    users = config.ppo.n_envs if n is None else n
    if users < 1:
        raise InputError("--n", str(users), "at least 1")
    if seconds <= 0.0:
        raise InputError("--seconds", str(seconds), "more than 0")
    with closing(Simulation(config.env, users)) as simulation:
        simulation.reset(seeds=list(range(users)))
        stages = {
            "physics_only_steps_per_s": _physics(simulation),
            "render_frames_per_s": _rendering(simulation),
            "env_steps_per_s": _environment(simulation),
        }
        rates: dict[str, list[float]] = {name: [] for name in stages}
        for round_ in range(ROUNDS):
            for name, stage in stages.items():
                on_stage(f"{name} ({round_ + 1} of {ROUNDS})")
                rates[name].append(_rate(stage, users, seconds / ROUNDS))
        renderer = simulation.renderer_description
    report: dict[str, Any] = {name: round(float(np.median(r)), 1) for name, r in rates.items()}
    on_stage("train_steps_per_s")
    report |= _training(config, users, train_steps)
    return report | _circumstances(config, users, renderer, seconds, train_steps)


def _rate(step: Callable[[], None], users: int, seconds: float) -> float:
    step()
    count, began = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - began) < seconds:
        step()
        count += 1
    return count * users / elapsed


def _physics(simulation: Any) -> Callable[[], None]:
    from mujoco.batch import Batch

    rng = np.random.default_rng(0)
    source = simulation.users
    batch = Batch(source.user.physics_model, simulation.n, simulation.config.threads)
    act, ctrl, qpos = batch.bind("act"), batch.bind("ctrl"), batch.bind("qpos")
    qpos[:] = source.qpos
    act[:] = source.act

    def step() -> None:
        actions = rng.standard_normal(act.shape).clip(-1.0, 1.0)
        np.clip(act + actions, 0.0, 1.0, out=ctrl)
        batch.step(nstep=source.substeps)

    return step


def _rendering(simulation: Any) -> Callable[[], None]:
    vision = simulation.config.vision

    def step() -> None:
        for app in simulation.apps:
            app.render_headset(vision.width, vision.height)

    return step


def _environment(simulation: Any) -> Callable[[], None]:
    rng = np.random.default_rng(0)
    shape = (simulation.n, *simulation.action_space.shape)

    def step() -> None:
        outcome = simulation.step(rng.standard_normal(shape).clip(-1.0, 1.0))
        simulation.observation()
        ended = np.flatnonzero(outcome.terminated | outcome.truncated)
        if len(ended):
            simulation.reset(ids=[int(i) for i in ended])

    return step


def _training(config: TrainingConfig, users: int, train_steps: int) -> dict[str, float | None]:
    """Train one short iteration of the configuration's policy."""
    if train_steps <= 0:
        none = ("train_steps_per_s", "rollout_steps_per_s", "update_steps_per_s")
        return dict.fromkeys(none)
    from sim2vr_harness.envs.simulation import Simulation

    n_steps = max(1, round(train_steps / users))
    batch_size = min(config.ppo.batch_size, users * n_steps)
    while users * n_steps % batch_size:
        batch_size -= 1
    small = config.model_copy(
        update={
            "ppo": config.ppo.model_copy(
                update={"n_envs": users, "n_steps": n_steps, "batch_size": batch_size}
            )
        }
    )
    keep_freed_memory()
    env = SimulationVecEnv(Simulation(config.env, users))
    with closing(env):
        model = ppo.build(small, env)
        model.set_logger(_silent_logger())
        model.learn(users)
        values = model.last_times
    steps = users * n_steps
    return {
        "train_steps_per_s": round(steps / sum(values), 1),
        "rollout_steps_per_s": round(steps / values[0], 1),
        "update_steps_per_s": round(steps / values[1], 1),
    }


def _silent_logger() -> Any:
    from stable_baselines3.common.logger import Logger

    return Logger(folder=None, output_formats=[])


def _circumstances(
    config: TrainingConfig, users: int, renderer: str, seconds: float, train_steps: int
) -> dict[str, Any]:
    cores = len(os.sched_getaffinity(0))
    return {
        "n": users,
        "threads": config.env.threads or cores,
        "torch_threads": torch.get_num_threads(),
        "cores": cores,
        "cpu": _cpu_model(),
        "device": config.device,
        "renderer": renderer,
        "image": [config.env.vision.width, config.env.vision.height],
        "physics_steps_per_user_step": 500 // config.env.action_frequency_hz,
        "frames_per_step": config.env.frames_per_step,
        "seconds_per_measurement": seconds,
        "train_steps": train_steps,
        "versions": versions(),
    }


def _cpu_model() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
