"""One training session: from a configuration, or a run to continue, to a saved user."""

import ctypes
import math
import os
import platform
import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import cast

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.utils import get_device
from torch import nn

from sim2vr_harness.base.cores import budget, free, torch_budget
from sim2vr_harness.base.errors import InputError, UnusableFile
from sim2vr_harness.base.file_lock import sole_training
from sim2vr_harness.base.progress import duration
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.envs import shards
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.games.registry import imagined_game
from sim2vr_harness.runs.checkpoint import require_readable
from sim2vr_harness.runs.config import TrainingConfig, first_difference
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.runs.trust import remember
from sim2vr_harness.training.dagger.dagger import StudentStage, TeacherExpert
from sim2vr_harness.training.model_based.stage import ImaginedStage
from sim2vr_harness.training.motor_control.goal_task import MotorStage, needs_motor_policy
from sim2vr_harness.training.option_q_learning.stage import QLearningStage
from sim2vr_harness.training.ppo.fine_tune import user_to_adapt
from sim2vr_harness.training.ppo.rollout_buffer import buffer_bytes
from sim2vr_harness.training.ppo.stage import PPOStage
from sim2vr_harness.training.run.loggers import require_wandb
from sim2vr_harness.training.run.stage import (
    Report,
    Stage,
    StageOutcome,
    remaining,
    run_stages,
    say_line,
)

MakeSimulation = Callable[[TrainingConfig], Simulation]
"""Makes the users to train with: ``config.ppo.n_envs`` of them."""


@dataclass(frozen=True)
class Run:
    """Settings from which a recipe builds its stages.

    Attributes:
        config: of the run.
        folder: of the run.
        stop: user steps after which the last stage ends.
        make_simulation: makes the users of the last stage.
        resumed: True if training continues from the run's folder; otherwise the folder's contents
            are ignored, and deleted before a stage runs.
    """

    config: TrainingConfig
    folder: RunFolder
    stop: int
    make_simulation: MakeSimulation
    resumed: bool

    @cached_property
    def env(self) -> ResolvedEnv:
        """The environment of the configuration."""
        return ResolvedEnv(self.config.env)


def _from_pixels(
    run: Run, title: str, begin: Callable[[nn.Module], object] = lambda policy: None
) -> PPOStage:
    return PPOStage(run.config, run.folder, title, run.make_simulation, begin, run.stop)


def _distill(run: Run) -> list[Stage]:
    """Return the stages teacher (privileged observations), student (own senses) and PPO.

    The result is a policy that is optimised for its own senses and its own effort.
    """
    config, path = run.config, run.folder.path
    teacher = ImaginedStage(config, path / ImaginedStage.name)

    def guide(simulation: Simulation) -> TeacherExpert:
        return TeacherExpert(teacher.folder / teacher.result, config.teacher, simulation)

    student = StudentStage(config, path / StudentStage.name, guide)

    def begin(policy: nn.Module) -> None:
        policy.load_state_dict(student.weights())

    title = "the student goes on by itself: PPO from what the user senses."
    return [teacher, student, _from_pixels(run, title, begin)]


def _skills(run: Run) -> list[Stage]:
    """Return the stages of a motor layer, if it has to be trained, and of option values."""
    config, path = run.config, run.folder.path
    motor = None
    if needs_motor_policy(config, run.env):
        motor = MotorStage(config, path / MotorStage.name, run.env)
    values = QLearningStage(config, path / QLearningStage.name, motor, run.folder, stop=run.stop)
    return [values] if motor is None else [motor, values]


def _adapt(run: Run) -> list[Stage]:
    """Return the stage that continues a trained user in a changed environment."""
    title = "a trained user goes on: PPO from what it senses."
    if run.resumed and run.folder.checkpoints():
        return [_from_pixels(run, title)]
    user = user_to_adapt(run.config)
    noise = run.config.policy.log_std_init

    def begin(policy: nn.Module) -> None:
        user.load(policy)
        if noise != user.config.policy.log_std_init:  # the run has another one
            nn.init.constant_(cast(nn.Parameter, policy.log_std), noise)

    return [_from_pixels(run, title, begin)]


RECIPES: dict[str, Callable[[Run], list[Stage]]] = {
    "ppo": lambda run: [_from_pixels(run, "PPO from what the user senses.")],
    "distill": _distill,
    "skills": _skills,
    "adapt": _adapt,
}


def stages_of(run: Run) -> list[Stage]:
    """Return the stages of a run, in order."""
    return RECIPES[run.config.recipe](run)


_SORTING_S = 0.74e-3
"""Processor time of :func:`slowness`'s sorting on the core that the figures below are from, an AMD
EPYC; `whacamole_constrained_distill` was measured."""
_USER_STEP_S, _SEEN_STEP_S = 0.6e-3, 0.9e-3
"""Processor time of a user step without and with images."""
_SAMPLE_S, _SAMPLE_GPU_S = 0.4e-3, 0.03e-3
"""Time of training on one image, s: on a processor core, on a GPU."""
_FIT_S, _FIT_GPU_S = 19e-3, 1e-3
"""A minibatch of the body model."""
_UPDATE_S, _UPDATE_GPU_S = 0.25, 0.06
"""An update of imagined rollouts with 256 users and windows of 16 user steps."""
_CORES_OF_UPDATES = 1.4
"""Cores that imagined rollouts can use: half of their time is starting operations."""


def slowness() -> float:
    """Return this core's time for a computation, relative to the reference core; processor time."""
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
    """Return the expected duration of a stage, s; None: the stage itself reports it once known."""
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
        gpu = device_of(stage.name, config) == "cuda"
        parts.append(f"{stage.name} on the {'GPU' if gpu else 'processor'}{about}")
    lines.append(f"Stages: {'; '.join(parts)}.")
    whole = [seconds for seconds in known if seconds is not None]
    if len(whole) == len(known) > 1:
        lines.append(f"Expected: about {duration(sum(whole))} on {cores:.0f} cores.")
    return lines


USER_BYTES = 100_000
"""Least memory of a user's body and app, bytes (docs/evidence/training_and_speed.md)."""

_M_TRIM_THRESHOLD = -1
_M_MMAP_MAX = -4


def keep_freed_memory() -> bool:
    """Ask the C library to keep large freed blocks instead of returning them to the system.

    A minibatch of 1,000 images allocates and frees some 700 MB; glibc gives blocks of that size
    back at once, and the next minibatch pays for fresh pages again. Keeping them makes an update
    1.7 times as fast on the CPU, for about 200 MB more memory. Results are the same to the bit.

    Returns:
        Whether the C library could be asked (it is glibc).
    """
    if platform.libc_ver()[0] != "glibc":
        return False
    libc = ctypes.CDLL(None)
    return bool(libc.mallopt(_M_MMAP_MAX, 0) and libc.mallopt(_M_TRIM_THRESHOLD, 2**31 - 1))


def require_memory(config: TrainingConfig) -> None:
    """Check that the users and the rollouts of a training can fit this machine's memory.

    Raises:
        InputError: They cannot, however little the rest takes.
    """
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    space = ResolvedEnv(config.env).observation_space
    ppo = config.ppo
    users, rollout = ppo.n_envs * USER_BYTES, buffer_bytes(space, ppo.steps_per_iteration)
    if users + rollout > have:
        key = "ppo.n_envs" if users > rollout else "ppo.n_steps"
        got = ppo.n_envs if users > rollout else ppo.n_steps
        raise InputError(
            key,
            f"{got}, which needs {(users + rollout) / 2**30:,.0f} GiB for {ppo.n_envs:,} users and "
            f"the observations of {ppo.steps_per_iteration:,} user steps",
            f"less than the machine's {have / 2**30:,.0f} GiB",
        )


__all__ = ["MakeSimulation", "TrainResult", "make_simulation", "train"]

CHANGEABLE = (
    *("name", "total_timesteps", "checkpoint", "evaluation", "wandb", "device"),
    *("env.cores", "env.shards"),
    *(
        f"env.app.{key}"
        for key in (
            *("transport", "executable", "arguments", "game_library", "connect", "processes"),
            *("timeout_s", "start_timeout_s", "time_scale"),
        )
    ),
)
"""Keys that a resumed run may change; any other would make it a different run."""


@dataclass(frozen=True)
class TrainResult:
    """Outcome of a session.

    Attributes:
        folder: The run's folder.
        checkpoint: The newest checkpoint, which is the trained user; None if the session was
            stopped before the first checkpoint.
        step: User steps of the last stage in all sessions, as far as saved.
        interrupted: True if the session was stopped by Ctrl-C, SIGTERM or the ``stop`` callback.
        lost_steps: User steps of the unfinished iteration, which resuming repeats.
        seconds: Wall time of the session.
        stage: Name of the stage that the session ended in; empty if there was nothing to do.
        saved: The saved progress of that stage, as text; empty if nothing is saved yet.
    """

    folder: RunFolder
    checkpoint: Path | None
    step: int
    interrupted: bool
    lost_steps: int
    seconds: float
    stage: str = ""
    saved: str = ""


def make_simulation(config: TrainingConfig) -> Simulation:
    """Make the users and apps of ``config``; the default :data:`MakeSimulation`."""
    return shards.make_simulation(config.env, config.ppo.n_envs)


def train(
    config: TrainingConfig,
    out: Path,
    *,
    timesteps: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    set_aside: bool = False,
    console: Console | None = None,
    report: Callable[[Report], None] | None = None,
    stop: Callable[[], bool] | None = None,
    simulation: MakeSimulation = make_simulation,
) -> TrainResult:
    """Train a simulated user until ``timesteps`` user steps are taken.

    Args:
        config: The configuration; with ``resume`` it must agree with the run's own.
        timesteps: Where this session stops, from the start of the run's last stage, rounded up to
            whole iterations; None: ``config.last_stage_steps``, over which schedules run anyway.
        resume: Continue the run in ``out``; one that has reached ``timesteps`` is left as it is.
        set_aside: With ``resume``: rename files that cannot be used (to ``NAME.aside``) and
            continue from the newest ones that can.
        console: Where to print; None prints to the standard error stream.
        report: Called with a :class:`.Report` after every cycle, round or iteration.
        stop: Asked at every step; once it returns True the training saves and ends, as after
            Ctrl-C. It may be called some thousand times a second.
        simulation: How to make the users of the last stage.

    Raises:
        InputError: An argument cannot be used; nothing has been written then.
        UnusableFile: With ``resume``: a file to continue from is damaged, or not finite.
        NotFinite: What is learned has become NaN or infinite; the moment before it is saved.
    """
    console = console or Console(stderr=True)
    until = config.last_stage_steps if timesteps is None else timesteps
    # Refuse settings that this machine cannot train with.
    if until < 1:
        raise InputError("--timesteps", str(until), "at least 1")
    if config.wandb.enabled:
        require_wandb()
    if config.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device", "'cuda', but torch finds no GPU", "'cpu' or 'auto'")
    people = config.env.user.people
    if people is not None and people.left_handed:
        expected = "0: left-handers are mirror images of those who learn; evaluate them"
        raise InputError("env.user.people.left_handed", f"{people.left_handed:g}", expected)
    require_memory(config)
    folder = RunFolder(out)
    if resume:
        if not folder.exists:
            resumable_expected = "a folder with a run in it"
            if folder.run_file.is_file():
                resumable_expected += (
                    "; a run that was killed before it began is begun again without --resume"
                )
            raise InputError(
                "--resume", f"{str(folder.path)!r}, which holds no run", resumable_expected
            )
        difference = first_difference(config, folder.load_config(), ignore=CHANGEABLE)
        if difference is not None:
            key, new, old = difference
            raise InputError(
                key,
                repr(new),
                f"{old!r} as in {folder.config_file}: a resumed run keeps its settings",
            )
    elif not overwrite:
        folder.require_free()
    keep_freed_memory()
    session = _Session(config, folder, until, simulation, resume, console, report, stop)
    with torch_threads(torch_budget(config.env.cores)):
        return session.train(overwrite=overwrite, set_aside=set_aside)


@dataclass(frozen=True)
class _Session:
    """A session of training in a run's folder; fields as the arguments of :func:`train`."""

    config: TrainingConfig
    folder: RunFolder
    until: int
    simulation: MakeSimulation
    resume: bool
    console: Console
    report: Callable[[Report], None] | None
    stop: Callable[[], bool] | None

    def train(self, *, overwrite: bool, set_aside: bool) -> TrainResult:
        """Hold the folder and run the stages, again after a file has been set aside."""
        began, folder = time.monotonic(), self.folder
        with ExitStack() as held:
            if folder.path.is_dir():
                held.enter_context(sole_training(folder.path, folder.lock_file))
            stages = self._stages(resumed=self.resume)
            opened = None if self.resume else self._create(stages[0], held, overwrite=overwrite)
            while True:
                try:
                    outcome = self._run(stages, opened)
                    break
                except UnusableFile as error:
                    names = (f"{error.file.name}.aside{number or ''}" for number in count())
                    places = (error.file.with_name(name) for name in names)
                    aside = next(place for place in places if not place.exists())
                    if not set_aside:
                        path = shlex.quote(str(folder.path))
                        where = "from that one" if error.instead else "with what is left"
                        error.args = (
                            f"{error}; to go on {where} and keep this file as {aside.name}: "
                            f"sim2vr-harness train --resume {path} --set-aside",
                        )
                        raise
                    error.file.rename(aside)
                    text = (
                        f"{error.file} cannot be used ({error.reason}); it is kept as {aside.name}."
                    )
                    self.console.print(text, highlight=False, markup=False, soft_wrap=True)
                    stages = self._stages(resumed=True)
        files, interrupted = folder.checkpoints(), outcome.status != "finished"
        return TrainResult(
            folder=folder,
            checkpoint=files[-1] if files else None,
            step=folder.step,
            interrupted=interrupted,
            lost_steps=getattr(stages[-1], "lost_steps", 0) if interrupted else 0,
            seconds=time.monotonic() - began,
            stage=outcome.stage,
            saved=outcome.saved,
        )

    def _stages(self, *, resumed: bool) -> list[Stage]:
        return stages_of(
            Run(self.config, self.folder, self.until, self.simulation, resumed=resumed)
        )

    def _create(self, first: Stage, held: ExitStack, *, overwrite: bool) -> Stage:
        """Open the first stage, then create the folder; return the stage.

        A setting that cannot be used shows before a run that is there is deleted.
        """
        folder, config = self.folder, self.config
        say_line(self.console, f"Preparing {config.name} (recipe {config.recipe}) ...")
        try:
            first.open()
            if not folder.path.is_dir():
                held.enter_context(sole_training(folder.path, folder.lock_file))
            folder.create(self.config, overwrite)
        except BaseException:
            first.close()
            raise
        return first

    def _run(self, stages: Sequence[Stage], opened: Stage | None) -> StageOutcome:
        """Run the stages that are left, and note the session in the folder."""
        folder = self.folder
        if self.resume and not remaining(stages):
            require_readable(folder.latest_checkpoint())
            reached = f"{folder.path} has reached {stages[-1].saved}"
            self.console.print(f"Nothing to train: {reached}.")
            return StageOutcome()
        if self.resume:
            name, recipe = self.config.name, self.config.recipe
            say_line(self.console, f"Continuing {name} (recipe {recipe}) ...")
            folder.store_config(self.config)
        for line in plan_lines([stage for _, stage in remaining(stages)], self.config):
            say_line(self.console, line)
        remember(self.config.env.app, folder.path)
        folder.begin_session(start_step=folder.step)
        try:
            return run_stages(
                stages, folder, self.console, opened=opened, report=self.report, stop=self.stop
            )
        finally:
            if not folder.exists:  # the folder was removed meanwhile: no one else knows it
                folder.store_config(self.config)
