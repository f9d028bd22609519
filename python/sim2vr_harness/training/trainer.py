"""One training session: from a configuration, or a run to continue, to a saved user."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from gymnasium import spaces
from rich.console import Console

from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.training import checkpoint, ppo
from sim2vr_harness.training.buffer import buffer_bytes
from sim2vr_harness.training.callbacks import CheckpointCallback, ProgressCallback
from sim2vr_harness.training.config import TrainingConfig, first_difference
from sim2vr_harness.training.distill import distill
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.memory import keep_freed_memory
from sim2vr_harness.training.metrics_log import make_logger, require_wandb
from sim2vr_harness.training.progress import Progress, ProgressDisplay
from sim2vr_harness.training.run_folder import RunFolder
from sim2vr_harness.training.vec_env import SimulationLike, SimulationVecEnv

__all__ = ["MakeSimulation", "TrainResult", "make_simulation", "train"]

MakeSimulation = Callable[[TrainingConfig], SimulationLike]
"""Makes the users to train with: ``config.ppo.n_envs`` of them."""

CHANGEABLE = (
    *("name", "total_timesteps", "checkpoint", "evaluation", "wandb", "device"),
    *(
        f"env.app.{key}"
        for key in (
            *("transport", "executable", "arguments", "connect", "processes"),
            *("timeout_s", "start_timeout_s", "time_scale"),
        )
    ),
)
"""Keys that a resumed run may change; any other would make it a different run."""

NOT_EXACT = "--resume starts new rounds, since this app cannot save its state."


@dataclass(frozen=True)
class TrainResult:
    """How a session ended.

    Attributes:
        folder: The run's folder.
        checkpoint: The newest checkpoint: the trained user; None if the session was stopped in a
            stage before there is one.
        step: User steps taken in all sessions, as far as saved.
        interrupted: Whether it was stopped by Ctrl-C or SIGTERM.
        lost_steps: User steps of the unfinished iteration, which resuming takes again.
        seconds: Wall time of the session.
    """

    folder: RunFolder
    checkpoint: Path | None
    step: int
    interrupted: bool
    lost_steps: int
    seconds: float


def make_simulation(config: TrainingConfig) -> SimulationLike:
    """Make the users and apps of ``config``; the default :data:`MakeSimulation`."""
    from sim2vr_harness.envs.simulation import Simulation

    return Simulation(config.env, config.ppo.n_envs)


def train(
    config: TrainingConfig,
    out: Path,
    *,
    timesteps: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    console: Console | None = None,
    simulation: MakeSimulation = make_simulation,
) -> TrainResult:
    """Train a simulated user until ``timesteps`` user steps are taken.

    Args:
        config: The configuration; with ``resume`` it must agree with the run's own.
        out: The run's folder.
        timesteps: Where this session stops, counted from the start of the run and rounded up to
            whole iterations; None goes to ``config.total_timesteps``. The learning-rate schedule
            runs over ``config.total_timesteps`` either way.
        resume: Continue the run in ``out`` from its newest checkpoint; a run that has reached
            ``timesteps`` is left as it is.
        overwrite: Delete the run in ``out`` first.
        console: Where to report; None reports to the standard error stream.
        simulation: How to make the users.

    Raises:
        InputError: An argument cannot be used; nothing has been written then.
    """
    console = console or Console(stderr=True)
    stop = config.total_timesteps if timesteps is None else timesteps
    if stop < 1:
        raise InputError("--timesteps", str(stop), "at least 1")
    if config.wandb.enabled:
        require_wandb()
    if config.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device", "'cuda', but torch finds no GPU", "'cpu' or 'auto'")
    folder = RunFolder(out)
    ready = False
    if resume:
        _check_resumable(folder, config)
        if not folder.checkpoints():
            # Stopped before the first checkpoint: from the start is exactly the same, but the
            # stages before it are not lost.
            resume, ready = False, config.recipe == "distill"
            overwrite = not ready
        elif (reached := _step_of(folder.latest_checkpoint())) >= stop:
            console.print(f"Nothing to train: {folder.path} has reached step {reached:,}.")
            return TrainResult(folder, folder.latest_checkpoint(), reached, False, 0, 0.0)
    elif folder.exists and not overwrite:
        folder.create(config)  # raises, before anything expensive is made
    keep_freed_memory()
    student = None
    if config.recipe == "distill" and not resume:
        if not ready:
            folder.create(config, overwrite)
            ready = True
        began = time.monotonic()
        with _sigterm_interrupts():
            student = distill(config, folder, console)
        if student is None:
            seconds = time.monotonic() - began
            return TrainResult(folder, None, 0, True, 0, seconds)
        console.print("Stage 3 of 3: the student goes on by itself, from what the user sees.")
    env = SimulationVecEnv(simulation(config))
    try:
        model = ppo.build(config, env)
        if student is not None:
            model.policy.load_state_dict(student)
        if resume:
            checkpoint.restore(folder.latest_checkpoint(), model)
            folder.drop_metrics_after(model.num_timesteps)
            folder.store_config(config)
        elif not ready:
            folder.create(config, overwrite)
        return _run(model, config, folder, stop, console)
    finally:
        env.close()


def _step_of(checkpoint_file: Path) -> int:
    return int(checkpoint_file.stem.removeprefix("step_"))


def _check_resumable(folder: RunFolder, config: TrainingConfig) -> None:
    if not folder.exists:
        raise InputError(
            "--resume", f"{str(folder.path)!r}, which holds no run", "a folder with a run in it"
        )
    difference = first_difference(config, folder.load_config(), ignore=CHANGEABLE)
    if difference is not None:
        key, new, old = difference
        raise InputError(
            key, repr(new), f"{old!r} as in {folder.config_file}: a resumed run keeps its settings"
        )


def _run(
    model: ppo.PPO, config: TrainingConfig, folder: RunFolder, stop: int, console: Console
) -> TrainResult:
    """Learn until ``stop``, or until interrupted, and save."""
    start = model.num_timesteps
    logger = make_logger(config, folder, start)
    model.set_logger(logger)
    size = config.ppo.steps_per_iteration
    progress = Progress(
        step=start,
        start_step=start,
        stop_step=-(-stop // size) * size,
        iteration_steps=size,
        minibatches=size // config.ppo.batch_size * config.ppo.n_epochs,
        game=game_facts(config.env.app),
    )
    display = ProgressDisplay(progress, console)

    def written(file: Path, step: int) -> None:
        progress.note = f"Saved {file}"

    checkpoints = CheckpointCallback(
        folder, config.checkpoint.every_steps, config.checkpoint.keep, written
    )
    tracker = ProgressCallback(display)
    folder.begin_session(start, **_describe(model, config))
    _greet(model, folder, progress, console)
    interrupted = False
    status = "failed"
    try:
        with _sigterm_interrupts(), display:
            model.learn(
                stop - start, callback=[checkpoints, tracker], reset_num_timesteps=start == 0
            )
            checkpoints.remember()
        status = "finished"
    except KeyboardInterrupt:
        interrupted, status = True, "interrupted"
    finally:
        tracker.detach()
        with _uninterrupted():
            saved = checkpoints.write()
            logger.close()
            failures = {"app_failures": tracker.failures} if tracker.failures else {}
            end_step = checkpoints.snapshot_step or start
            folder.end_session(end_step=end_step, status=status, **failures)
    if saved is None:
        raise RuntimeError("interrupted before the first step; nothing was saved")
    step = checkpoints.snapshot_step or 0
    return TrainResult(
        folder=folder,
        checkpoint=saved,
        step=step,
        interrupted=interrupted,
        lost_steps=max(0, model.num_timesteps - step) if interrupted else 0,
        seconds=time.monotonic() - progress.started,
    )


def _renderer(model: ppo.PPO) -> str | None:
    """Return what draws the headset images, if the simulation knows it."""
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    return getattr(env.simulation, "renderer_description", None)


def _describe(model: ppo.PPO, config: TrainingConfig) -> dict[str, Any]:
    return {
        "device": str(model.device),
        "renderer": _renderer(model),
        "torch_threads": torch.get_num_threads(),
        "parameters": sum(parameter.numel() for parameter in model.policy.parameters()),
    }


def _greet(model: ppo.PPO, folder: RunFolder, progress: Progress, console: Console) -> None:
    steps = model.n_steps * model.n_envs
    space = model.rollout_buffer.observation_space
    assert isinstance(space, spaces.Dict)
    memory = buffer_bytes(space, steps) / 2**20
    verb = "Continuing" if progress.start_step else "Training"
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    exact = getattr(env.simulation, "exact_states", True)
    lines = [
        f"{verb} in {folder.path}, from step {progress.start_step:,} to {progress.stop_step:,} "
        f"in iterations of {steps:,} user steps ({model.n_envs} users, {model.device}).",
        f"Observations of one iteration: {memory:,.0f} MiB. Ctrl-C saves and stops; "
        + ("--resume continues exactly." if exact else NOT_EXACT),
    ]
    renderer = _renderer(model)
    if renderer is not None:
        lines.insert(1, f"Headset images by {renderer}.")
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


@contextmanager
def _sigterm_interrupts() -> Iterator[None]:
    """Let SIGTERM stop a training as Ctrl-C does, so that batch systems lose nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Keep an impatient second Ctrl-C from cutting off the saving."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
